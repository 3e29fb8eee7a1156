"""How large things are where an effect may act: inputs, torques, speeds and inertias at the places of a system.

Places along which something slides are told in the same words: torque stands for force, angle for position, inertia for
mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blocks.registry import registry
from diagnosis.effects.places import (
    BLOCK,
    INPUT,
    JOINT,
    SENSOR,
    SHAFT,
    Place,
    groups,
    imposing_effort,
    node,
    ratio,
    sides,
    slides,
    splits,
)
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.recordings.feedback import plant_inputs
from diagnosis.thresholds import TABLES, WORDING
from engine.assemble import build
from engine.linearise import linearise
from engine.ports import MOTION, ROTATIONAL, TRANSLATIONAL
from engine.system import Connection, System

BIAS = 0.05
"""A sensor's bias is seldom larger than this share of the largest value that it has shown."""


@dataclass
class OperatingScales:
    """What the recordings say about sizes at the places of a system.

    Attributes:
        problem: the nominal problem.
        inputs: driven input, or one where a controller meets the plant -> largest |value|.
        units: unit of each of them.
        slides: flanges in ``groups`` that slide rather than turn.
        groups: places that move together: name of the flange that stands for them, and all their flanges.
        torque: flange -> size of the torques that act there.
        speed, angle: flange -> size of its motion.
        inertia: flange -> inertia felt there.
        lines: frequencies (rad/s) of the largest peaks of what the model leaves over to which effects are added.
        tones: frequencies (rad/s) that stand out there of what is around them; see `diagnosis.estimation.tones`.
        fitted: the nominal problem's parameters in that model, as a search vector, if there is one yet.
        left: what it leaves over: training recording -> residual, shape (samples, signals).
    """

    problem: Problem
    inputs: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    slides: set[str] = field(default_factory=set)
    groups: dict[str, list[str]] = field(default_factory=dict)
    torque: dict[str, float] = field(default_factory=dict)
    speed: dict[str, float] = field(default_factory=dict)
    angle: dict[str, float] = field(default_factory=dict)
    inertia: dict[str, float] = field(default_factory=dict)
    lines: list[float] = field(default_factory=list)
    tones: list[float] = field(default_factory=list)
    fitted: Array | None = None
    left: Mapping[str, Array] = field(default_factory=dict)

    @property
    def begun(self) -> Array:
        """`fitted`, or the given parameters where nothing is fitted yet."""
        return np.zeros(len(self.problem.free)) if self.fitted is None else self.fitted

    def residual(self, e: Experiment) -> Array:
        """What is left over of a training recording, by `left` or else by the nominal model."""
        found = self.left.get(e.name)
        return self.problem.residual(self.begun, e) if found is None else found

    @property
    def sample(self) -> float:
        """The shortest time (s) that the recordings resolve."""
        return self.problem.shortest

    @property
    def longest(self) -> float:
        """The longest time constant (s) that the recordings can tell from a longer one."""
        return self.problem.longest

    @property
    def unseen(self) -> tuple[str, ...]:
        """Effects that recordings of this kind do not show."""
        return tuple(dict.fromkeys(name for e in self.problem.experiments for name in e.unseen_effects()))

    @property
    def factors(self) -> tuple[float, ...]:
        """Factors by which a parameter may be wrong, to start from: a few rows leave a fit in local optima."""
        return TABLES.factors if self.problem.sparse else ()

    def rotates_fully(self, flange: str) -> bool:
        """Whether a flange turns over by whole turns at a table's lowest frequency: gravity then averages out there."""
        lowest = [w for e in self.problem.experiments if (w := e.lowest_frequency) is not None]
        return bool(lowest) and self.speed[flange] / min(lowest) > math.pi

    @property
    def system(self) -> System:
        """The nominal system."""
        return self.problem.scenario.system

    def measured(self, signal: str) -> list[Array]:
        """What the training recordings hold of a signal, each of shape (instants,)."""
        k = [v.name for v in self.problem.model.outputs].index(signal)
        return [e.measured[:, k] for e in self.problem.training]

    def has_no_sign(self, sensor: Place) -> bool:
        """Whether nothing that was recorded lies farther below zero than noise and a small bias reach."""
        k = [v.name for v in self.problem.model.outputs].index(sensor.target)
        reach = [BIAS * sensor.size + WORDING.seen * float(e.sigma[k]) for e in self.problem.training]
        rows = zip(self.measured(sensor.target), reach, strict=True)
        return all(np.nanmin(measured) > -far for measured, far in rows)

    def places(self, kind: str) -> Iterator[Place]:
        """The places of a kind, in the order of the scenario.

        Args:
            kind: `INPUT`, `SHAFT`, `JOINT`, `BLOCK` or `SENSOR` of `diagnosis.effects.places`.

        Raises:
            KeyError: there is no such kind.
        """
        return {
            INPUT: self._inputs,
            SHAFT: self._shafts,
            JOINT: self._joints,
            BLOCK: self._blocks,
            SENSOR: self._sensors,
        }[kind]()

    def turns(self, shaft: Place) -> Iterator[Place]:
        """The shaft at each ratio at which its members turn: what depends on the angle itself differs between them."""
        tried: list[float] = []
        for member in self.groups[shaft.target]:
            ratio = self.ratio(shaft.target, member)
            if any(abs(ratio / other - 1) < 1e-6 for other in tried):
                continue
            tried.append(ratio)
            yield self._flange(SHAFT, shaft.target, member, member)

    def member(self, shaft: Place, flange: str) -> Place:
        """The shaft at one of its flanges."""
        return self._flange(SHAFT, shaft.target, flange, flange)

    def at(self, flange: str) -> Place | None:
        """Sizes at a flange, whichever stands for those that move with it; None where it does not move."""
        group = next((first for first, members in self.groups.items() if flange in (first, *members)), None)
        return None if group is None else self._flange(SHAFT, group, flange, flange)

    def ends(self, block: str) -> list[Place]:
        """The same at both ends of a spring."""
        return [place for end in ("a", "b") if (place := self.at(f"{block}.{end}")) is not None]

    def parted(self, problem: Problem) -> OperatingScales:
        """The same at the shafts of an amended model, where a joint that was put in parts one in two.

        What is large at a shaft is as large on either side. Blocks that were put in are no places.
        """
        amended = problem.scenario.system
        found = replace(
            self,
            groups={},
            slides=set(self.slides),
            torque=dict(self.torque),
            speed=dict(self.speed),
            angle=dict(self.angle),
            inertia=dict(self.inertia),
        )
        for members in groups(problem).values():
            own = [end for end in members if amended.split(end)[0] in self.system.blocks]
            first = next((end for end in own if end in self.groups), own[0] if own else "")
            place = self.at(first)
            if place is None:
                continue
            found.groups[first] = own
            found.torque[first], found.inertia[first] = place.torque, place.inertia
            found.speed[first], found.angle[first] = place.speed, place.angle
            found.slides |= {first} if place.sliding else set()
        return found

    def ratio(self, one: str, other: str) -> float:
        """How far ``other`` moves while ``one`` moves by one; 1 where one of them is held or moved from outside."""
        return ratio(self.problem, one, other)

    def _flange(self, kind: str, group: str, target: str, name: str) -> Place:
        """A place at a member of a group of flanges."""
        factor = self.ratio(group, target)
        return Place(
            kind,
            name,
            target,
            self.system.split(target)[0],
            sliding=group in self.slides,
            torque=self.torque[group] / factor,
            speed=self.speed[group] * factor,
            angle=self.angle[group] * factor,
            inertia=self.inertia[group] / factor**2,
        )

    def _inputs(self) -> Iterator[Place]:
        for target, size in self.inputs.items():
            source = next((end for end in node(self.system, target) if end != target), "signal")
            block = self.system.split(target)[0]
            yield Place(INPUT, f"{source} -> {target}", target, block, self.units[target], size)

    def _shafts(self) -> Iterator[Place]:
        for flange in self.groups:
            yield self._flange(SHAFT, flange, flange, flange)

    def _joints(self) -> Iterator[Place]:
        measured = [v.name for v in self.problem.model.outputs]
        for group, members in self.groups.items():
            seen: set[tuple[str, ...]] = set()
            for member in members:
                ends = tuple(end for end in node(self.system, member) if end in members)
                if len(ends) < 2 or ends in seen:
                    continue
                seen.add(ends)
                for inner, outer in splits(self.system, ends):
                    place = self._flange(JOINT, group, inner[0], f"{inner[0]} -> {outer[0]}")
                    for read_at in sides(measured, inner, outer):
                        told = [f"with {' and '.join(inner[1:])} on the side of {inner[0]}"] if inner[1:] else []
                        told += [f"with {old} read at {new.rpartition('.')[0]}" for old, new in read_at]
                        yield replace(place, beside=tuple(inner[1:]), read_at=read_at, option=" and ".join(told))

    def _blocks(self) -> Iterator[Place]:
        for name in self.system.blocks:
            yield Place(BLOCK, name, name, name)

    def _sensors(self) -> Iterator[Place]:
        for channel in self.problem.model.outputs:
            size = max(float(np.nanmax(np.abs(m))) for m in self.measured(channel.name)) or 1.0
            yield Place(SENSOR, channel.name, channel.name, channel.name, channel.unit, size)


