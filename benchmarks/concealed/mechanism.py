"""Masses, springs, gears and what is not linear about them, as the matrices and elements of the C simulator.

A port says how a place moves, ``sense`` (its angle is a combination of coordinates), and how a torque there acts,
``act`` (on which coordinates). They differ where a gear loses power: act is then eta times sense.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from benchmarks.concealed import native

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Port:
    """A place: its angle as a combination of coordinates, and where a torque on it goes."""

    sense: Mapping[int, float]
    act: Mapping[int, float]

    def geared(self, ratio: float, efficiency: float = 1.0) -> Port:
        """The place that turns ``ratio`` times as fast, before a gear with losses."""
        return Port(
            {i: ratio * c for i, c in self.sense.items()}, {i: efficiency * ratio * c for i, c in self.act.items()}
        )

    def against(self, other: Port) -> Port:
        """This place relative to another: what acts here acts there with the opposite sign."""
        return Port(_minus(self.sense, other.sense), _minus(self.act, other.act))


def _minus(a: Mapping[int, float], b: Mapping[int, float]) -> dict[int, float]:
    return {i: a.get(i, 0.0) - b.get(i, 0.0) for i in {*a, *b}}


@dataclass
class Element:
    """A law that is not linear, at a port. It resists: the force is -law(e, w), except ripple, vibration and series.

    A ``loaded`` friction grows with the actuator's torque.
    """

    kind: int
    port: Port
    parameters: Sequence[float]
    loaded: bool = False


@dataclass
class Whirl:
    """T = 1/2 w^2 a'H a of a turning bent arm: w the speed of ``hub``, a the ``amplitudes``."""

    hub: Port
    amplitudes: Sequence[Port]
    H: Array


@dataclass
class Readout:
    """A measured quantity: ``order`` 0, 1, 2 for angle, speed, acceleration of a combination of coordinates."""

    sense: Mapping[int, float]
    order: int = 0


