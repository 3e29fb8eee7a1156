"""Runs over a period, what is read from them, and the linear algebra of Newton's method on them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from engine import interpret, native
from engine.errors import CompilerUnavailable, SimulationError
from engine.model import Model, Vector
from engine.native import Job, Outcome
from engine.simulate import explain, prepare
from engine.start import start_values

Array = Any

LOG = 4_000
"""Switches of a run that are known at most."""

ASIDE = 1e-6
"""Share of a step beside a switch at which outputs that jump there are read."""

TOPS = 6
"""Rows about which the highest value of an output is sought at most."""

CLEAR = 0.6
"""Share of its half range that an output may be away from the middle where neighbours begin."""


@dataclass
class PeriodicSolution:
    """A periodic answer.

    Attributes:
        amplitudes: half the peak to peak of each output over a period.
        rms: root mean square of each output about its mean.
        x: state at the beginning of the period; None where the closed form holds.
        inverse: of I - dP/dx, for the combinations of states that matter, in units of ``span``.
        span: what each combination of states that matters spans over the period.
        settled: whether the answer repeats.
        run: where neighbours begin; None where the closed form holds, or where it had to settle by itself.
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
    """A run over a period, for neighbours to begin from.

    Attributes:
        p, step, rows: parameters, integration step (s) and steps of the run.
        begin, x: row of the period at which it begins, and the state there.
        lead: rows after which the start is forgotten; 0 where the answer repeats.
        windows: for each output, where its highest and its lowest value lie: the row, and the state ``lead`` before.
    """

    p: Vector
    step: float
    rows: int
    begin: int
    x: Vector
    lead: int = 0
    windows: tuple[tuple[tuple[int, Vector], tuple[int, Vector]], ...] = ()


