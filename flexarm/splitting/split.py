"""Splits: the FMUs of a scenario's parts in one SSP file."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.system import bypass
from flexarm.splitting.cutting import cut_apart
from flexarm.splitting.models import coupled
from flexarm.splitting.parts import members_of
from fmu import ssp
from fmu.variables import flat

if TYPE_CHECKING:
    from flexarm.cut import Cut


def split(
    made: Cut, path: str | Path, groups: Mapping[str, Sequence[str]], *, bare: bool = False, **settings: Any
) -> Path:
    """Write an SSP with one FMU for each group of blocks; blocks in no group make up the FMU ``rest``.

    Args:
        made: the scenario with its inputs and outputs freed.
        path: the .ssp file.
        groups: name -> blocks or sub-assemblies.
        bare: leave out the system's own connectors, which libcosim and Ecos cannot read; the FMUs' own remain.
        settings: of `fmu.export`: step, stop, platforms, version.

    Raises:
        FlexarmError: a name that does not fit, fewer than two FMUs, or a cut where both sides have inertia.
    """
    from flexarm.api import magnitudes as whole_magnitudes
    from fmu import export

    target = Path(path)
    system = bypass(
        made.scenario.system, list(made.settings.inputs), [variable.name for variable in made.model.outputs]
    )[0]
    parts, wires = cut_apart(system, members_of(system, groups))
    outside: list[ssp.Connector] = []
    units: dict[ssp.End, str] = {}
    owners = {block: name for name, part in parts.items() for block in part.system.blocks}
    outputs = [variable.name for variable in made.model.outputs]
    for endpoint in made.settings.inputs:
        owner = owners[system.split(endpoint)[0]]
        wires.append((("", flat(endpoint)), (owner, flat(parts[owner].take(endpoint)))))
    for name in outputs:
        owner = owners[system.split(name)[0]]
        wires.append(((owner, flat(parts[owner].give(name))), ("", flat(name))))
    files: dict[str, bytes] = {}
    components: dict[str, tuple[ssp.Connector, ...]] = {}
    models, couplings = coupled(parts, wires)
    sizes = whole_magnitudes(made)
    with tempfile.TemporaryDirectory() as folder:
        for name, model in models.items():
            coupling = couplings[name]
            file = export(model, Path(folder) / f"{name}.fmu", coupling=coupling, magnitudes=sizes, **settings)
            files[f"resources/{name}.fmu"] = file.read_bytes()
            listed = [("input", v) for v in model.inputs] + [("output", v) for v in model.outputs]
            components[name] = tuple(ssp.Connector(flat(v.name), kind, v.unit) for kind, v in listed)
            units |= {(name, flat(v.name)): v.unit for _, v in listed}
    for start, end in wires:
        if not start[0]:
            outside.append(ssp.Connector(start[1], "input", units[end]))
        elif not end[0]:
            outside.append(ssp.Connector(end[1], "output", units[start]))
    structure = ssp.Structure(
        name=flat(made.scenario.name),
        connectors=() if bare else tuple(outside),
        components=components,
        sources={name: f"resources/{name}.fmu" for name in parts},
        connections=tuple((start, end) for start, end in wires if not bare or (start[0] and end[0])),
        stop=float(settings.get("stop", 10.0)),
        step=float(settings.get("step", 1e-3)),
    )
    ssp.write(target, structure, files)
    return target