@dataclass
class Mechanism:
    """Coordinates with mass, damping and stiffness matrices, further linear states, and elements.

    ``released``: coordinate -> how far it is turned where a recording begins turned by one; None for all alike.
    """

    names: list[str] = field(default_factory=list)
    elements: list[Element] = field(default_factory=list)
    whirl: Whirl | None = None
    released: dict[int, float] | None = None
    _mass: list[tuple[Port, Port, float]] = field(default_factory=list)
    _stiffness: list[tuple[Port, float]] = field(default_factory=list)
    _damping: list[tuple[Port, float]] = field(default_factory=list)
    _extra: list[tuple[Port, float, Port, float]] = field(default_factory=list)
    _actuator: Port | None = None
    _motor: tuple[float, float, float, float] | None = None

    def coordinate(self, name: str) -> Port:
        """A new coordinate."""
        self.names.append(name)
        index = len(self.names) - 1
        return Port({index: 1.0}, {index: 1.0})

    def inertia(self, port: Port, value: float) -> None:
        """An inertia that turns with a port."""
        self._mass.append((port, port, value))

    def couple(self, a: Port, b: Port, value: float) -> None:
        """Equal off-diagonal entries of the mass matrix."""
        self._mass.append((a, b, value))
        self._mass.append((b, a, value))

    def spring(self, port: Port, stiffness: float, damping: float = 0.0) -> None:
        """Spring and damper against the motion of a port, which may be that of one place against another."""
        self._stiffness.append((port, stiffness))
        self._damping.append((port, damping))

    def maxwell(self, port: Port, stiffness: float, rate: float) -> None:
        """A spring in series with a damper: force -k (e - y), y' = rate (e - y)."""
        self._stiffness.append((port, stiffness))
        self._extra.append((port, stiffness, port, rate))

    def torque(self, port: Port) -> None:
        """Let the actuator be an ideal torque at a port."""
        self._actuator = port

    def motor(self, port: Port, resistance: float, inductance: float, torque: float, back_emf: float) -> None:
        """Let the actuator be a voltage on a DC motor at a port."""
        self._actuator, self._motor = port, (resistance, inductance, torque, back_emf)

    def add(self, kind: int, port: Port, *parameters: float, loaded: bool = False) -> None:
        """An element that is not linear."""
        self.elements.append(Element(kind, port, parameters, loaded))

    def mass_matrix(self) -> Array:
        """M, with the rows of lossy gears weighted by their efficiency."""
        M = np.zeros((len(self.names),) * 2)
        for act, sense, value in self._mass:
            M += value * np.outer(self._vector(act.act), self._vector(sense.sense))
        return M

    def _vector(self, direction: Mapping[int, float]) -> Array:
        row = np.zeros(len(self.names))
        for i, c in direction.items():
            row[i] += c
        return row

    def state_space(self) -> tuple[Array, Array]:
        """A and B of x' = A x + B f, x = (q, q', further states), f = (actuator, elements, whirl)."""
        n, extra = len(self.names), len(self._extra)
        current = self._motor is not None and self._motor[1] > 0
        size = 2 * n + extra + current
        columns = 1 + len(self.elements) + (1 + len(self.whirl.amplitudes) if self.whirl else 0)
        K, D = np.zeros((n, n)), np.zeros((n, n))
        for port, k in self._stiffness:
            K += k * np.outer(self._vector(port.act), self._vector(port.sense))
        for port, d in self._damping:
            D += d * np.outer(self._vector(port.act), self._vector(port.sense))
        force, P = np.zeros((n, columns)), np.zeros((n, size - 2 * n))
        for j, element in enumerate(self.elements, 1):
            force[:, j] = self._vector(element.port.act)
        if self.whirl:
            for j, port in enumerate([self.whirl.hub, *self.whirl.amplitudes], 1 + len(self.elements)):
                force[:, j] = self._vector(port.act)
        A, B = np.zeros((size, size)), np.zeros((size, columns))
        for j, (port, k, follows, rate) in enumerate(self._extra):
            P[:, j] = k * self._vector(port.act)
            A[2 * n + j, :n] = rate * self._vector(follows.sense)
            A[2 * n + j, 2 * n + j] = -rate
        if self._actuator is not None:
            act, sense = self._vector(self._actuator.act), self._vector(self._actuator.sense)
            if self._motor is None:
                force[:, 0] = act
            else:
                resistance, inductance, torque, back_emf = self._motor
                if current:
                    P[:, -1] = torque * act
                    A[-1, n : 2 * n] = -back_emf / inductance * sense
                    A[-1, -1] = -resistance / inductance
                    B[-1, 0] = 1 / inductance
                else:
                    force[:, 0] = torque / resistance * act
                    D += torque * back_emf / resistance * np.outer(act, sense)
        inverse = np.linalg.inv(self.mass_matrix())
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ D
        A[n : 2 * n, 2 * n :] = inverse @ P
        B[n : 2 * n] = inverse @ force
        return A, B

    @property
    def carries_current(self) -> bool:
        """Whether the current of a winding with inductance is a state: it is the last one."""
        return self._motor is not None and self._motor[1] > 0

    def turning(self, A: Array, B: Array) -> Array:
        """Row of the speed at which the actuator's shaft turns.

        Raises:
            ValueError: there is no motor with a winding.
        """
        if self._actuator is None or self._motor is None:
            raise ValueError("there is no winding whose current could have a limit")
        return self.readout(Readout(self._actuator.sense, 1), A, B)[0]

    def loads(self, A: Array) -> tuple[Array, Array]:
        """Torque of the actuator, for each element that it loads: rows of the state, and share of the command.

        Raises:
            ValueError: there is no actuator.
        """
        if self._actuator is None:
            raise ValueError("nothing drives, and so nothing loads")
        n, row, feed = len(self.names), np.zeros(len(A)), 1.0
        if self._motor is not None:
            resistance, inductance, torque, back_emf = self._motor
            if inductance > 0:
                row[-1], feed = torque, 0.0
            else:
                row[n : 2 * n], feed = (
                    -torque * back_emf / resistance * self._vector(self._actuator.sense),
                    torque / resistance,
                )
        loaded = np.array([float(element.loaded) for element in self.elements])
        return np.outer(loaded, row), loaded * feed

    def readout(self, sensor: Readout, A: Array, B: Array) -> tuple[Array, Array]:
        """Rows of C and D for a measured quantity."""
        n = len(self.names)
        row, feed = np.zeros(len(A)), np.zeros(B.shape[1])
        vector = self._vector(sensor.sense)
        if sensor.order < 2:
            row[sensor.order * n : (sensor.order + 1) * n] = vector
            return row, feed
        return vector @ A[n : 2 * n], vector @ B[n : 2 * n]

    def rows(self, A: Array, B: Array) -> tuple[Array, Array, NDArray[np.int32], Array]:
        """For each element: rows of its displacement and of its rate, kind, parameters."""
        count = len(self.elements)
        sense, rate = np.zeros((count, len(A))), np.zeros((count, len(A)))
        kind, parameters = np.zeros(count, dtype=np.int32), np.zeros((count, native.WIDTH))
        for j, element in enumerate(self.elements):
            port = Readout(element.port.sense)
            sense[j] = self.readout(port, A, B)[0]
            rate[j] = self.readout(Readout(port.sense, 1), A, B)[0]
            kind[j] = element.kind
            parameters[j, : len(element.parameters)] = element.parameters
        return sense, rate, kind, parameters


def discretise(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """exp(A h) and the integral of exp(A s) B over [0, h]: exact for a force that is held."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    made = expm(block * h)
    return np.ascontiguousarray(made[:n, :n]), np.ascontiguousarray(made[:n, n:])