class Runs:
    """Runs of a model over a period, and what is read from them.

    Args:
        model: with the sine on its input.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    @functools.cached_property
    def kept(self) -> Array:
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

    def job(self, p: Vector, x: Vector | None, step: float, rows: int, begin: int = 0) -> Job:
        """A run of ``rows`` steps of ``step`` seconds from ``x`` (None: the model's start), after ``begin`` steps."""
        job = replace(self._pattern, p=p, resolution=step, hmax=step, outputs=rows, t0=begin * step)
        return replace(job, x0=start_values(self.model, p) if x is None else x)

    @functools.cached_property
    def _pattern(self) -> Job:
        return replace(
            prepare(self.model, 1.0, 1.0, internal_step=1.0), record_states=True, output_ticks=1, log_capacity=LOG
        )

    def run(self, job: Job) -> Outcome:
        """Carry out one run.

        Raises:
            SimulationError: it failed or diverged.
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
        """The highest and the lowest value of each output over some rows of a run, and their rows from ``first`` on."""

        def at(position: float) -> Array:
            assert found.states is not None
            assert found.modes is not None
            row, part = divmod(position + first, 1.0)
            near = replace(job, x0=found.states[int(row)], m0=found.modes[int(row)], outputs=1, record_states=False)
            near = replace(near, t0=job.t0 + row * job.resolution, log_capacity=0)
            sides = (part - ASIDE, part + ASIDE) if self.jumps else (part,)
            runs = [self.run(replace(near, resolution=side * job.resolution)) for side in sides if side > ASIDE]
            return np.array([found.y[int(row)], *(run.y[1] for run in runs)])

        last = len(found.y) - 1 if last is None else last
        return extremes(found.y[first : last + 1], switches(job, found) - first, at, repeats)

    @functools.cached_property
    def jumps(self) -> bool:
        """Whether outputs depend on the modes: they then jump at switches."""
        e = self.model.equations
        return bool(ca.depends_on(e.outputs, e.m))

    def spans(self, found: Outcome) -> Vector:
        """What each combination of states that matters spans over a run, from some of its rows."""
        assert found.states is not None
        span = np.ptp(found.states[:: 1 + len(found.states) // 1000] @ self.kept.T, axis=0)
        return np.where(span > 0, span, max(float(span.max(initial=0.0)), 1e-12) * 1e-3)

    def inverse(self, p: Vector, x: Vector, step: float, rows: int, x1: Vector, span: Vector) -> Array:
        """Inverse of I - dP/dx along the states that matter, by differences."""
        Q, h = self.kept, 1e-4
        back, columns = np.linalg.pinv(Q), []
        for k in range(len(Q)):
            there = self.run(self.job(p, x + h * span[k] * back[:, k], step, rows)).x1
            columns.append(Q @ (there - x1) / span / h)
        matrix = np.eye(len(Q)) - np.column_stack(columns) if columns else np.zeros((0, 0))
        return np.linalg.pinv(matrix, rcond=1e-9)


def switches(job: Job, found: Outcome) -> Vector:
    """Where the modes changed in a run (rows, not whole), those at its start aside."""
    rows = (found.log[:, 0] - job.t0) / job.resolution
    return np.asarray(rows[rows > 1e-6])


def extremes(y: Array, switches: Vector, at: Callable[[float], Array], repeats: bool) -> tuple[Vector, Vector, Array]:
    """The highest and the lowest value of each output, between the rows too, and their rows, shape (2, outputs).

    Smooth extremes are those of curves through five rows. A switch makes a corner or a jump, which no curve through the
    rows tells: the values there are asked for, and no curve spans it.

    Args:
        y: shape (rows, outputs).
        switches: where they lie (rows, not whole), ascending.
        at: the outputs on both sides of a switch, shape (sides, outputs).
        repeats: whether the last row is the first again.
    """
    last = len(y) - 1
    tops, bottoms = ([_summit(sign * column, switches, repeats) for column in y.T] for sign in (1.0, -1.0))
    high, low = np.array([value for value, _ in tops]), -np.array([value for value, _ in bottoms])
    places = np.array([[row for _, row in tops], [row for _, row in bottoms]])
    inside = switches[(switches > 0) & (switches < last)]
    cells = inside.astype(int)
    if len(cells):
        here, there = y[cells], y[cells + 1]
        slope = np.maximum(np.abs(here - y[np.maximum(cells - 1, 0)]), np.abs(y[np.minimum(cells + 2, last)] - there))
        reach = np.maximum(here, there) + 2 * slope >= high, np.minimum(here, there) - 2 * slope <= low
        for k in np.flatnonzero((reach[0] | reach[1]).any(axis=1)):
            sides = at(float(inside[k]))
            places = np.where([sides.max(axis=0) > high, sides.min(axis=0) < low], cells[k], places)
            high, low = np.maximum(high, sides.max(axis=0)), np.minimum(low, sides.min(axis=0))
    return high, low, places


def _summit(column: Vector, switches: Vector, repeats: bool) -> tuple[float, int]:
    """The highest value and its row, of those in question: of two tops, the one with the lower row may be higher."""
    ends = (column[-2], column[1]) if repeats else (-math.inf, -math.inf)
    around = np.concatenate([ends[:1], column, ends[1:]])
    least, most = np.minimum(around[:-2], around[2:]), np.maximum(around[:-2], around[2:])
    best = float(column.max())
    rows = np.flatnonzero((column >= most) & (column > least) & (column + (column - least) / 2 >= best))
    rows = rows[np.argsort(-column[rows], kind="stable")[:TOPS]]
    found = [(_top(column, int(i), switches, repeats), int(i)) for i in rows]
    return max([(best, int(np.argmax(column))), *found])


def _top(column: Vector, i: int, switches: Vector, repeats: bool) -> float:
    """The highest value about row ``i``, of the curve through five rows between the same switches."""
    last = len(column) - 1
    away = switches - i
    if repeats:
        away = (away + last / 2) % last - last / 2
    begin = max(math.ceil(away[away <= 0].max(initial=-4.0)), -4 if repeats else -i)
    end = min(math.floor(away[away > 0].min(initial=4.0)), 4 if repeats else last - i)
    first = max(begin, min(-2, end - 4))
    count = min(end, first + 4) - first + 1
    here = float(column[i])
    if count < 3 or last < 8:
        return here
    rows = i + np.arange(first, first + count)
    c = (_curve(first, count) @ column[rows % last if repeats else rows]).tolist()
    at = 0.0
    for _ in range(6):
        slope = sum(k * a * at ** (k - 1) for k, a in enumerate(c) if k)
        bend = sum(k * (k - 1) * a * at ** (k - 2) for k, a in enumerate(c) if k > 1)
        if bend >= 0:
            return here
        at = min(max(at - slope / bend, begin, -1.0), end, 1.0)
    return float(max(here, sum(a * at**k for k, a in enumerate(c))))


@functools.cache
def _curve(first: int, count: int) -> Array:
    """Coefficients, constant first, of the polynomial through so many rows from ``first`` on."""
    return np.linalg.inv(np.vander(np.arange(first, first + count, dtype=float), increasing=True))


def quiet_row(y: Array, switches: Vector) -> int:
    """A row of a period, shape (rows, outputs), that is far from the extremes of every output and from every switch.

    A neighbour that begins there does not repeat at once, and a run reads what lies about its ends twice and
    differently.
    """
    rows = len(y) - 1
    half = np.ptp(y, axis=0) / 2
    level = np.abs(y[:-1] - (y.max(axis=0) + y.min(axis=0)) / 2) / np.where(half > 0, half, np.inf)
    worst = level.max(axis=1, initial=0.0)
    free, row = np.full(rows, float(rows)), np.arange(rows)
    if len(switches):
        around = np.concatenate([[switches[-1] - rows], switches, [switches[0] + rows]])
        k = np.clip(np.searchsorted(around, row), 1, len(around) - 1)
        free = np.minimum(row - around[k - 1], around[k] - row)
    return int(np.argmax(np.where(worst <= max(CLEAR, float(worst.min())), free, -1.0)))


def reduced(rows: Array) -> Array:
    """The reduced row echelon form of independent rows."""
    rows, pivot = np.array(rows), 0
    for column in range(rows.shape[1]):
        if pivot == len(rows):
            break
        best = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[best, column]) < 1e-9:
            continue
        rows[[pivot, best]] = rows[[best, pivot]]
        rows[pivot] /= rows[pivot, column]
        others = np.arange(len(rows)) != pivot
        rows[others] -= np.outer(rows[others, column], rows[pivot])
        pivot += 1
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def renewed(inverse: Array, moved: Vector, change: Vector) -> Array:
    """Broyden's update of the inverse: a move by ``moved`` made the gap shrink by ``change``."""
    along = moved @ inverse
    below = float(along @ change)
    if abs(below) < 1e-12 * float(np.linalg.norm(along) * np.linalg.norm(change) + 1e-300):
        return inverse
    return inverse + np.outer(moved - inverse @ change, along) / below
