"""A scenario as several FMUs and an SSP that wires them.

Where a shaft is cut, one side keeps the motion: it gives angle, speed and acceleration and takes the torque. The other
side follows the motion and gives the torque, and how the torque answers the motion: see `fmu.coupling`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca

from engine.assemble import build
from engine.block import Block, flange, signal_in, signal_out
from engine.errors import FlexarmError, nearest
from engine.ports import MOTION, TRANSLATIONAL
from engine.system import Connection, System, bypass
from fmu import ssp
from fmu.coupling import NEVER, Answers, Coupling, answers, elapsed, felt_inertia, motion, with_jerk
from fmu.variables import flat

if TYPE_CHECKING:
    from engine.model import Model
    from engine.net import Net
    from flexarm.cut import Cut

REST = "rest"


class Follower(Block):
    """A cut shaft on the side that follows: its motion comes from outside, its torque goes there.

    Between communication points the motion goes on: with s = time - sent, by
    angle + speed s + acceleration s^2 / 2 + jerk s^3 / 6.
    """

    angle = signal_in("rad", "angle of the shaft")
    speed = signal_in("rad/s", "speed of the shaft")
    acceleration = signal_in("rad/s2", "acceleration of the shaft", default=0.0)
    jerk = signal_in("rad/s3", "its rate of change", default=0.0)
    sent = signal_in("s", "when the motion held", default=NEVER)
    shaft = flange("where the cut is")
    torque = signal_out("N.m", "torque on the other side of the cut")
    now = signal_out("s", "when the torque holds")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.torque, -_imposed(net, self.shaft, self.angle, self))


class TranslationalFollower(Block):
    """The same for a translational flange."""

    position = signal_in("m", "position of the flange")
    speed = signal_in("m/s", "speed of the flange")
    acceleration = signal_in("m/s2", "acceleration of the flange", default=0.0)
    jerk = signal_in("m/s3", "its rate of change", default=0.0)
    sent = signal_in("s", "when the motion held", default=NEVER)
    flange = flange("where the cut is", kind=TRANSLATIONAL)
    force = signal_out("N", "force on the other side of the cut")
    now = signal_out("s", "when the force holds")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.force, -_imposed(net, self.flange, self.position, self))


def _imposed(net: Net, flange: Any, angle: Any, block: Any) -> Any:
    s = elapsed(net.time, block.sent)
    net.output(block.now, net.time)
    return net.prescribe(flange, *motion(angle, block.speed, block.acceleration, block.jerk, s))


class Owner(Block):
    """A cut shaft on the side that keeps the motion: the torque of the other side, and how it answers the motion.

    torque on the shaft = torque + offset + rate s - stiffness angle - damping speed - inertia acceleration, with
    s = time - sent.
    """

    torque = signal_in("N.m", "torque on the shaft")
    rate = signal_in("N.m/s", "its rate of change by itself", default=0.0)
    offset = signal_in("N.m", "stiffness angle + damping speed where the torque holds", default=0.0)
    stiffness = signal_in("N.m/rad", "how it falls with the angle", default=0.0)
    damping = signal_in("N.m.s/rad", "how it falls with the speed", default=0.0)
    inertia = signal_in("kg.m2", "inertia behind the cut", default=0.0)
    sent = signal_in("s", "when the torque held", default=NEVER)
    shaft = flange("where the cut is")
    now = signal_out("s", "when the motion holds")

    def stamp(self, net: Net) -> None:
        """Act on the shaft."""
        _act(net, self.shaft, self.shaft.angle, self.torque, self)


class TranslationalOwner(Block):
    """The same for a translational flange."""

    force = signal_in("N", "force on the flange")
    rate = signal_in("N/s", "its rate of change by itself", default=0.0)
    offset = signal_in("N", "stiffness position + damping speed where the force holds", default=0.0)
    stiffness = signal_in("N/m", "how it falls with the position", default=0.0)
    damping = signal_in("N.s/m", "how it falls with the speed", default=0.0)
    inertia = signal_in("kg", "mass behind the cut", default=0.0)
    sent = signal_in("s", "when the force held", default=NEVER)
    flange = flange("where the cut is", kind=TRANSLATIONAL)
    now = signal_out("s", "when the motion holds")

    def stamp(self, net: Net) -> None:
        """Act on the flange."""
        _act(net, self.flange, self.flange.position, self.force, self)


def _act(net: Net, motion: Any, angle: Any, effort: Any, block: Any) -> None:
    net.inertia(motion, block.inertia)
    net.output(block.now, net.time)
    effort = (
        effort
        + block.offset
        + block.rate * elapsed(net.time, block.sent)
        - block.stiffness * angle
        - block.damping * motion.speed
    )
    net.force(motion, effort)
    net.supply(effort * motion.speed)


@dataclass(frozen=True)
class _Cut:
    """A flange that was cut: groups on either side, the owner's flange, the follower's block, effort and motions."""

    owner: str
    follower: str
    head: str
    block: str
    effort: str
    motions: tuple[str, str, str]

    @property
    def owning(self) -> str:
        """Name of the block on the owner's side."""
        return f"{self.block}_{self.effort}"


