"""Simulated periods of a model under a sine, and the linear algebra of Newton's method on them."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from diagnosis.frequency_response.extremes import extremes
from engine import interpret, native
from engine.casadi_lock import symbolic_property
from engine.errors import CompilerUnavailable, SimulationError
from engine.model import Model, Vector
from engine.native import Job, Outcome
from engine.simulate import explain, prepare
from engine.start import start_values

Array = Any

LOG_CAPACITY = 4_000
"""Largest number of switches of a run whose instants are kept."""

ASIDE = 1e-6
"""Distance from a switch, as a fraction of a step, at which outputs that jump there are read."""

DIFFERENCE = 1e-4
"""Difference of a state for derivatives, as a fraction of its span over the period."""

ZERO = 1e-9
"""Singular values and matrix entries below this are zero (rows are of unit length)."""


@dataclass
class PeriodicSolution:
    """The periodic response of a model to a sine.

    Attributes:
        amplitudes: half the peak to peak of each output over a period, shape (outputs,).
        rms: root mean square of each output about its mean, shape (outputs,).
        x: state at the beginning of the period; None for the closed form.
        inverse: of I - dP/dx, for the relevant combinations of states in units of ``span``; P maps a state over a
            period.
        span: range of each relevant combination of states over the period.
        settled: whether the response is periodic.
        run: starting point for neighbours; None for the closed form, or where Newton's method did not converge.
    """

    amplitudes: Vector
    rms: Vector
    x: Vector | None = None
    inverse: Array = None
    span: Array = None
    settled: bool = True
    run: PeriodRun | None = None


@dataclass
class PeriodRun:
    """A simulated period from which neighbours begin.

    Attributes:
        p, step, rows: parameters, integration step (s) and number of steps.
        begin, x: row of the period at which neighbours begin, and the state there.
        lead: rows after which the starting state is forgotten; 0 if the period was solved for.
        windows: for each output, for its highest and its lowest value: the row, and the state ``lead`` rows before.
    """

    p: Vector
    step: float
    rows: int
    begin: int
    x: Vector
    lead: int = 0
    windows: tuple[tuple[tuple[int, Vector], tuple[int, Vector]], ...] = ()


class PeriodSimulator:
    """Simulates periods of a model, and reads extremes, spans and derivatives from them.

    Args:
        model: with the sine on its input.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    @symbolic_property
    def relevant(self) -> Array:
        """The combinations of states that matter, shape (combinations, states): a twist, but not a common rotation.

        Derivatives, guards and outputs depend on no other; the response may drift along the others.
        """
        e = self.model.equations
        n = len(self.model.states)
        if not n:
            return np.zeros((0, 0))
        slope = ca.Function("slope", e.arguments, [ca.jacobian(ca.vertcat(e.derivative, e.guards, e.outputs), e.x)])
        random, rows = np.random.default_rng(1), []
        for _ in range(6):
            x, m = random.normal(0, 1, n), random.choice([-1.0, 0.0, 1.0], len(self.model.modes))
            J = slope(0.1, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), m, self.model.parameter_values).full()
            size = np.linalg.norm(J, axis=1)
            rows.append(J[size > 0] / size[size > 0, None])
        return row_echelon(scipy.linalg.orth(np.vstack([*rows, np.zeros((1, n))]).T, rcond=ZERO).T)

    def job(self, p: Vector, x: Vector | None, step: float, rows: int, begin: int = 0) -> Job:
        """A run of ``rows`` steps of ``step`` seconds from state ``x`` (None: the model's start) at row ``begin``."""
        times = self._pattern.timetable.ticking(step, rows)
        job = replace(self._pattern, p=p, hmax=step, timetable=times, t0=begin * step)
        return replace(job, x0=start_values(self.model, p) if x is None else x)

    @functools.cached_property
    def _pattern(self) -> Job:
        return replace(
            prepare(self.model, 1.0, 1.0, internal_step=1.0),
            record_states=True,
            log_capacity=LOG_CAPACITY,
        )

    def run(self, job: Job) -> Outcome:
        """Simulate one job.

        Raises:
            SimulationError: the simulation failed or diverged.
        """
        try:
            found = native.run(self.model, job)
        except CompilerUnavailable:
            found = interpret.run(self.model, job)
        if found.status:
            raise SimulationError(explain(self.model, found))
        if not np.isfinite(found.y).all():
            raise SimulationError("the simulation diverged")
        return found

    def half_range(self, job: Job, found: Outcome, first: int = 0, last: int | None = None) -> Vector:
        """Half the peak to peak of each output over a period of a run, from row ``first`` to row ``last``."""
        high, low, _ = self.extremes(job, found, first, last)
        return np.asarray((high - low) / 2)

    def extremes(
        self, job: Job, found: Outcome, first: int = 0, last: int | None = None, repeats: bool = True
    ) -> tuple[Vector, Vector, Array]:
        """The extremes of each output in rows ``first`` to ``last``, and their rows, counted from ``first``."""

        def at(position: float) -> Array:
            assert found.states is not None
            assert found.modes is not None
            row, part = divmod(position + first, 1.0)
            near = replace(job, x0=found.states[int(row)], m0=found.modes[int(row)], record_states=False)
            near = replace(near, t0=job.t0 + row * job.resolution, log_capacity=0)
            sides = (part - ASIDE, part + ASIDE) if self.jumps else (part,)
            times = [job.timetable.ticking(side * job.resolution, 1) for side in sides if side > ASIDE]
            runs = [self.run(replace(near, timetable=one)) for one in times]
            return np.array([found.y[int(row)], *(run.y[1] for run in runs)])

        last = len(found.y) - 1 if last is None else last
        return extremes(found.y[first : last + 1], switches(job, found) - first, at, repeats)

    @symbolic_property
    def jumps(self) -> bool:
        """Whether outputs depend on the modes, and so jump at switches."""
        e = self.model.equations
        return bool(ca.depends_on(e.outputs, e.m))

    def spans(self, found: Outcome) -> Vector:
        """Range of each relevant combination of states over a run, from about a thousand of its rows; never zero."""
        assert found.states is not None
        span = np.ptp(found.states[:: 1 + len(found.states) // 1000] @ self.relevant.T, axis=0)
        return np.where(span > 0, span, max(float(span.max(initial=0.0)), 1e-12) * 1e-3)

    def inverse(self, p: Vector, x: Vector, step: float, rows: int, x1: Vector, span: Vector) -> Array:
        """Inverse of I - dP/dx, for the relevant combinations of states in units of ``span``, by differences."""
        Q, h = self.relevant, DIFFERENCE
        back, columns = np.linalg.pinv(Q), []
        for k in range(len(Q)):
            there = self.run(self.job(p, x + h * span[k] * back[:, k], step, rows)).x1
            columns.append(Q @ (there - x1) / span / h)
        matrix = np.eye(len(Q)) - np.column_stack(columns) if columns else np.zeros((0, 0))
        return np.linalg.pinv(matrix, rcond=1e-9)


def switches(job: Job, found: Outcome) -> Vector:
    """Positions (fractional rows) at which the modes changed in a run, other than at its start."""
    rows = (found.log[:, 0] - job.t0) / job.resolution
    return np.asarray(rows[rows > 1e-6])


def row_echelon(rows: Array) -> Array:
    """The reduced row echelon form of independent rows, shape (rows, columns)."""
    ranks = [np.linalg.matrix_rank(rows[:, :count], tol=ZERO) for count in range(rows.shape[1] + 1)]
    pivots = np.flatnonzero(np.diff(ranks))
    found = np.linalg.solve(rows[:, pivots], rows)
    found[np.abs(found) < ZERO] = 0.0
    return found


def broyden_update(inverse: Array, moved: Vector, change: Vector) -> Array:
    """The inverse Jacobian after a move by ``moved`` that reduced the gap by ``change`` (Broyden 1965, his first)."""
    along = moved @ inverse
    below = float(along @ change)
    if abs(below) < 1e-12 * float(np.linalg.norm(along) * np.linalg.norm(change) + 1e-300):
        return inverse
    return inverse + np.outer(moved - inverse @ change, along) / below
