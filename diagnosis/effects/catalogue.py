"""What may be missing: every effect at every place of a scenario where it can act.

An effect is an ordinary block or block option. Its parameters start from sizes that matter in the recordings at hand: a
share of the driving signal's range, or of the torques that act at the place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from blocks.registry import registry
from diagnosis.effects.effect import Candidate
from diagnosis.effects.mounts import at_mounts
from diagnosis.effects.scales import OperatingScales
from diagnosis.effects.shaft import at_joints, at_links, at_shaft, at_turns
from diagnosis.effects.signal import at_input, at_sensor
from diagnosis.effects.translational import along_slide, slides
from scenarios.amend import Edit, Set


def candidates(scales: OperatingScales) -> list[Candidate]:
    """Every effect of the catalogue at every place of the scenario where it can act."""
    rows: list[Candidate] = []
    for target, size in scales.inputs.items():
        rows += at_input(scales, target, size)
    for flange in scales.groups:
        rows += at_shaft(scales, flange)
        rows += at_turns(scales, flange)
    rows += at_joints(scales)
    rows += at_mounts(scales)
    rows = [along_slide(c) if slides(scales.problem.scenario.system, c) else c for c in rows]
    rows += at_links(scales)
    rows += _parameters(scales)
    for channel in scales.problem.model.outputs:
        rows += at_sensor(scales, channel.name)
    known = registry()
    seen = [c for c in rows if c.effect not in scales.unseen]
    return [c for c in seen if all(_type(e) in known for e in c.edits(c.starts[0]))]


def _type(edit: Edit) -> str:
    return "Gain" if isinstance(edit, Set) else edit.type


def _parameters(scales: OperatingScales) -> Iterator[Candidate]:
    """Each parameter with a tolerance, let go of it."""
    for f in scales.problem.free:
        if f.recording:
            continue
        block = f.name.rpartition(".")[0]
        free = replace(f, prior=False)
        yield Candidate(
            "wrong_parameter",
            f.name,
            block or f.name,
            block or f.name,
            lambda values: [],
            starts=({}, *({f.name.rpartition(".")[2]: factor * f.start} for factor in scales.factors)),
            freed=free,
        )
