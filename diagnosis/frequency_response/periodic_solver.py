"""The periodic response of a model to a sine: in closed form while nothing switches, else by Newton's method.

Newton's method solves x = P(x) for the state that repeats after one period; P maps a state over a period. Its
derivative is taken by differences and kept while parameters change a little. States along which the model is the same
everywhere (the common rotation of a shaft) are left out.

A simulation from rest would have to wait until every slow mode has died out. It is the fallback where Newton's method
does not converge, or cannot be used: where anything but the sine depends on time, and where clocks tick, for then a
run does not go on from its states alone.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from diagnosis.frequency_response.closed_form import ClosedForm
from diagnosis.frequency_response.extremes import half_range, quiet_row
from diagnosis.frequency_response.period import (
    DIFFERENCE,
    ZERO,
    PeriodicSolution,
    PeriodRun,
    PeriodSimulator,
    broyden_update,
    switches,
)
from diagnosis.frequency_response.sine_model import SineModel, settling_time
from engine.casadi_lock import symbolic_property
from engine.model import SWITCH, TIME, Model, Vector
from engine.native import Outcome
from engine.simulate import simulate
from engine.start import start_values
from engine.step import fastest

Array = Any

POINTS, POINTS_AT_CONTACTS = 200, 1500
"""Smallest number of steps per period; the second where contacts switch, for speeds then peak sharply between steps."""

STEP_PER_RATE, STEP_PER_RATE_WHEN_SLOW = 0.7, 1.4
"""Longest step times the fastest rate of the model; the second for periods in which that mode has long died out."""

MOST_STEPS = 600_000
"""Largest number of steps per period; a model whose fastest mode needs more diverges."""

SLOW = 6.0
"""A start is forgotten after this many time constants of the slowest mode; longer periods are simulated, not solved."""

FORGOTTEN = 0.05
"""Largest distance of a start from the periodic state, as a fraction of each span, for which `SLOW` holds."""

CLOSE = 1e-5
"""Newton's method stops when its next step is shorter than this fraction of each combination's span."""

TURNS = 24
"""Largest number of Newton steps."""

AWAY = 0.01
"""Largest shift of an extreme from a period to its neighbour, as a fraction of the period, for a first-order step."""

SETTLED = 2e-4
"""Relative change of the amplitudes between two looks below which a response counts as periodic."""

PATIENCE = 100_000
"""Largest number of steps between two looks at a response that settles."""

RUNS = 4
"""Number of looks at a response that settles."""

CLOCKED_STEPS = 8_000_000
"""Largest number of steps of a run with clocks, whose beginning is simulated again for every look."""

CLOCKED_SWITCHES = 1_000_000
"""Largest number of switches of a run with clocks whose instants are kept."""


@functools.cache
def rows_pool() -> ThreadPoolExecutor:
    """Threads for the rows of tables, one per core, shared by all fits."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="row")


