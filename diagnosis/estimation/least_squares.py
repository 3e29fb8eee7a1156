"""The optimiser: Levenberg-Marquardt with geodesic acceleration, over growing horizons and from several starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.estimation.covariance import Flat, covariance
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import FITTING
from engine.errors import SimulationError
from engine.threads import Threads

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Interval:
    """A fitted parameter with its 95 % interval, whose ends are infinite where the recordings set no bound."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    start: float

    def numbers(self) -> dict[str, Any]:
        """As it stands in JSON: an end without bound is None."""
        low, high = (end if math.isfinite(end) else None for end in (self.low, self.high))
        return {"value": self.value, "low": low, "high": high, "unit": self.unit}


def interval_in_words(row: Mapping[str, Any], digits: int = 4) -> str:
    """An interval as `Interval.numbers` gives it, in words: ``1 to 2``, or ``at least 1``."""
    low, high = ("" if row[key] is None else f"{row[key]:.{digits}g}" for key in ("low", "high"))
    if low and high:
        return f"{low} to {high}"
    return f"at least {low}" if low else f"at most {high}" if high else "without bound"


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    Attributes:
        problem: what was fitted.
        x: search vector.
        cost: sum of squared residuals over the training recordings, plus the prior.
        chi2: mean squared residual over the training recordings; 1 is the noise floor.
        converged: whether the last step was small.
        covariance: of the search vector; see `diagnosis.estimation.covariance`.
        weak: combinations of parameters that the data do not tell apart, in words.
        flat: parameters that the data only bound.
    """

    problem: Problem
    x: Array
    cost: float
    chi2: float
    converged: bool
    covariance: Array
    weak: tuple[str, ...] = ()
    flat: Flat = ()

    def parameters(self) -> dict[str, float]:
        """Fitted values, SI units."""
        return self.problem.values(self.x)[0]

    def intervals(self) -> list[Interval]:
        """95 % intervals of all free parameters."""
        units = {p.name: p.unit for p in self.problem.model.parameters}
        bounded = {i: ends for i, *ends in self.flat}
        rows = []
        for i, f in enumerate(self.problem.free):
            half = 1.96 * math.sqrt(max(self.covariance[i, i], 0.0))
            ends = bounded.get(i, [self.x[i] - half, self.x[i] + half])
            low, high = sorted(_end_value(f, end) for end in ends)
            rows.append(Interval(f.name, f.value(self.x[i]), low, high, units.get(f.name, ""), f.start))
        return rows


def _end_value(f: FreeParameter, end: float) -> float:
    """The parameter at the end of its interval, infinite where there is none; one that keeps its sign stops at zero."""
    if math.isfinite(end):
        return f.value(end)
    if f.logarithmic:
        return math.copysign(math.inf, f.start) if end * f.scale > 0 else 0.0
    return math.copysign(math.inf, end)


def descend(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    pool: Threads,
    *,
    only: Sequence[int] | None = None,
    iterations: int = 25,
    promised_drop: float = 1e-3,
    relative_drop: float = 1e-7,
) -> tuple[Array, float, bool]:
    """Levenberg-Marquardt with geodesic acceleration from ``x``.

    The acceleration follows the curved valleys that products of parameters make, where plain steps only zigzag
    [Transtrum 2012].

    Args:
        problem: what to fit.
        x: where to start, shape (n,).
        experiments: to fit to.
        pool: threads.
        only: numbers of the search variables that may move; all if None.
        iterations: at most.
        promised_drop: converged when a full step would reduce the cost by less than this.
        relative_drop: stop when a step reduces the cost by less than this fraction.

    Returns:
        Search vector, cost, and whether it converged.
    """
    damping = 1e-3
    stack = _StackedResiduals(problem, experiments, pool, None if only is None else list(only))
    try:
        r, J = stack.linearised(x)
    except SimulationError:
        return x, math.inf, False
    cost = float(r @ r)
    for _ in range(iterations):
        H, g = J.T @ J, J.T @ r
        scale = np.diag(np.maximum(np.diag(H), 1e-9))
        promised = float(g @ np.linalg.solve(H + 1e-9 * scale, g))
        if promised < promised_drop:
            return x, cost, True
        for _ in range(12):
            A = H + damping * scale
            step = np.clip(-np.linalg.solve(A, g), -3.0, 3.0)
            bend = stack.acceleration(x, A, r, J, step)
            if np.linalg.norm(bend) < 0.75 * np.linalg.norm(step):
                step = step + bend / 2
            there = stack.residual(stack.moved(x, step))
            if float(there @ there) < cost:
                break
            damping *= 3
        else:
            return x, cost, promised < max(1.0, FITTING.settled * cost)
        x, damping = stack.moved(x, step), max(damping / 5, 1e-9)
        try:
            r, J = stack.linearised(x)
        except SimulationError:
            return x, float(there @ there), False
        gain, cost = cost - float(r @ r), float(r @ r)
        if gain < relative_drop * cost:
            return x, cost, promised < max(1.0, FITTING.settled * cost)
    return x, cost, False


@dataclass(frozen=True)
class _StackedResiduals:
    """Residuals of experiments and the prior, stacked, as functions of the search variables that may move."""

    problem: Problem
    experiments: Sequence[Experiment]
    pool: Threads
    only: list[int] | None

    def moved(self, x: Array, step: Array) -> Array:
        """The search vector after a step of the variables that may move."""
        if self.only is None:
            return x + step
        there = x.copy()
        there[self.only] += step
        return there

    def residual(self, x: Array) -> Array:
        parts = list(self.pool.map(lambda e: self.problem.residual(x, e).ravel(), self.experiments))
        return np.concatenate([*parts, self.problem.prior(x)[0]])

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Residual and Jacobian; raises SimulationError where the model cannot be differentiated."""
        parts = list(self.pool.map(lambda e: self.problem.linearised(x, e), self.experiments))
        parts.append(self.problem.prior(x))
        r, J = np.concatenate([r for r, _ in parts]), np.vstack([J for _, J in parts])
        return r, J if self.only is None else J[:, self.only]

    def acceleration(self, x: Array, A: Array, r: Array, J: Array, step: Array) -> Array:
        """Second-order correction to a step, from one residual a tenth of the way along it."""
        h = 0.1
        along = self.residual(self.moved(x, h * step))
        second = 2 / h * ((along - r) / h - J @ step)
        return np.asarray(-np.linalg.solve(A, J.T @ second))


