"""A scenario as several FMUs and an SSP that wires them.

Where a shaft is cut, one side keeps the motion: it gives angle and speed and takes the torque. The other side follows
the motion and gives the torque; it must end in a spring, a damper or a contact there, because an inertia would need the
acceleration, which depends on the torque at once.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca

from blocks.actuators.effort import Force, Torque
from engine.assemble import build
from engine.block import Block, flange, signal_in, signal_out
from engine.errors import FlexarmError, nearest
from engine.ports import MOTION, TRANSLATIONAL
from engine.system import Connection, System, bypass
from fmu import ssp
from fmu.variables import flat

if TYPE_CHECKING:
    from engine.net import Net
    from flexarm.cut import Cut

REST = "rest"


class Follower(Block):
    """A cut shaft on the side that follows: its angle and speed come from outside, its torque goes there."""

    angle = signal_in("rad", "angle of the shaft")
    speed = signal_in("rad/s", "speed of the shaft")
    acceleration = signal_in("rad/s2", "acceleration of the shaft", default=0.0)
    shaft = flange("where the cut is")
    torque = signal_out("N.m", "torque on the other side of the cut")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.torque, -net.prescribe(self.shaft, self.angle, self.speed, self.acceleration))


class TranslationalFollower(Block):
    """The same for a translational flange."""

    position = signal_in("m", "position of the flange")
    speed = signal_in("m/s", "speed of the flange")
    acceleration = signal_in("m/s2", "acceleration of the flange", default=0.0)
    flange = flange("where the cut is", kind=TRANSLATIONAL)
    force = signal_out("N", "force on the other side of the cut")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.force, -net.prescribe(self.flange, self.position, self.speed, self.acceleration))


@dataclass
class _Part:
    """One group of blocks on its way to an FMU."""

    system: System
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)

    def give(self, name: str) -> str:
        if name not in self.outputs:
            self.outputs.append(name)
        return name

    def take(self, name: str) -> str:
        self.inputs.append(name)
        return name


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
    from fmu import export

    target = Path(path)
    system = bypass(made.scenario.system, list(made.settings.inputs))[0]
    parts, wires = _cut(system, _members(system, groups))
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
    with tempfile.TemporaryDirectory() as folder:
        for name, part in parts.items():
            model = build(part.system, inputs=part.inputs, outputs=part.outputs)
            file = export(model, Path(folder) / f"{name}.fmu", **settings)
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


def _members(system: System, groups: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Blocks of every group, in the order of the system's."""
    of: dict[str, str] = {}
    for group, names in groups.items():
        if flat(group) != group or group == REST:
            raise FlexarmError(
                f"'{group}' cannot name an FMU", remedy="letters, digits and underscores, and not 'rest'"
            )
        for name in names:
            found = [block for block in system.blocks if block == name or block.startswith(f"{name}.")]
            if not found:
                raise FlexarmError(f"there is no block '{name}' to split off", remedy=nearest(name, system.blocks))
            for block in found:
                if of.setdefault(block, group) != group:
                    raise FlexarmError(
                        f"block '{block}' is in two groups: {of[block]} and {group}", remedy="name it in one of them"
                    )
    members: dict[str, list[str]] = {group: [] for group in groups}
    for block in system.blocks:
        members.setdefault(of.get(block, REST), []).append(block)
    if len(members) < 2:
        raise FlexarmError("that leaves one FMU", remedy="split off some blocks and leave others: NAME=BLOCK,BLOCK")
    return members


def _cut(system: System, members: Mapping[str, list[str]]) -> tuple[dict[str, _Part], list[tuple[ssp.End, ssp.End]]]:
    of = {block: group for group, blocks in members.items() for block in blocks}
    parts = {}
    for group, blocks in members.items():
        inside = {block: system.blocks[block] for block in blocks}
        initial = {n: v for n, v in system.initial.items() if of.get(_block(system, n)) == group}
        shared = {block: names for block, names in system.shared.items() if block in inside}
        part = replace(system, blocks=inside, connections=[], shared=shared, initial=initial)
        part.name, part.description = group, f"{group} of {system.name}"
        parts[group] = _Part(part)
    wires: list[tuple[ssp.End, ssp.End]] = []
    crossing: list[tuple[Connection, dict[str, list[str]]]] = []
    for connection in system.connections:
        ends: dict[str, list[str]] = {}
        for end in connection.ends:
            ends.setdefault(of[system.split(end)[0]], []).append(end)
        if len(ends) == 1:
            parts[next(iter(ends))].system.connections.append(connection)
        elif system.is_flange(connection.ends[0]):
            crossing.append((connection, ends))
            for group, own in ends.items():
                if len(own) > 1:
                    parts[group].system.connections.append(replace(connection, ends=tuple(own)))
        else:
            _cut_signal(system, connection, ends, parts, wires)
    # Which side of a shaft can follow is judged by the parts as they are, before any cut is closed.
    owners = [_owner(system, connection, ends, parts) for connection, ends in crossing]
    for (_, ends), owner in zip(crossing, owners, strict=True):
        _cut_flange(system, ends, owner, parts, wires)
    return parts, wires