@dataclass
class _Part:
    """One group of blocks on its way to an FMU."""

    system: System
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    followers: list[_Cut] = field(default_factory=list)
    owners: list[_Cut] = field(default_factory=list)

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
    from flexarm.api import magnitudes as whole_magnitudes
    from fmu import export

    target = Path(path)
    system = bypass(
        made.scenario.system, list(made.settings.inputs), [variable.name for variable in made.model.outputs]
    )[0]
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
    models, couplings = _coupled(parts, wires)
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


def _coupled(
    parts: Mapping[str, _Part], wires: list[tuple[ssp.End, ssp.End]]
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


def _build(part: _Part) -> Model:
    return build(part.system, inputs=part.inputs, outputs=part.outputs)


def _answers(model: Model, cut: _Cut) -> Answers:
    return answers(model, f"{cut.block}.{cut.effort}", [f"{cut.block}.{name}" for name in (*cut.motions, "jerk")])


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
    """The side that keeps the motion: one that cannot follow, else one with inertia at the cut, else the heavier."""
    groups = list(ends)
    weights = {group: _weight(system, parts[group], own[0]) for group, own in ends.items()}
    fixed = [group for group in groups if weights[group] is None]
    if len(fixed) > 1:
        raise FlexarmError(
            f"the cut through {' - '.join(connection.ends)} has a side to follow the other on neither end: "
            f"{' and '.join(fixed)} cannot have their motion imposed there",
            connection.where,
            "friction or another imposed motion holds it; cut elsewhere, or leave "
            f"{', '.join(dict.fromkeys(system.split(end)[0] for end in connection.ends))} in one FMU",
        )
    return fixed[0] if fixed else max(groups, key=lambda group: weights[group] or (False, 0.0))


def _weight(system: System, part: _Part, end: str) -> tuple[bool, float] | None:
    """Whether a flange has inertia of its own, and the inertia felt there; None if its motion cannot be imposed."""
    name, port, wanted = _follower(system, end)
    signals = [f"{name}.{signal}" for signal in wanted]
    trial = replace(part.system, blocks=dict(part.system.blocks), connections=list(part.system.connections))
    trial.initial = {}
    _close(trial, end, name, port, _kind(system, end))
    free = [endpoint for endpoint in trial.inputs() if _open(trial, endpoint) and endpoint not in signals]
    try:
        model = build(trial, inputs=[*signals, *free], outputs=[f"{name}.{_effort(system, end)}"])
    except FlexarmError:
        return None
    own = ca.jacobian_sparsity(model.equations.outputs, model.equations.u[len(signals) - 1]).nnz()
    return bool(own), felt_inertia(model)


def _open(system: System, endpoint: str) -> bool:
    block, port = system.split(endpoint)
    return system.source_of(endpoint) is None and system.blocks[block].ports[port].default is None


def _follower(system: System, end: str) -> tuple[str, str, tuple[str, str, str]]:
    """Name of the follower's block, its flange, and the motions it takes."""
    kind = _kind(system, end)
    names = [name for name, _ in MOTION[kind][:3]]
    return f"cut_{flat(end)}", "flange" if kind == TRANSLATIONAL else "shaft", (names[0], names[1], names[2])


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
        for sent in motions:
            start = (owner, flat(parts[owner].give(f"{head}.{sent}")))
            wires.append((start, (group, flat(parts[group].take(f"{name}.{sent}")))))
        cut = _Cut(owner, group, head, name, effort, motions)
        parts[group].followers.append(cut)
        parts[owner].owners.append(cut)
        side: Block = TranslationalOwner() if _kind(system, end) == TRANSLATIONAL else Owner()
        parts[owner].system.blocks[cut.owning] = side
        _join(parts[owner].system, head, f"{cut.owning}.{port}")
        out = (group, flat(parts[group].give(f"{name}.{effort}")))
        wires.append((out, (owner, flat(parts[owner].take(f"{cut.owning}.{effort}")))))
        for here, there, sender, taker in ((owner, group, cut.owning, name), (group, owner, name, cut.owning)):
            held = (here, flat(parts[here].give(f"{sender}.now")))
            wires.append((held, (there, flat(parts[there].take(f"{taker}.sent")))))