def fit(
    problem: Problem,
    *,
    starts: Sequence[Array] = (),
    random_starts: int = 0,
    seed: int = 0,
    horizons: Sequence[float] = (0.25, 1.0),
    workers: int | None = None,
    progress: Progress | None = None,
    iterations: int = 25,
) -> Fit:
    """Fit the free parameters to the training recordings.

    Every start is first fitted to the beginning of each recording, then to all of it: over a short horizon the phase of
    a lightly damped oscillation cannot slip by a whole cycle.

    Args:
        problem: what to fit.
        starts: search vectors to start from; the nominal parameters if none are given.
        random_starts: further starts, drawn within the tolerances.
        seed: of those.
        horizons: shares of each recording, growing; the last must be 1.
        workers: threads.
        progress: told what is being done.
        iterations: at most, per horizon.

    Returns:
        The best fit over all starts.
    """
    training = problem.training
    random = np.random.default_rng(seed)
    n = len(problem.free)
    begin = [np.asarray(x, dtype=float) for x in starts] or [np.zeros(n)]
    begin += [random.normal(0.0, 0.7, n) for _ in range(random_starts)]
    best: tuple[float, Array, bool] | None = None
    with Threads(workers or 2) as pool:
        for number, x in enumerate(begin):
            if progress:
                progress(f"start {number + 1} of {len(begin)}")
            for share in horizons:
                part = [e.cut(share) for e in training]
                x, cost, converged = descend(problem, x, part, pool, iterations=iterations)
            if best is None or cost < best[0]:
                best = (cost, x, converged)
        assert best is not None
        cost, x, converged = best
    made = Fit(problem, x, cost, problem.fitted_chi2(x, cost), converged, np.zeros((n, n)))
    return with_covariance(made, (problem.chi2(x, problem.held_out) if problem.held_out else made.chi2) - 1)


def with_covariance(made: Fit, left: float) -> Fit:
    """A fit with the covariance of its search vector.

    Args:
        made: where it ended.
        left: mean squared residual of data that were not fitted, beyond the noise, in units of the noise.
    """
    found, weak, flat = covariance(made.problem, made.x, left)
    return replace(made, covariance=found, weak=weak, flat=flat)


def with_held_out_starts(problem: Problem, x: Array, iterations: int = 20) -> Array:
    """The search vector with the starting values of held-out recordings fitted, everything else frozen.

    No other recording determines the state in which a held-out one begins, so that state is fitted to the whole of it:
    a few numbers, against thousands of samples.

    Args:
        problem: with experiments of all roles.
        x: search vector.
        iterations: at most, per experiment.
    """
    x = x.copy()
    for e in problem.held_out:
        mine = [i for i, f in enumerate(problem.free) if f.recording == e.name]
        if mine:
            with Threads(1) as pool:
                x = descend(problem, x, [e], pool, only=mine, iterations=iterations)[0]
    return x