class PeriodicSolver:
    """Finds periodic responses of one model.

    Args:
        plain: the model with the driven input open.
        driven: the same with a sine on that input.
        largest_step: upper bound of the integration step (s), or None.
    """

    def __init__(self, plain: Model, driven: SineModel, largest_step: float | None = None) -> None:
        self.plain, self.driven, self.largest_step = plain, driven, largest_step
        self.model, self.periods = driven.model, PeriodSimulator(driven.model)
        self.closed_form = ClosedForm(plain)
        self.sharp = self.model.count(SWITCH) > 0

    def solve(
        self,
        parameters: dict[str, float],
        frequency: Vector,
        amplitude: Vector,
        near: Mapping[int, PeriodicSolution],
        progress: Callable[[float], None] | None = None,
    ) -> list[PeriodicSolution]:
        """The periodic responses to sines, found side by side on all cores.

        Args:
            parameters: values that replace the model's (SI).
            frequency: rad/s, shape (rows,).
            amplitude: of the sines (SI), shape (rows,).
            near: by row, responses at neighbouring parameters, from which the search starts.
            progress: called with the fraction of the rows that are found, from 0 to 1.

        Raises:
            SimulationError: the model is unstable or resonates without damping, or the simulation diverged.
        """
        found: list[PeriodicSolution | None] = self.closed_form.solve(parameters, frequency, amplitude)
        left = [k for k, solution in enumerate(found) if solution is None]
        p = self.model.parameter_vector(parameters)
        # Quantised, so that neighbouring parameters share their grid and differences between them are smooth.
        rate = fastest(self.model, p, start_values(self.model, p)).rate if left else 0.0
        rate = 2.0 ** (math.ceil(2 * math.log2(max(rate, 1e-6))) / 2)
        settle = settling_time(self.model, p, SLOW) if left else 0.0
        near = {k: solution for k, solution in near.items() if solution.x is not None}
        jobs = {
            k: rows_pool().submit(
                self._simulated, p, rate, settle, float(frequency[k]), float(amplitude[k]), near.get(k)
            )
            for k in left
        }
        solutions = []
        try:
            for k, solution in enumerate(found):
                solutions.append(jobs[k].result() if solution is None else solution)
                if progress is not None:
                    progress(len(solutions) / len(found))
        except BaseException:
            for job in jobs.values():
                job.cancel()
            raise
        return solutions

    def near(
        self,
        parameters: Sequence[dict[str, float]],
        base: Sequence[PeriodicSolution],
        frequency: Vector,
        amplitude: Vector,
    ) -> Array:
        """Amplitudes at neighbouring parameters, to first order: one or two simulated periods each, no Newton steps.

        Args:
            parameters: for each neighbour, values that replace the model's (SI).
            base: the responses whose neighbours they are.
            frequency: rad/s, shape (rows,).
            amplitude: of the sines (SI), shape (rows,).

        Returns:
            Shape (neighbours, rows, outputs).

        Raises:
            SimulationError: a simulation diverged.
        """
        count = len(parameters)
        found = np.zeros((count, len(base), len(self.model.outputs)))
        whole = [k for k, solution in enumerate(base) if solution.run is None]
        for i, values in enumerate(parameters if whole else ()):
            starts = {j: base[k] for j, k in enumerate(whole)}
            for j, solution in enumerate(self.solve(values, frequency[whole], amplitude[whole], starts)):
                found[i, whole[j]] = solution.amplitudes
        vectors = [self.model.parameter_vector(values) for values in parameters]
        rest = [k for k, solution in enumerate(base) if solution.run is not None]
        jobs = [
            (k, rows_pool().submit(self._neighbours, vectors, base[k], float(frequency[k]), float(amplitude[k])))
            for k in rest
        ]
        try:
            for k, job in jobs:
                found[:, k] = job.result()
        except BaseException:
            for _, job in jobs:
                job.cancel()
            raise
        return found

    def _neighbours(
        self, vectors: Sequence[Vector], base: PeriodicSolution, frequency: float, amplitude: float
    ) -> Array:
        """Amplitudes of one row at neighbouring parameters, shape (neighbours, outputs).

        A neighbour's run from the same state does not repeat; the derivative of its end corrects the amplitudes. It is
        run again from the corrected state if its switches or extremes lie elsewhere.
        """
        run = base.run
        assert run is not None
        driven = [self._with_sine(p, frequency, amplitude) for p in vectors]
        if run.lead:
            assert base.x is not None
            return np.array([self._forgetful(p, base.x, run) for p in driven])

        def passed(p: Vector, x: Vector) -> tuple[Vector, Vector, Array, Array]:
            """Amplitudes, state at the end, rows of the extremes, and the switches."""
            job = self.periods.job(p, x, run.step, run.rows, run.begin)
            found = self.periods.run(job)
            high, low, places = self.periods.extremes(job, found)
            return (high - low) / 2, Q @ found.x1 / spread, places, found.log[:, 1:]

        Q, h, spread = self.periods.relevant, DIFFERENCE, base.span
        back = np.linalg.pinv(Q)
        first, end, places, order = passed(run.p, run.x)
        gaps, pull = [], []
        for k in range(len(Q)):
            amplitudes, there, *_ = passed(run.p, run.x + h * spread[k] * back[:, k])
            gaps.append((there - end) / h)
            pull.append((amplitudes - first) / h)
        inverse = np.linalg.pinv(np.eye(len(Q)) - np.column_stack(gaps), rcond=ZERO) if len(Q) else np.zeros((0, 0))
        rows = []
        for p in driven:
            amplitudes, there, tops, switched = passed(p, run.x)
            move = inverse @ (there - end)
            change = amplitudes - first + (np.array(pull).T @ move if len(Q) else 0.0)
            if not np.array_equal(switched, order) or np.abs(tops - places).max(initial=0) > AWAY * run.rows:
                change = passed(p, run.x + back @ (spread * move))[0] - first
            rows.append(base.amplitudes + change)
        return np.array(rows)

    def _forgetful(self, p: Vector, x: Vector, run: PeriodRun) -> Vector:
        """Amplitudes where the start is soon forgotten: only the neighbourhoods of the extremes are simulated."""
        width = 16
        if 2 * len(run.windows) * (run.lead + 2 * width) >= run.rows + run.lead:
            job = self.periods.job(p, x, run.step, run.rows + run.lead)
            return self.periods.half_range(job, self.periods.run(job), run.lead)
        rows = []
        for k, ends in enumerate(run.windows):
            values = []
            for (row, state), side in zip(ends, (0, 1), strict=True):
                job = self.periods.job(p, state, run.step, run.lead + width, row - run.lead)
                found = self.periods.run(job)
                values.append(self.periods.extremes(job, found, max(run.lead - width, 0), repeats=False)[side][k])
            rows.append((values[0] - values[1]) / 2)
        return np.array(rows)

    def _with_sine(self, p: Vector, frequency: float, amplitude: float) -> Vector:
        """Parameters with the frequency (rad/s) and amplitude of the sine."""
        sine, p = self.driven.sine, p.copy()
        p[self.model.parameter_index(f"{sine}.amplitude")] = amplitude
        p[self.model.parameter_index(f"{sine}.frequency")] = frequency / (2 * math.pi)
        return p

    @symbolic_property
    def _timed(self) -> bool:
        """Whether the model depends on time other than through the sine."""
        e = self.plain.equations
        return self.plain.count(TIME) > 0 or bool(
            ca.depends_on(ca.vertcat(e.derivative, e.guards, e.outputs, e.imposed), e.t)
        )

    def _simulated(
        self, p: Vector, rate: float, settle: float, frequency: float, amplitude: float, near: PeriodicSolution | None
    ) -> PeriodicSolution:
        period, p = 2 * math.pi / frequency, self._with_sine(p, frequency, amplitude)
        slow = period >= settle
        longest = period / (POINTS_AT_CONTACTS if self.sharp else POINTS)
        longest = min(longest, (STEP_PER_RATE_WHEN_SLOW if slow else STEP_PER_RATE) / rate)
        longest = max(min(longest, self.largest_step or math.inf), period / MOST_STEPS)
        rows = math.ceil(period / longest - 1e-9)
        step = period / rows
        if self.model.clocks:
            return self._let_settle(self._restarted(p, period, longest, settle))
        if self._timed:
            start = start_values(self.model, p)
            return self._let_settle(self._continued(p, start, step, rows, settle))
        x = near.x if near is not None else None
        if slow:
            return self._slow(p, x, step, rows, math.ceil(settle / step) + 1)
        return self._newton(p, x, step, rows, settle, near)

    def _slow(self, p: Vector, x: Vector | None, step: float, rows: int, lead: int) -> PeriodicSolution:
        """A period longer than the model's memory: simulate it, and read it after the start is forgotten."""
        Q = self.periods.relevant
        for _ in range(6):
            job = self.periods.job(p, x, step, rows + lead)
            found = self.periods.run(job)
            assert found.states is not None
            x = found.states[rows]
            away = float((np.abs(Q @ (x - found.states[0])) / self.periods.spans(found)).max(initial=0.0))
            first = self.periods.half_range(job, found, 0, rows)
            high, low, ends = self.periods.extremes(job, found, lead)
            last = (high - low) / 2
            made = PeriodicSolution(last, found.y[lead + 1 :].std(axis=0), x)
            places = tuple(((lead + a, found.states[a]), (lead + b, found.states[b])) for a, b in ends.T.tolist())
            made.run = PeriodRun(p, step, rows, 0, x, lead, places)
            if away < FORGOTTEN and np.all(np.abs(last - first) <= 0.02 * last):
                return made
        made.settled = False
        return made

    def _newton(
        self, p: Vector, x: Vector | None, step: float, rows: int, settle: float, near: PeriodicSolution | None
    ) -> PeriodicSolution:
        """Newton's method from the state ``x``, or from the end of the first period if it is None."""
        inverse, span = (near.inverse, near.span) if near is not None and x is not None else (None, None)
        if x is None:
            x = self.periods.run(self.periods.job(p, None, step, rows)).x1
        Q, last = self.periods.relevant, math.inf
        back = np.linalg.pinv(Q)
        previous: tuple[Vector, Vector] | None = None
        for _ in range(TURNS):
            job = self.periods.job(p, x, step, rows)
            found = self.periods.run(job)
            if inverse is None or span is None:
                span = self.periods.spans(found)
                inverse = self.periods.inverse(p, x, step, rows, found.x1, span)
                previous = None
            gap = Q @ (found.x1 - x) / span
            if previous is not None:
                inverse = broyden_update(inverse, previous[0], previous[1] - gap)
            move = inverse @ gap
            size = float(np.abs(move).max(initial=0.0))
            if size < CLOSE:
                assert found.states is not None
                begin = quiet_row(found.y, switches(job, found))
                run = PeriodRun(p, step, rows, begin, found.states[begin])
                return PeriodicSolution(
                    self.periods.half_range(job, found), found.y[1:].std(axis=0), x, inverse, span, run=run
                )
            if size > 4 * last:
                break
            if size > 1.0:
                move *= 1.0 / size
            last, previous = min(size, last), (move, gap)
            x = x + back @ (span * move)
        return self._let_settle(self._continued(p, x, step, rows, settle))

    def _let_settle(self, looks: Iterator[PeriodicSolution]) -> PeriodicSolution:
        """The first look at a simulated response that equals the one before; the last one, unsettled, if none does."""
        before = next(looks)
        for made in looks:
            if np.all(np.abs(made.amplitudes - before.amplitudes) <= SETTLED * made.amplitudes):
                return made
            before = made
        before.settled = False
        return before

    def _continued(self, p: Vector, x: Vector, step: float, rows: int, settle: float) -> Iterator[PeriodicSolution]:
        """The last periods of several runs, each of which goes on from the one before."""
        cycles = max(2, min(math.ceil(settle / (step * rows)), PATIENCE // rows))
        wait, begin = (cycles - 1) * rows, 0
        last: Outcome | None = None
        for _ in range(RUNS):
            job = replace(self.periods.job(p, x, step, wait, begin), record_states=False, log_capacity=0)
            waited = self.periods.run(job if last is None else replace(job, d0=last.d1, m0=last.m1))
            job = self.periods.job(p, waited.x1, step, rows, begin + wait)
            last = found = self.periods.run(replace(job, d0=waited.d1, m0=waited.m1))
            x, begin = found.x1, begin + cycles * rows
            yield PeriodicSolution(self.periods.half_range(job, found), found.y[1:].std(axis=0), x)

    def _restarted(self, p: Vector, period: float, longest: float, settle: float) -> Iterator[PeriodicSolution]:
        """The last period at half the length of a run with clocks, at its end, and at the end of ever longer runs."""
        tick = min(clock.period for clock in self.model.clocks)
        step = tick / max(1, math.ceil(tick / longest))
        per_period = math.ceil(period / step - 1e-9)
        values = {q.name: float(v) for q, v in zip(self.model.parameters, p, strict=True)}
        rows = math.ceil(max(2, 2 * math.ceil(settle / period)) * period / step)
        capacity = CLOCKED_SWITCHES if self.model.modes else 0
        ends = [rows // 2, rows]
        while True:
            run = simulate(
                self.model,
                rows * step,
                step,
                parameters=values,
                internal_step=min(longest, step),
                log_capacity=capacity,
            )
            switched = np.array([time for time, _, _ in run.events]) / step
            for end in ends:
                begin = max(0, end - per_period)
                y = run.values[begin : end + 1]
                yield PeriodicSolution(half_range(y, switched - begin), y[1:].std(axis=0))
            rows, ends = 2 * rows, [2 * rows]
            if rows > CLOCKED_STEPS:
                return
