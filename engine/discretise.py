"""The discrete-time linear model of a plant with its sampled blocks: exact, with their memories as states."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from engine.errors import ParameterError
from engine.linearise import LinearModel, linearise, operating_point
from engine.model import Equations, Model, Vector
from engine.roundings import jacobian
from engine.simulate import rational

if TYPE_CHECKING:
    import control

_LARGEST = 100_000
_MOST_STATES = 3000


@dataclass(frozen=True, repr=False)
class DiscreteModel(LinearModel):
    """``x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]`` for deviations from a point.

    x[k] holds the continuous states and the memories just before the clocks tick at k dt; u[k] is held until the next
    instant; y[k] is read just after the tick.

    Attributes:
        dt: time between instants (s): the sample period, or that after which several clocks repeat.
        continuous: names of the continuous states; the rest of ``states`` are memories.
        drift: memory name -> change over dt at the point, of the memories that change there.
    """

    dt: float = 0.0
    continuous: tuple[str, ...] = ()
    drift: dict[str, float] = field(default_factory=dict)

    def stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return bool((np.abs(self.poles()) < 1).all())

    @property
    def _kind(self) -> str:
        return f"linear model in discrete time, every {self.dt:g} s"

    def gain(self, frequency: float) -> NDArray[np.complex128]:
        """Frequency response at ``frequency`` (rad/s), shape (outputs, inputs)."""
        z = np.exp(1j * frequency * self.dt)
        inner = np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray(self.C @ inner + self.D, dtype=complex)

    def to_control(self) -> control.StateSpace:
        """The same as a python-control system with its dt; dots in names become underscores."""
        import control

        named = {kind: [n.replace(".", "_") for n in getattr(self, kind)] for kind in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, self.dt, **named)


def discretise(
    model: Model,
    *,
    at: dict[str, float] | None = None,
    inputs: dict[str, float] | None = None,
    modes: dict[str, str] | None = None,
    parameters: dict[str, float] | None = None,
    time: float = 0.0,
) -> DiscreteModel:
    """The discrete-time model at a point; arguments as of `engine.linearise.linearise`.

    Between instants the continuous states follow ``x' = A x + G d + B u`` with memories d and inputs u held, which the
    matrix exponential integrates exactly; at an instant the memories of the clocks that tick are updated at once.
    Roundings, such as an encoder's, count as a gain of 1 (`engine.roundings`).

    Raises:
        ParameterError: the model has no clock, a Python function ticks at one, the clocks never repeat together, or as
            for `linearise`.
    """
    if not model.clocks:
        raise ParameterError("the model has no sampled block", remedy="use its continuous linear model")
    if model.externals:
        raise ParameterError(
            f"'{model.externals[0].name}' is a Python function or a foreign FMU, which has no derivative",
            remedy="linearise the plant without it: name its outputs as inputs",
        )
    settings = {"at": at, "inputs": inputs, "modes": modes, "parameters": parameters}
    plain = linearise(model, **settings, time=time)  # type: ignore[arg-type]
    point = operating_point(model, **settings, time=time)  # type: ignore[arg-type]
    keep, r, n_d = point.kept(model), len(model.inputs), len(model.memories)
    n = len(keep)
    ring = _Ring(model, point.d)
    if n + n_d + len(ring.names) > _MOST_STATES:
        longest = max(((line.size, line.name) for line in model.lines), default=(0, ""))
        raise ParameterError(
            f"the discrete-time model would have {n + n_d + len(ring.names)} states; at most {_MOST_STATES} are worked "
            f"out{f', and {longest[1]!r} alone has {longest[0]}' if longest[0] else ''}",
            remedy="give a longer sample period, or a shorter delay",
        )
    held = model.derived("held", lambda e: [ca.densify(jacobian(f, e.d)) for f in (e.derivative, e.outputs)])
    tick_by = model.derived("tick", lambda e: _tick(e, r), fire=True)
    G, C_d = (np.array(b.full()) for b in held(*point.arguments))
    z = n + n_d + len(ring.names)
    flow = np.zeros((z + r, z + r))
    flow[:n] = np.hstack([plain.A, G[keep], np.zeros((n, len(ring.names))), plain.B])
    drift = point.d.copy()
    period, instants = _instants(model)
    whole = np.eye(z + r)
    first = whole
    begin = Fraction(0)
    for instant, firing in instants:
        whole = scipy.linalg.expm(flow * float(instant - begin)) @ whole
        fire = np.array([*(float(i in firing) for i in range(len(model.clocks))), *ring.read()])
        arguments = (point.t, point.x, point.u, drift, point.m, point.p, fire)
        by_x, by_d, by_u, after = (np.array(b.full()) for b in tick_by(*arguments))
        none = np.zeros((len(by_x), len(ring.names)))
        rows = np.hstack([by_x[:, keep], by_d, none, by_u])
        tick = np.eye(z + r)
        tick[n : n + n_d] = rows[:n_d]
        ring.move(tick, n, firing, rows[n_d:], after.ravel()[n_d:])
        drift, whole, begin = after.ravel()[:n_d], tick @ whole, instant
        if instant == 0:
            first = whole
    whole = scipy.linalg.expm(flow * float(period - begin)) @ whole
    read = np.hstack([plain.C, C_d, np.zeros((len(plain.C), len(ring.names))), plain.D]) @ first
    change = drift - point.d
    names = tuple(memory.name for memory in model.memories)
    return DiscreteModel(
        A=whole[:z, :z],
        B=whole[:z, z:],
        C=read[:, :z],
        D=read[:, z:],
        states=(*plain.states, *names, *ring.names),
        inputs=plain.inputs,
        outputs=plain.outputs,
        units=plain.units | {memory.name: memory.unit for memory in model.memories} | ring.units,
        modes=plain.modes,
        point=plain.point | dict(zip(names, point.d.tolist(), strict=True)) | ring.point,
        rate=plain.rate,
        moving=plain.moving,
        ambiguous=plain.ambiguous,
        rounded=plain.rounded,
        dt=float(period),
        continuous=plain.states,
        drift={name: float(c) for name, c in zip(names, change, strict=True) if abs(c) > 1e-9},
    )


class _Ring:
    """The stages of the delay lines that are no memories of the model, as states behind the memories.

    Attributes:
        names: of these states.
        units: of each.
        point: what each holds at the point: all stages of a line what its last one holds.
    """

    def __init__(self, model: Model, d: Vector) -> None:
        self._lines, self._memories = model.lines, len(model.memories)
        self._values = [np.full(line.size, d[line.memories[-1]]) for line in model.lines]
        self._places: list[dict[int, int]] = []
        self.names: list[str] = []
        self.units: dict[str, str] = {}
        for line in model.lines:
            # What is read at an instant is a memory after it, one stage on.
            places = dict(zip((k + 1 for k in line.stages), line.memories, strict=True))
            for k in range(1, line.size + 1):
                if k not in places:
                    places[k] = self._memories + len(self.names)
                    self.names.append(f"{line.name}{k}")
                    self.units[self.names[-1]] = model.memories[line.memories[-1]].unit
            self._places.append(places)
        self.point = {
            f"{line.name}{k}": float(d[line.memories[-1]])
            for line, places in zip(model.lines, self._places, strict=True)
            for k, place in places.items()
            if place >= self._memories
        }

    def read(self) -> list[float]:
        """What each stage gives at an instant."""
        return [
            float(values[k - 1]) for line, values in zip(self._lines, self._values, strict=True) for k in line.stages
        ]

    def move(
        self, tick: NDArray[np.float64], first: int, firing: set[int], entering: NDArray[np.float64], values: Vector
    ) -> None:
        """Fill in the rows of an instant; memories begin at row ``first``, ``entering`` is what enters each line."""
        for i, (line, places) in enumerate(zip(self._lines, self._places, strict=True)):
            if line.clock not in firing:
                continue
            for k, place in places.items():
                tick[first + place] = 0.0
                if k == 1:
                    tick[first + place] = entering[i]
                else:
                    tick[first + place, first + places[k - 1]] = 1.0
            self._values[i] = np.concatenate([values[i : i + 1], self._values[i][:-1]])


def _instants(model: Model) -> tuple[Fraction, list[tuple[Fraction, set[int]]]]:
    """The time after which all clocks repeat, and the instants in it with the clocks that tick at each."""
    periods = [rational(clock.period) for clock in model.clocks]
    tops, bottoms = [p.numerator for p in periods], [p.denominator for p in periods]
    whole = Fraction(math.lcm(*tops), math.gcd(*bottoms))
    if sum(whole / period for period in periods) > _LARGEST:
        raise ParameterError(
            f"sample periods {[clock.period for clock in model.clocks]} s repeat only after {float(whole):g} s",
            remedy="make them multiples of one another",
        )
    found: dict[Fraction, set[int]] = {}
    for i, (clock, period) in enumerate(zip(model.clocks, periods, strict=True)):
        for k in range(int(whole / period)):
            found.setdefault((rational(clock.offset) + k * period) % whole, set()).add(i)
    return whole, sorted(found.items())


def _tick(e: Equations, r: int) -> list[Any]:
    """What a tick does to memories and what enters delay lines, after its slopes by states, memories and inputs."""
    both = ca.vertcat(e.update, e.entering)
    return [*(ca.densify(jacobian(both, s)) for s in (e.x, e.d, e.u[:r])), both]
