"""The models of the parts, and what the FMUs at either side of a cut know of one another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from engine.assemble import build
from flexarm.splitting.flanges import CutFlange
from flexarm.splitting.parts import Part
from fmu import ssp
from fmu.coupling import Answers, Coupling, answers, with_jerk
from fmu.variables import flat

if TYPE_CHECKING:
    from engine.model import Model


def coupled(
    parts: Mapping[str, Part], wires: list[tuple[ssp.End, ssp.End]]
) -> tuple[dict[str, Model], dict[str, Coupling]]:
    """The parts' models, and what their exports must know; what followers send along with their torque is wired."""
    typical: dict[str, dict[str, float]] = {name: {} for name in parts}
    for name, part in parts.items():
        for cut in part.owners:
            taken = parts[cut.follower].take(f"{cut.block}.jerk")
            wires.append(((name, flat(f"{cut.head}.jerk")), (cut.follower, flat(taken))))
    for name, part in parts.items():
        model = _build(part)
        for cut in part.followers:
            found = _answers(model, cut)
            for variable in found.model.outputs[len(model.outputs) :]:
                key = variable.name.rpartition(".")[2]
                taken = parts[cut.owner].take(f"{cut.owning}.{key}")
                wires.append(((name, flat(variable.name)), (cut.owner, flat(taken))))
                if key in found.typical:
                    typical[cut.owner][taken] = found.typical[key]
    models, couplings = {}, {}
    for name, part in parts.items():
        models[name] = _build(part)
        for cut in part.followers:
            models[name] = _answers(models[name], cut).model
        for cut in part.owners:
            if f"{cut.head}.jerk" not in [variable.name for variable in models[name].outputs]:
                models[name] = with_jerk(models[name], f"{cut.head}.{cut.motions[2]}")
        blocks = {cut.block for cut in part.followers} | {cut.owning for cut in part.owners}
        sent = tuple(endpoint for endpoint in part.inputs if endpoint.rpartition(".")[0] in blocks)
        couplings[name] = Coupling(sent, typical[name])
    return models, couplings


def _build(part: Part) -> Model:
    return build(part.system, inputs=part.inputs, outputs=part.outputs)


def _answers(model: Model, cut: CutFlange) -> Answers:
    return answers(model, f"{cut.block}.{cut.effort}", [f"{cut.block}.{name}" for name in (*cut.motions, "jerk")])
