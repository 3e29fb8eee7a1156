"""The periodic answer of a model to a sine: in closed form while nothing switches, else by Newton's method.

A simulation from rest waits until every slow mode has died out. Here the state that repeats after one period is solved
for: x = P(x), P the map over a period, whose derivative is taken by differences and kept while parameters change a
little. States along which the model is the same everywhere (how far a shaft has turned) are left out.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np

from diagnosis.frequency_response.period import PeriodicSolution, PeriodRun, Runs, quiet_row, renewed, switches
from diagnosis.frequency_response.sine_model import SineModel, periodic, settling_time
from engine.errors import SimulationError
from engine.model import FRICTION, SWITCH, Model, Vector
from engine.simulate import simulate
from engine.start import start_values
from engine.step import fastest

Array = Any

POINTS, POINTS_AT_CONTACTS = 200, 1500
"""Steps per period at least; more where contacts switch, for the speeds then peak sharply between steps."""

STEP_PER_RATE, STEP_PER_RATE_WHEN_SLOW = 0.7, 1.4
"""Longest step times the fastest rate of the model; the second for periods in which that mode has long died out."""

MOST_STEPS = 600_000
"""Steps per period at most: where the fastest mode asks for more, it is left to diverge."""

PATIENCE = 100_000
"""Steps of one wait for an answer to settle by itself."""

CLOSE = 1e-5
"""Distance from the periodic state, as a share of what each state spans, at which it counts as reached."""

SLOW = 6.0
"""Time constants of the slowest mode after which a start is forgotten: longer periods need no solving."""

AWAY = 0.01
"""Share of a period by which extremes may lie elsewhere in a neighbour's run; else it is not near and is run again."""

FORGOTTEN = 0.05
"""Distance of a start from the periodic state, in the same measure, of which ``SLOW`` leaves nothing to be seen."""

TURNS = 24
"""Newton steps before the answer is left to settle by itself, over at most so many periods."""

PHASES = 96
"""Instants of a period at which the closed form is checked for switches."""


