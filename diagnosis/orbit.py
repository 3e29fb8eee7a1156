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
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from diagnosis.frequency import SineModel, half_range, periodic, settling_time
from diagnosis.period import Orbit, Pass, reduced, renewed
from engine import interpret, native
from engine.errors import CompilerUnavailable, SimulationError
from engine.model import FRICTION, SWITCH, Model, Vector
from engine.native import Job, Outcome
from engine.simulate import explain, prepare, simulate
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

CLOSE = 3e-5
"""Distance from the periodic state, as a share of what each state spans, at which it counts as reached."""

SLOW = 6.0
"""Time constants of the slowest mode after which a start is forgotten: longer periods need no solving."""

TURNS = 24
"""Newton steps before the answer is left to settle by itself, over at most so many periods."""

PHASES = 96
"""Instants of a period at which the closed form is checked for switches."""


@functools.cache
def rows_pool() -> ThreadPoolExecutor:
    """Threads for the rows of tables, one for each core, shared by every fit that runs."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="row")


class Orbits:
    """Periodic answers of one model.

    Args:
        plain: the model with the driven input open.
        driven: the same with a sine on that input.
        largest_step: bound on the integration step (s), or None.
    """

    def __init__(self, plain: Model, driven: SineModel, largest_step: float | None = None) -> None:
        self.plain, self.driven, self.largest_step = plain, driven, largest_step
        self.model = driven.model
        self.sharp = self.model.count(SWITCH) > 0

    def solve(
        self, parameters: dict[str, float], frequency: Vector, amplitude: Vector, near: Mapping[int, Orbit]
    ) -> list[Orbit]:
        """The periodic answers to sines, simulated side by side on all cores.

        Args:
            parameters: values that replace the model's (SI).
            frequency: rad/s, shape (rows,).
            amplitude: of the sines (SI), shape (rows,).
            near: by row, answers at neighbouring parameters, to begin from.

        Raises:
            SimulationError: there is none, or the simulation diverged.
        """
        found: list[Orbit | None] = self._closed(parameters, frequency, amplitude)
        left = [k for k, orbit in enumerate(found) if orbit is None]
        if not left:
            return [orbit for orbit in found if orbit is not None]
        p = self.model.parameter_vector(parameters)
        # Quantised, so that neighbouring parameters share their grid and differences between them are smooth.
        rate = fastest(self.model, p, start_values(self.model, p)).rate
        near = {k: orbit for k, orbit in near.items() if orbit.x is not None}
        rate = 2.0 ** (math.ceil(2 * math.log2(max(rate, 1e-6))) / 2)
        settle = settling_time(self.model, p, SLOW)
        jobs = {
            k: rows_pool().submit(
                self._simulated, p, rate, settle, float(frequency[k]), float(amplitude[k]), near.get(k)
            )
            for k in left
        }
        try:
            return [jobs[k].result() if orbit is None else orbit for k, orbit in enumerate(found)]
        except BaseException:
            for job in jobs.values():
                job.cancel()
            raise

    def near(
        self,
        parameters: Sequence[dict[str, float]],
        base: Sequence[Orbit],
        frequency: Vector,
        amplitude: Vector,
    ) -> Array:
        """Amplitudes at neighbouring parameters, to first order: one run over a period each, none solved for.

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
        whole = [k for k, orbit in enumerate(base) if orbit.run is None]
        for i, values in enumerate(parameters if whole else ()):
            starts = {j: base[k] for j, k in enumerate(whole)}
            for j, orbit in enumerate(self.solve(values, frequency[whole], amplitude[whole], starts)):
                found[i, whole[j]] = orbit.amplitudes
        vectors = [self.model.parameter_vector(values) for values in parameters]
        rest = [k for k, orbit in enumerate(base) if orbit.run is not None]
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

    def _neighbours(self, vectors: Sequence[Vector], base: Orbit, frequency: float, amplitude: float) -> Array:
        run, x = base.run, base.x
        assert run is not None
        assert x is not None
        driven = [self._at(p, frequency, amplitude) for p in vectors]
        if run.lead:
            return np.array([self._forgetful(p, x, run) for p in driven])
        Q, h = self._kept, 1e-4
        back, spread = np.linalg.pinv(Q), base.span
        gaps, pull = [], []
        for k in range(len(Q)):
            found = self._run(self._job(run.p, x + h * spread[k] * back[:, k], run.step, run.rows))
            gaps.append(Q @ (found.x1 - run.x1) / spread / h)
            pull.append((half_range(found.y) - base.amplitudes) / h)
        inverse = np.linalg.pinv(np.eye(len(Q)) - np.column_stack(gaps), rcond=1e-9) if len(Q) else np.zeros((0, 0))
        rows = []
        for p in driven:
            found = self._run(self._job(p, x, run.step, run.rows))
            move = inverse @ (Q @ (found.x1 - run.x1) / spread)
            rows.append(half_range(found.y) + (np.array(pull).T @ move if len(Q) else 0.0))
        return np.array(rows)

    def _forgetful(self, p: Vector, x: Vector, run: Pass) -> Vector:
        """Amplitudes where the start is soon forgotten: only the ends of the range are run, from shortly before."""
        width = 16
        if 2 * len(run.windows) * (run.lead + 2 * width) >= run.rows + run.lead:
            return half_range(self._run(self._job(p, x, run.step, run.rows + run.lead)).y[run.lead :])
        rows = []
        for k, ends in enumerate(run.windows):
            values = []
            for (row, state), top in zip(ends, (True, False), strict=True):
                job = self._job(p, state, run.step, run.lead + width)
                y = self._run(replace(job, t0=(row - run.lead) * run.step)).y[run.lead - width :, k]
                values.append(float(y.max() if top else y.min()))
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

    def _closed(self, parameters: dict[str, float], frequency: Vector, amplitude: Vector) -> list[Orbit | None]:
        """C (iw - A)^-1 B + D where the model is linear, for the rows whose answer stays clear of every switch."""
        nothing: list[Orbit | None] = [None] * len(frequency)
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
        return [None if bad else Orbit(row, row / math.sqrt(2)) for row, bad in zip(y, meets, strict=True)]

    def _switches(self, p: Vector, m: Vector, x: Array, rest: Vector, amplitude: Vector) -> Array:
        """For each row, whether some guard is violated along the closed form about ``rest``."""
        guards, memory = self.plain.functions["guards"], np.zeros(self.plain.equations.d.numel())
        turn = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
        states = (x.T[:, :, None] * turn).real.reshape(len(x.T), -1) + rest[:, None]
        inputs = (amplitude[:, None] * turn.real).reshape(1, -1)
        found = np.array(guards(0, states, inputs, memory, m, p).full())
        return np.asarray(found.reshape(len(found), len(x), PHASES).max(axis=(0, 2)) > 0)

    @functools.cached_property
    def _kept(self) -> Array:
        """The combinations of states on which anything depends, one a row: a twist, but not how far both ends went."""
        e = self.model.equations
        n = len(self.model.states)
        slope = ca.Function("slope", e.arguments, [ca.jacobian(ca.vertcat(e.derivative, e.guards, e.outputs), e.x)])
        random, rows = np.random.default_rng(1), []
        for _ in range(6):
            x, m = random.normal(0, 1, n), random.choice([-1.0, 0.0, 1.0], len(self.model.modes))
            J = slope(0.1, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), m, self.model.parameter_values).full()
            size = np.linalg.norm(J, axis=1)
            rows.append(J[size > 0] / size[size > 0, None])
        _, values, right = np.linalg.svd(np.vstack([*rows, np.zeros((n, n))]))
        return reduced(right[: len(values)][values > 1e-9 * max(values.max(initial=0.0), 1e-300)])

    def _job(self, p: Vector, x: Vector | None, step: float, rows: int) -> Job:
        job = replace(self._pattern, p=p, resolution=step, hmax=step, outputs=rows)
        return replace(job, x0=start_values(self.model, p) if x is None else x)

    @functools.cached_property
    def _pattern(self) -> Job:
        return replace(prepare(self.model, 1.0, 1.0, internal_step=1.0), record_states=True, output_ticks=1)

    def _run(self, job: Job) -> Outcome:
        try:
            found = native.run(self.model, job)
        except CompilerUnavailable:
            found = interpret.run(self.model, job)
        if found.status:
            raise SimulationError(explain(self.model, found))
        if not np.isfinite(found.y).all():
            raise SimulationError("the simulation diverged")
        return found

    def _simulated(
        self, p: Vector, rate: float, settle: float, frequency: float, amplitude: float, near: Orbit | None
    ) -> Orbit:
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
            return Orbit(found, found / math.sqrt(2), settled=settled)
        if slow:
            return self._slow(p, x, step, rows, math.ceil(settle / step) + 1)
        return self._newton(p, x, step, rows, settle, near)

    def _slow(self, p: Vector, x: Vector | None, step: float, rows: int, lead: int) -> Orbit:
        """A period longer than anything the model remembers: run it, and read it after the start is forgotten."""
        for _ in range(6):
            found = self._run(self._job(p, x, step, rows + lead))
            assert found.states is not None
            x = found.states[rows]
            first, last = half_range(found.y[: rows + 1]), half_range(found.y[lead:])
            made = Orbit(last, found.y[lead + 1 :].std(axis=0), x)
            ends = [(lead + int(np.argmax(y)), lead + int(np.argmin(y))) for y in found.y[lead:].T]
            places = tuple(((a, found.states[a - lead]), (b, found.states[b - lead])) for a, b in ends)
            made.run = Pass(p, step, rows, lead, found.x1, places)
            if np.all(np.abs(last - first) <= 0.02 * last):
                return made
        made.settled = False
        return made

    def _newton(self, p: Vector, x: Vector | None, step: float, rows: int, settle: float, near: Orbit | None) -> Orbit:
        inverse, span = (near.inverse, near.span) if near is not None and x is not None else (None, None)
        if x is None:
            x = self._run(self._job(p, None, step, rows)).x1
        Q, last = self._kept, math.inf
        back = np.linalg.pinv(Q)
        previous: tuple[Vector, Vector] | None = None
        for _ in range(TURNS):
            found = self._run(self._job(p, x, step, rows))
            if inverse is None or span is None:
                span = self._spans(found)
                inverse = self._inverse(p, x, step, rows, found.x1, span)
                previous = None
            gap = Q @ (found.x1 - x) / span
            if previous is not None:
                inverse = renewed(inverse, previous[0], previous[1] - gap)
            move = inverse @ gap
            size = float(np.abs(move).max(initial=0.0))
            if size < CLOSE:
                run = Pass(p, step, rows, 0, found.x1)
                return Orbit(half_range(found.y), found.y[1:].std(axis=0), x, inverse, span, run=run)
            if size > 4 * last:
                break
            if size > 1.0:
                move *= 1.0 / size
            last, previous = min(size, last), (move, gap)
            x = x + back @ (span * move)
        return self._patient(p, x, step, rows, settle)

    def _patient(self, p: Vector, x: Vector, step: float, rows: int, settle: float) -> Orbit:
        """Let the answer settle by itself."""
        cycles = max(2, min(math.ceil(settle / (step * rows)), PATIENCE // rows))
        before: Vector | None = None
        for _ in range(4):
            found = self._run(self._job(p, x, step, cycles * rows))
            x = found.x1
            y = found.y[-rows - 1 :]
            made = Orbit(half_range(y), y[1:].std(axis=0), x)
            if before is not None and np.all(np.abs(made.amplitudes - before) <= 2e-4 * made.amplitudes):
                return made
            before = made.amplitudes
        made.settled = False
        return made

    def _spans(self, found: Outcome) -> Vector:
        assert found.states is not None
        span = np.ptp(found.states @ self._kept.T, axis=0)
        return np.where(span > 0, span, max(float(span.max(initial=0.0)), 1e-12) * 1e-3)

    def _inverse(self, p: Vector, x: Vector, step: float, rows: int, x1: Vector, span: Vector) -> Array:
        """Inverse of I - dP/dx along the states that matter, by differences."""
        Q, h = self._kept, 1e-4
        back, columns = np.linalg.pinv(Q), []
        for k in range(len(Q)):
            there = self._run(self._job(p, x + h * span[k] * back[:, k], step, rows)).x1
            columns.append(Q @ (there - x1) / span / h)
        matrix = np.eye(len(Q)) - np.column_stack(columns) if columns else np.zeros((0, 0))
        return np.linalg.pinv(matrix, rcond=1e-9)
