"""What a plant declares: parameters, sensors, places, excitation, and how its mechanism is put together."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from benchmarks.concealed.mechanism import Mechanism, Port, Readout

JointLaw = Callable[[Mechanism, Port, float, float], None]
"""Stamps what joins two sides of a place, given its relative port and the nominal stiffness and damping (or 0, 0)."""


@dataclass(frozen=True)
class Quantity:
    """A parameter of the nominal scenario.

    Attributes:
        name: ``block.key``.
        value: nominal, SI.
        unit: as the scenario spells it.
        tolerance: share by which a fit may move it, as the block declares it.
        spread: the truth differs by up to this share.
        ceiling: greatest value that has a meaning.
    """

    name: str
    value: float
    unit: str
    tolerance: float
    spread: float = 0.10
    ceiling: float = math.inf


@dataclass(frozen=True)
class Sensor:
    """A measured signal.

    Attributes:
        signal: its name in the scenario.
        column: in the CSV file.
        unit: of the column.
        noise: standard deviation (SI); for an encoder the quantum / sqrt(12).
        counts: per revolution, 0 if it does not count.
        extra: recorded only when asked for.
        at: flange on which it truly sits, where the scenario reads it at another of the same rigid node.
        step: of a linear scale (m), 0 if it has none.
    """

    signal: str
    column: str
    unit: str
    noise: float = 0.0
    counts: int = 0
    extra: bool = False
    at: str = ""
    step: float = 0.0

    @property
    def quantum(self) -> float:
        """Angle (rad) of one count or length (m) of one step, 0 if it has none."""
        return 2 * math.pi / self.counts if self.counts else self.step

    @property
    def sigma(self) -> float:
        """Noise floor (SI)."""
        return self.quantum / math.sqrt(12) if self.quantum else self.noise


@dataclass(frozen=True)
class Excitation:
    """Sizes and times of the plant's test signals.

    Attributes:
        amplitude: of the command, in ``unit``.
        dwell: shortest and longest hold of a step (s).
        low, high: chirp frequencies (Hz).
        clock: shortest pulse of a random binary sequence (s).
        resolution: of the logged command.
        reach: largest reading of the first sensor (SI); commands that lead further are made smaller.
    """

    amplitude: float
    dwell: tuple[float, float]
    low: float
    high: float
    clock: float
    resolution: float
    reach: float = math.inf


@dataclass(frozen=True)
class Control:
    """A loop for closed-loop recordings: gains on one sensor, size of the reference in the sensor's SI unit."""

    sensor: str
    kp: float
    ki: float
    kd: float
    reference: float
    limit: float


@dataclass(frozen=True)
class LinkOptions:
    """What may be concealed in a flexible link."""

    modes: int = 1
    payload: float = 0.0
    centrifugal: bool = False


@dataclass
class Body:
    """A plant put together.

    Attributes:
        mechanism: coordinates, masses, springs.
        ports: flanges by their name in the scenario.
        signals: measured signals by their name in the scenario.
        meshes: of elastic gears by their name, the input and the twist: angle in / ratio - angle out.
    """

    mechanism: Mechanism
    ports: dict[str, Port]
    signals: dict[str, Readout]
    meshes: dict[str, tuple[Port, Port]] = field(default_factory=dict)


@dataclass(frozen=True)
class Sites:
    """Where the effects of a plant may be concealed, each by its name in the block diagram.

    Attributes:
        input: the drive.
        shafts: groups of flanges that move together; the first name stands for the group.
        joints: rigid connections that may hide a compliance or a play.
        springs: blocks that are springs.
        links: blocks that are flexible links.
        sensors: effect -> signals.
        extra: effect -> places, where it differs from all of its kind; an empty list leaves the effect out.
        same: place -> its other names, where they do not follow from the place itself.
    """

    input: str
    shafts: tuple[tuple[str, ...], ...]
    joints: tuple[str, ...] = ()
    springs: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    sensors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    same: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Habits:
    """How a plant is recorded, where that differs from the four plants of the first proof.

    Attributes:
        training: recordings to train on; 0 for half of them.
        jitter: largest error of a time stamp, as a share of the sample interval.
        preload: largest twist (rad or m) from which half of the recordings begin; 0 if all begin slack.
        free: states that the scenario leaves free where a recording begins twisted.
        hidden: largest share of the concealed effect that the background may leave; 0 for the usual background, which
            goes by the noise floor.
    """

    training: int = 0
    jitter: float = 0.0
    preload: float = 0.0
    free: tuple[str, ...] = ()
    hidden: float = 0.0


FAST = frozenset({"motor.shaft", "rotor.shaft", "drive.shaft", "gear.input"})
"""Flanges before the gear of the four plants; the others are behind it."""


class Plant(ABC):
    """A plant: nominal parameters and their meaning, as a mechanism and as a scenario.

    The four plants of the first proof are classes; a random rig is an instance that brings all of this with it.
    """

    name: str
    title: str
    drive: str
    drive_unit: str
    parameters: tuple[Quantity, ...]
    fixed: Mapping[str, float] = MappingProxyType({})
    sensors: tuple[Sensor, ...]
    sites: Sites
    excitation: Excitation
    control: Control
    orders: tuple[int, ...] = (1, 2, 3)
    """Waves per revolution of a concealed torque ripple."""
    swings: bool = False
    """Whether it swings back when let go, so that a free decay makes sense."""
    main: str
    """The shaft on which small background disturbances act."""
    inductance: float = 0.0
    """Winding inductance (H) that half of the cases carry unnoticed; 0 for plants without a winding."""
    habits: Habits = Habits()
    blocks: str
    """The blocks and connections of the nominal scenario; ``{block.key}`` stands for a parameter."""

    @abstractmethod
    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """The plant as a mechanism.

        Args:
            p: parameters, SI.
            laws: place -> what joins its two sides there, in place of a rigid or plain elastic connection.
            link: what is concealed in the link.
            inductance: of the winding (H).
        """

    def ratio(self, place: str) -> float:
        """How far a flange moves while those behind all gears on its shaft move by one."""
        return self.fixed.get("gear.ratio", 1.0) if place in FAST else 1.0

    def lossy(self, one: str, other: str) -> bool:
        """Whether power is lost between two flanges of one shaft."""
        return "gear.efficiency" in self.nominal() and self.ratio(one) != self.ratio(other)

    def nominal(self) -> dict[str, float]:
        """Nominal parameters, SI."""
        return {q.name: q.value for q in self.parameters}

    def sensor(self, signal: str) -> Sensor:
        """A sensor by its signal or column.

        Raises:
            KeyError: there is none.
        """
        for s in self.sensors:
            if signal in (s.signal, s.column):
                return s
        raise KeyError(f"{self.name} has no sensor '{signal}'; it has {', '.join(s.column for s in self.sensors)}")


def plain_spring(mechanism: Mechanism, port: Port, stiffness: float, damping: float) -> None:
    """The law of a spring that conceals nothing."""
    mechanism.spring(port, stiffness, damping)