@functools.cache
def rows_pool() -> ThreadPoolExecutor:
    """Threads for the rows of tables, one for each core, shared by every fit that runs."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="row")


class PeriodicSolver:
    """Periodic answers of one model.

    Args:
        plain: the model with the driven input open.
        driven: the same with a sine on that input.
        largest_step: bound on the integration step (s), or None.
    """

    def __init__(self, plain: Model, driven: SineModel, largest_step: float | None = None) -> None:
        self.plain, self.driven, self.largest_step = plain, driven, largest_step
        self.model, self.runs = driven.model, Runs(driven.model)
        self.sharp = self.model.count(SWITCH) > 0

    def solve(
        self, parameters: dict[str, float], frequency: Vector, amplitude: Vector, near: Mapping[int, PeriodicSolution]
    ) -> list[PeriodicSolution]:
        """The periodic answers to sines, simulated side by side on all cores.

        Args:
            parameters: values that replace the model's (SI).
            frequency: rad/s, shape (rows,).
            amplitude: of the sines (SI), shape (rows,).
            near: by row, answers at neighbouring parameters, to begin from.

        Raises:
            SimulationError: there is none, or the simulation diverged.
        """
        found: list[PeriodicSolution | None] = self._closed(parameters, frequency, amplitude)
        left = [k for k, solution in enumerate(found) if solution is None]
        if not left:
            return [solution for solution in found if solution is not None]
        p = self.model.parameter_vector(parameters)
        # Quantised, so that neighbouring parameters share their grid and differences between them are smooth.
        rate = fastest(self.model, p, start_values(self.model, p)).rate
        near = {k: solution for k, solution in near.items() if solution.x is not None}
        rate = 2.0 ** (math.ceil(2 * math.log2(max(rate, 1e-6))) / 2)
        settle = settling_time(self.model, p, SLOW)
        jobs = {
            k: rows_pool().submit(
                self._simulated, p, rate, settle, float(frequency[k]), float(amplitude[k]), near.get(k)
            )
            for k in left
        }
        try:
            return [jobs[k].result() if solution is None else solution for k, solution in enumerate(found)]
        except BaseException:
            for job in jobs.values():
                job.cancel()
            raise

    def near(
        self,
        parameters: Sequence[dict[str, float]],
        base: Sequence[PeriodicSolution],
        frequency: Vector,
        amplitude: Vector,
    ) -> Array:
        """Amplitudes at neighbouring parameters, to first order: a run or two over a period each, none solved for.

        Args:
            parameters: for each neighbour, values that replace the model's (SI).
            base: the answers that they are neighbours of.
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
        run = base.run
        assert run is not None
        driven = [self._at(p, frequency, amplitude) for p in vectors]
        if run.lead:
            assert base.x is not None
            return np.array([self._forgetful(p, base.x, run) for p in driven])

        def passed(p: Vector, x: Vector) -> tuple[Vector, Vector, Array, Array]:
            """Amplitudes and state at the end; at which rows the extremes lie, and which switches there were."""
            job = self.runs.job(p, x, run.step, run.rows, run.begin)
            found = self.runs.run(job)
            high, low, places = self.runs.extremes(job, found)
            return (high - low) / 2, Q @ found.x1 / spread, places, found.log[:, 1:]

        Q, h, spread = self.runs.kept, 1e-4, base.span
        back = np.linalg.pinv(Q)
        first, end, places, order = passed(run.p, run.x)
        gaps, pull = [], []
        for k in range(len(Q)):
            amplitudes, there, *_ = passed(run.p, run.x + h * spread[k] * back[:, k])
            gaps.append((there - end) / h)
            pull.append((amplitudes - first) / h)
        inverse = np.linalg.pinv(np.eye(len(Q)) - np.column_stack(gaps), rcond=1e-9) if len(Q) else np.zeros((0, 0))
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
        """Amplitudes where the start is soon forgotten: only the ends of the range are run, from shortly before."""
        width = 16
        if 2 * len(run.windows) * (run.lead + 2 * width) >= run.rows + run.lead:
            job = self.runs.job(p, x, run.step, run.rows + run.lead)
            return self.runs.half_range(job, self.runs.run(job), run.lead)
        rows = []
        for k, ends in enumerate(run.windows):
            values = []
            for (row, state), side in zip(ends, (0, 1), strict=True):
                job = self.runs.job(p, state, run.step, run.lead + width, row - run.lead)
                found = self.runs.run(job)
                values.append(self.runs.extremes(job, found, max(run.lead - width, 0), repeats=False)[side][k])
            rows.append((values[0] - values[1]) / 2)
        return np.array(rows)

    def _at(self, p: Vector, frequency: float, amplitude: float) -> Vector:
        """Parameters with those of the sine."""
        sine, p = self.driven.sine, p.copy()
        p[self.model.parameter_index(f"{sine}.amplitude")] = amplitude
        p[self.model.parameter_index(f"{sine}.frequency")] = frequency / (2 * math.pi)
        return p

    @functools.cached_property
    def _linear(self) -> Any:
        """State space, and rates at rest, as functions of (modes, parameters); None if the model is not linear."""
        model, e = self.plain, self.plain.equations
        if model.count(FRICTION) or model.clocks or model.tables or len(model.inputs) != 1:
            return None
        both = ca.vertcat(e.x, e.u)
        slopes = ca.jacobian(ca.vertcat(e.derivative, e.outputs), both)
        if ca.depends_on(slopes, ca.vertcat(e.t, both)):
            return None
        at_rest = ca.substitute(ca.vertcat(e.derivative, e.guards), both, ca.SX.zeros(both.numel()))
        if ca.depends_on(at_rest, e.t):
            return None
        rest = ca.Function("rest", [e.m, e.p], [at_rest[: e.x.numel()]])
        return ca.Function("slopes", [e.m, e.p], [slopes]), rest

    @functools.cached_property
    def _modes(self) -> Vector:
        """Modes at rest."""
        if not self.plain.modes:
            return np.zeros(0)
        run = simulate(self.plain, 1e-6, 1e-6, log_capacity=0)
        return np.asarray(run.final_modes)

    def _closed(
        self, parameters: dict[str, float], frequency: Vector, amplitude: Vector
    ) -> list[PeriodicSolution | None]:
        """C (iw - A)^-1 B + D where the model is linear, for the rows whose answer stays clear of every switch."""
        nothing: list[PeriodicSolution | None] = [None] * len(frequency)
        if self._linear is None:
            return nothing
        slopes, rest = self._linear
        p, m, n = self.plain.parameter_vector(parameters), self._modes, len(self.plain.states)
        matrix = np.array(slopes(m, p).full())
        constant = np.array(rest(m, p).full()).ravel()
        if not np.isfinite(matrix).all():
            return nothing
        A, B, C, D = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
        rest_at = np.linalg.lstsq(A, -constant, rcond=1e-12)[0] if n else np.zeros(0)
        if self.sharp and np.abs(A @ rest_at + constant).max(initial=0.0) > 1e-9 * np.abs(constant).max(initial=0.0):
            return nothing
        values = np.linalg.eigvals(A) if n else np.zeros(1)
        if values.real.max() > 1e-7 * max(np.abs(values).max(), 1.0):
            raise SimulationError("the model is unstable: its answer to a sine never repeats")
        below = 1j * frequency[:, None, None] * np.eye(n) - A
        x = np.linalg.solve(below, B[None].astype(complex))[:, :, 0] * amplitude[:, None]
        y = np.abs(x @ C.T + amplitude[:, None] * D[:, 0])
        meets = self._switches(p, m, x, rest_at, amplitude) if self.sharp else np.zeros(len(y), dtype=bool)
        return [None if bad else PeriodicSolution(row, row / math.sqrt(2)) for row, bad in zip(y, meets, strict=True)]

    def _switches(self, p: Vector, m: Vector, x: Array, rest: Vector, amplitude: Vector) -> Array:
        """For each row, whether some guard is violated along the closed form about ``rest``."""
        guards, memory = self.plain.functions["guards"], np.zeros(self.plain.equations.d.numel())
        turn = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
        states = (x.T[:, :, None] * turn).real.reshape(len(x.T), -1) + rest[:, None]
        inputs = (amplitude[:, None] * turn.real).reshape(1, -1)
        found = np.array(guards(0, states, inputs, memory, m, p).full())
        return np.asarray(found.reshape(len(found), len(x), PHASES).max(axis=(0, 2)) > 0)

    def _simulated(
        self, p: Vector, rate: float, settle: float, frequency: float, amplitude: float, near: PeriodicSolution | None
    ) -> PeriodicSolution:
        period, p = 2 * math.pi / frequency, self._at(p, frequency, amplitude)
        slow = period >= settle
        longest = period / (POINTS_AT_CONTACTS if self.sharp else POINTS)
        longest = min(longest, (STEP_PER_RATE_WHEN_SLOW if slow else STEP_PER_RATE) / rate)
        longest = max(min(longest, self.largest_step or math.inf), period / MOST_STEPS)
        rows = math.ceil(period / longest - 1e-9)
        step = period / rows
        x = near.x if near is not None else None
        if self.model.clocks:
            values = {q.name: float(v) for q, v in zip(self.model.parameters, p, strict=True)}
            found, settled = periodic(self.model, values, frequency, settle, self.largest_step)
            return PeriodicSolution(found, found / math.sqrt(2), settled=settled)
        if slow:
            return self._slow(p, x, step, rows, math.ceil(settle / step) + 1)
        return self._newton(p, x, step, rows, settle, near)

    def _slow(self, p: Vector, x: Vector | None, step: float, rows: int, lead: int) -> PeriodicSolution:
        """A period longer than anything the model remembers: run it, and read it after the start is forgotten."""
        Q = self.runs.kept
        for _ in range(6):
            job = self.runs.job(p, x, step, rows + lead)
            found = self.runs.run(job)
            assert found.states is not None
            x = found.states[rows]
            away = float((np.abs(Q @ (x - found.states[0])) / self.runs.spans(found)).max(initial=0.0))
            first = self.runs.half_range(job, found, 0, rows)
            high, low, ends = self.runs.extremes(job, found, lead)
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
        inverse, span = (near.inverse, near.span) if near is not None and x is not None else (None, None)
        if x is None:
            x = self.runs.run(self.runs.job(p, None, step, rows)).x1
        Q, last = self.runs.kept, math.inf
        back = np.linalg.pinv(Q)
        previous: tuple[Vector, Vector] | None = None
        for _ in range(TURNS):
            job = self.runs.job(p, x, step, rows)
            found = self.runs.run(job)
            if inverse is None or span is None:
                span = self.runs.spans(found)
                inverse = self.runs.inverse(p, x, step, rows, found.x1, span)
                previous = None
            gap = Q @ (found.x1 - x) / span
            if previous is not None:
                inverse = renewed(inverse, previous[0], previous[1] - gap)
            move = inverse @ gap
            size = float(np.abs(move).max(initial=0.0))
            if size < CLOSE:
                assert found.states is not None
                begin = quiet_row(found.y, switches(job, found))
                run = PeriodRun(p, step, rows, begin, found.states[begin])
                return PeriodicSolution(
                    self.runs.half_range(job, found), found.y[1:].std(axis=0), x, inverse, span, run=run
                )
            if size > 4 * last:
                break
            if size > 1.0:
                move *= 1.0 / size
            last, previous = min(size, last), (move, gap)
            x = x + back @ (span * move)
        return self._patient(p, x, step, rows, settle)

    def _patient(self, p: Vector, x: Vector, step: float, rows: int, settle: float) -> PeriodicSolution:
        """Let the answer settle by itself."""
        cycles = max(2, min(math.ceil(settle / (step * rows)), PATIENCE // rows))
        before: Vector | None = None
        for _ in range(4):
            job = self.runs.job(p, x, step, cycles * rows)
            found = self.runs.run(job)
            x = found.x1
            made = PeriodicSolution(
                self.runs.half_range(job, found, (cycles - 1) * rows), found.y[-rows:].std(axis=0), x
            )
            if before is not None and np.all(np.abs(made.amplitudes - before) <= 2e-4 * made.amplitudes):
                return made
            before = made.amplitudes
        made.settled = False
        return made