def operating_scales(problem: Problem) -> OperatingScales:
    """Simulate the nominal model on the training recordings and see how large things are."""
    found = OperatingScales(problem)
    experiments = problem.training
    for k, variable in enumerate(problem.model.inputs):
        largest = [e.largest_inputs(len(problem.model.inputs)) for e in experiments]
        found.inputs[variable.name] = max((float(row[k]) for row in largest if len(row)), default=1.0) or 1.0
        found.units[variable.name] = variable.unit
    found.groups = groups(problem)
    found.slides = {flange for flange in found.groups if slides(problem.scenario.system, flange)}
    for flange in found.groups:
        found.inertia[flange] = _inertia(problem, flange)
    _sizes(found, experiments)
    return found


def _inertia(problem: Problem, flange: str) -> float:
    """Inertia felt at a flange: torque over acceleration at rest; 1 where the motion is imposed."""
    system = problem.scenario.system
    kind, port, effort = ("Force", "flange", "force") if slides(system, flange) else ("Torque", "shaft", "torque")
    if imposing_effort(system, flange):
        return 1.0
    probed = System(
        {**system.blocks, "probe": registry()[kind]()},
        [*system.connections, Connection((flange, f"probe.{port}"))],
        system.shared,
        {},
        system.places,
    )
    inputs = [f"probe.{effort}", *(v.name for v in problem.model.inputs)]
    model = build(probed, inputs=inputs, outputs=[f"{flange}.acceleration"])
    sliding = {mode.name: "sliding forward" for mode in model.modes if mode.kind == "friction"}
    gain = float(linearise(model, modes=sliding).D[0, 0])
    return 1 / gain if gain > 0 else 1.0


