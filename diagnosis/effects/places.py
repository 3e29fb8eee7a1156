"""Places where an effect may act: inputs, shafts, joints, blocks and sensors of a scenario."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from engine.ports import MOTION, TRANSLATIONAL
from engine.system import System

INPUT, SHAFT, JOINT, BLOCK, SENSOR = "input", "shaft", "joint", "block", "sensor"
"""Kinds of places: in front of a driven input; a shaft or slide, with all flanges that move in proportion; a connection
that may be cut, with the drive on one side; a block of the scenario; behind a measured signal."""


QUANTITIES = frozenset(name for names in MOTION.values() for name, _ in names[:3])
"""What can be measured of the motion of a flange."""


@dataclass(frozen=True)
class Place:
    """Where an effect may act, and how large things are there, in SI units.

    Attributes:
        kind: `INPUT`, `SHAFT`, `JOINT`, `BLOCK` or `SENSOR`.
        name: in the words of the block diagram, such as ``gear.output -> link.hub``.
        target: the input, flange, block or signal that an edit names.
        block: the block of the scenario that it belongs to.
        unit: of the signal, for an input or a sensor.
        size: largest value of the signal, for an input or a sensor.
        sliding: whether a shaft or joint is of the translational kind; torque then stands for force, angle for
            position and inertia for mass.
        torque: size of the torques that act, at a shaft or joint.
        speed, angle: root mean square of the speed, and range of the angle.
        inertia: inertia felt there.
        beside: of a joint of several flanges, those that stay with the target.
        read_at: signals measured at the joint that are taken from its other side, each with what is read instead.
        option: the same in words; several options share a name.
    """

    kind: str
    name: str
    target: str
    block: str
    unit: str = ""
    size: float = 1.0
    sliding: bool = False
    torque: float = 1.0
    speed: float = 1.0
    angle: float = 1.0
    inertia: float = 1.0
    beside: tuple[str, ...] = ()
    read_at: tuple[tuple[str, str], ...] = ()
    option: str = ""


def node(system: System, flange: str) -> tuple[str, ...]:
    """The flanges that are connected to a flange, with it."""
    return next((c.ends for c in system.connections if flange in c.ends), (flange,))


def slides(system: System, flange: str) -> bool:
    """Whether a flange is of the translational kind."""
    block, port = system.split(flange)
    return system.blocks[block].ports[port].kind == TRANSLATIONAL


def imposing_effort(system: System, flange: str) -> str:
    """The signal of the effort that imposes the motion of a flange; empty if none does."""
    for end in node(system, flange):
        block, port = system.split(end)
        if port in system.blocks[block].imposes_motion:
            return f"{block}.{'force' if slides(system, end) else 'torque'}"
    return ""


def can_be_cut(system: System, flange: str) -> bool:
    """Whether a flange hands on the motion of a drive to something that it is connected to."""
    block, port = system.split(flange)
    return port in system.blocks[block].cut_after and len(node(system, flange)) > 1


def splits(system: System, flanges: Sequence[str]) -> Iterator[tuple[list[str], list[str]]]:
    """Every way to cut a node in two, the drive's side first, and on each side first the flange that stands for it.

    Args:
        system: whose node it is.
        flanges: the node's.
    """
    drives = [end for end in flanges if can_be_cut(system, end)]
    first = (drives or list(flanges))[0]
    others = [end for end in flanges if end != first]
    for count in range(len(others)):
        for beside in itertools.combinations(others, count):
            yield [first, *beside], [end for end in others if end not in beside]


def sides(measured: Sequence[str], inner: Sequence[str], outer: Sequence[str]) -> Iterator[tuple[tuple[str, str], ...]]:
    """Every way to read what is measured at a cut node from one side or the other; as it is mapped first.

    Args:
        measured: signals.
        inner: flanges of one side.
        outer: flanges of the other.
    """
    choices = []
    for signal in measured:
        flange, _, quantity = signal.rpartition(".")
        if quantity in QUANTITIES and flange in (*inner, *outer):
            other = outer[0] if flange in inner else inner[0]
            choices.append([None, (signal, f"{other}.{quantity}")])
    for chosen in itertools.product(*choices):
        yield tuple(change for change in chosen if change is not None)


def groups(problem: Problem) -> dict[str, list[str]]:
    """Flanges that move in proportion: the first of each group, and all of its members.

    A flange that is held is in none, unless something imposes its motion.
    """
    system, transform = problem.scenario.system, _transform(problem)
    found: dict[str, list[str]] = {}
    for flange, row in problem.model.motions.items():
        held = not np.abs(transform[row]).any()
        if held and not imposing_effort(system, flange):
            continue
        kind = slides(system, flange)
        home = next(
            (g for g in found if slides(system, g) == kind and _together(problem, transform, g, flange, held)), None
        )
        found.setdefault(home or flange, []).append(flange)
    return found


def ratio(problem: Problem, one: str, other: str) -> float:
    """How far ``other`` moves while ``one`` moves by one; 1 where one of them is held or moved from outside."""
    transform, motions = _transform(problem), problem.model.motions
    a, b = (float(np.linalg.norm(transform[motions[flange]])) for flange in (one, other))
    return b / a if a > 0 and b > 0 else 1.0


def _transform(problem: Problem) -> Array:
    """How the motions follow from the coordinates, shape (motions, coordinates)."""
    return np.array(problem.model.functions["transform"](problem.model.parameter_values).full())


def _together(problem: Problem, transform: Array, one: str, other: str, held: bool) -> bool:
    """Whether two flanges move in proportion; imposed motions do where they are one node."""
    a, b = transform[problem.model.motions[one]], transform[problem.model.motions[other]]
    if held or not np.abs(a).any():
        return other in node(problem.scenario.system, one)
    return bool(abs(a @ b) > (1 - 1e-9) * np.linalg.norm(a) * np.linalg.norm(b))