def _block(system: System, name: str) -> str:
    try:
        return system.split(name)[0]
    except FlexarmError:
        return ""


def _cut_signal(
    system: System,
    connection: Connection,
    ends: Mapping[str, list[str]],
    parts: Mapping[str, _Part],
    wires: list[tuple[ssp.End, ssp.End]],
) -> None:
    source = next(end for end in connection.ends if not system.is_input(end))
    for group, own in ends.items():
        if source in own:
            if len(own) > 1:
                parts[group].system.connections.append(replace(connection, ends=tuple(own)))
            start = (group, flat(parts[group].give(source)))
    for group, own in ends.items():
        if source not in own:
            wires += [(start, (group, flat(parts[group].take(end)))) for end in own]


def _kind(system: System, end: str) -> str:
    block, port = system.split(end)
    return system.blocks[block].ports[port].kind


def _owner(system: System, connection: Connection, ends: Mapping[str, list[str]], parts: Mapping[str, _Part]) -> str:
    """The side that keeps the motion: the first from which all others can follow."""
    heavy = [group for group, own in ends.items() if not _can_follow(system, parts[group], own[0])]
    if len(heavy) > 1:
        raise FlexarmError(
            f"the cut through {' - '.join(connection.ends)} has inertia on both sides ({' and '.join(heavy)})",
            connection.where,
            "cut at a spring, a damper or a contact, so that one side has none at the cut; or leave "
            f"{', '.join(dict.fromkeys(system.split(end)[0] for end in connection.ends))} in one FMU",
        )
    return heavy[0] if heavy else next(iter(ends))


def _can_follow(system: System, part: _Part, end: str) -> bool:
    """Whether the torque at a flange whose motion is imposed does not depend on its acceleration."""
    name, port, wanted = _follower(system, end)
    signals = [f"{name}.{signal}" for signal in (*wanted, "acceleration")]
    trial = replace(part.system, blocks=dict(part.system.blocks), connections=list(part.system.connections))
    trial.initial = {}
    _close(trial, end, name, port, _kind(system, end))
    free = [endpoint for endpoint in trial.inputs() if _open(trial, endpoint) and endpoint not in signals]
    try:
        model = build(trial, inputs=[*signals, *free], outputs=[f"{name}.{_effort(system, end)}"])
    except FlexarmError:
        return False
    return not ca.jacobian_sparsity(model.equations.outputs, model.equations.u[len(signals) - 1]).nnz()


def _open(system: System, endpoint: str) -> bool:
    block, port = system.split(endpoint)
    return system.source_of(endpoint) is None and system.blocks[block].ports[port].default is None


def _follower(system: System, end: str) -> tuple[str, str, tuple[str, str]]:
    """Name of the follower's block, its flange, and the motions it takes."""
    kind = _kind(system, end)
    names = [name for name, _ in MOTION[kind][:2]]
    return f"cut_{flat(end)}", "flange" if kind == TRANSLATIONAL else "shaft", (names[0], names[1])


def _effort(system: System, end: str) -> str:
    return "force" if _kind(system, end) == TRANSLATIONAL else "torque"


def _close(system: System, end: str, name: str, port: str, kind: str) -> None:
    system.blocks[name] = TranslationalFollower() if kind == TRANSLATIONAL else Follower()
    _join(system, end, f"{name}.{port}")


def _join(system: System, end: str, added: str) -> None:
    """Put a flange on the node that ``end`` is on."""
    for i, connection in enumerate(system.connections):
        if end in connection.ends:
            system.connections[i] = replace(connection, ends=(*connection.ends, added))
            return
    system.connections.append(Connection((end, added)))


def _cut_flange(
    system: System,
    ends: Mapping[str, list[str]],
    owner: str,
    parts: Mapping[str, _Part],
    wires: list[tuple[ssp.End, ssp.End]],
) -> None:
    head = ends[owner][0]
    for group, own in ends.items():
        if group == owner:
            continue
        end, effort = own[0], _effort(system, own[0])
        name, port, motions = _follower(system, end)
        _close(parts[group].system, end, name, port, _kind(system, end))
        for motion in motions:
            start = (owner, flat(parts[owner].give(f"{head}.{motion}")))
            wires.append((start, (group, flat(parts[group].take(f"{name}.{motion}")))))
        source: Block = Force() if _kind(system, end) == TRANSLATIONAL else Torque()
        parts[owner].system.blocks[f"{name}_{effort}"] = source
        _join(parts[owner].system, head, f"{name}_{effort}.{port}")
        out = (group, flat(parts[group].give(f"{name}.{effort}")))
        wires.append((out, (owner, flat(parts[owner].take(f"{name}_{effort}.{effort}")))))