def _sizes(found: OperatingScales, experiments: Sequence[Experiment]) -> None:
    problem = found.problem
    system, driven = problem.scenario.system, [v.name for v in problem.model.inputs]
    wanted = {}
    for flange in found.groups:
        kind = TRANSLATIONAL if flange in found.slides else ROTATIONAL
        wanted[flange] = [f"{flange}.{quantity}" for quantity, _ in MOTION[kind][:3]]
    efforts = {flange: effort for flange in found.groups if (effort := imposing_effort(system, flange))}
    meets = {end: source[0] for end in plant_inputs(system, driven) if (source := system.source_of(end)) is not None}
    names = [*dict.fromkeys(name for row in wanted.values() for name in row), *efforts.values(), *meets.values()]
    model = build(system, driven, list(dict.fromkeys(names)))
    top = dict.fromkeys(names, 0.0)
    for e in experiments:
        for name, (spanned, rms) in e.spans(problem.scenario, model, names, problem.internal_step).items():
            top[name] = max(top[name], spanned if name.endswith((".angle", ".position")) else rms)
    for flange, (angle, speed, acceleration) in wanted.items():
        found.angle[flange] = top[angle] or 1.0
        found.speed[flange] = top[speed] or 1.0
        felt = top[efforts[flange]] if flange in efforts else found.inertia[flange] * top[acceleration]
        found.torque[flange] = felt or 1e-3
    units = {v.name: v.unit for v in model.outputs}
    for end, signal in meets.items():
        found.inputs[end] = 2 * top[signal] or 1.0
        found.units[end] = units[signal]
