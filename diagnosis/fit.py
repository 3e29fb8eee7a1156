"""Fitting parameters within their tolerances: Levenberg-Marquardt on tangents over growing horizons, several starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.problem import Array, Experiment, Free, Problem, prior
from diagnosis.uncertainty import Flat, uncertainty
from engine.errors import SimulationError
from engine.threads import Threads

Progress = Callable[[str], None]
SETTLED = 1e-4
"""Where no step gains anything, a fit has converged if less than this share of the cost was promised."""


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


def span(row: Mapping[str, Any], digits: int = 4) -> str:
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
        covariance: of the search vector; see `diagnosis.uncertainty`.
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
            low, high = sorted(_reached(f, end) for end in ends)
            rows.append(Interval(f.name, f.value(self.x[i]), low, high, units.get(f.name, ""), f.start))
        return rows

    def score(self, experiments: Sequence[Experiment]) -> float:
        """Mean squared residual over experiments; starting values of recordings not fitted stay at rest."""
        total, count = 0.0, 0
        for e in experiments:
            r = self.problem.residual(self.x, e)
            total, count = total + float(np.sum(e.squares(r))), count + int(np.isfinite(e.measured).sum())
        return total / max(count, 1)


def _reached(f: Free, end: float) -> float:
    """The parameter at the end of its interval, infinite where there is none; one that keeps its sign stops at zero."""
    if math.isfinite(end):
        return f.value(end)
    if f.logarithmic:
        return math.copysign(math.inf, f.start) if end * f.scale > 0 else 0.0
    return math.copysign(math.inf, end)


def _linearised(problem: Problem, x: Array, experiments: Sequence[Experiment], pool: Threads) -> tuple[Array, Array]:
    """Residual and Jacobian of all experiments and the prior, stacked."""
    parts = list(pool.map(lambda e: problem.linearised(x, e), experiments))
    parts.append(prior(problem, x))
    return np.concatenate([r for r, _ in parts]), np.vstack([J for _, J in parts])


def _stacked(problem: Problem, x: Array, experiments: Sequence[Experiment], pool: Threads) -> Array:
    parts = list(pool.map(lambda e: problem.residual(x, e).ravel(), experiments))
    return np.concatenate([*parts, prior(problem, x)[0]])


def descend(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    pool: Threads,
    *,
    iterations: int = 25,
    tolerance: float = 1e-3,
    least: float = 1e-7,
) -> tuple[Array, float, bool]:
    """Levenberg-Marquardt with geodesic acceleration from ``x``.

    The acceleration follows the curved valleys that products of parameters make, where plain steps only zigzag
    (Transtrum and Sethna 2012).

    Args:
        problem: what to fit.
        x: where to start.
        experiments: to fit to.
        pool: threads.
        iterations: at most.
        tolerance: converged when a full step would gain less than this much of the cost's natural unit, 1.
        least: ends when a step gains less than this share of the cost.

    Returns:
        Search vector, cost, and whether it converged.
    """
    damping = 1e-3
    try:
        r, J = _linearised(problem, x, experiments, pool)
    except SimulationError:
        return x, math.inf, False
    cost = float(r @ r)
    for _ in range(iterations):
        H, g = J.T @ J, J.T @ r
        scale = np.diag(np.maximum(np.diag(H), 1e-9))
        promised = float(g @ np.linalg.solve(H + 1e-9 * scale, g))
        if promised < tolerance:
            return x, cost, True
        for _ in range(12):
            A = H + damping * scale
            step = np.clip(-np.linalg.solve(A, g), -3.0, 3.0)
            bend = _acceleration(problem, x, experiments, pool, A, r, J, step)
            if np.linalg.norm(bend) < 0.75 * np.linalg.norm(step):
                step = step + bend / 2
            there = _stacked(problem, x + step, experiments, pool)
            if float(there @ there) < cost:
                break
            damping *= 3
        else:
            return x, cost, promised < max(1.0, SETTLED * cost)
        x, damping = x + step, max(damping / 5, 1e-9)
        try:
            r, J = _linearised(problem, x, experiments, pool)
        except SimulationError:
            return x, float(there @ there), False
        gain, cost = cost - float(r @ r), float(r @ r)
        if gain < least * cost:
            return x, cost, promised < max(1.0, SETTLED * cost)
    return x, cost, False


def _acceleration(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    pool: Threads,
    A: Array,
    r: Array,
    J: Array,
    step: Array,
) -> Array:
    """Second-order correction to a step, from one residual a tenth of the way along it."""
    h = 0.1
    along = _stacked(problem, x + h * step, experiments, pool)
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
    training = problem.chosen("train", "repeat")
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
                part = [e.cut(share * float(e.time[-1])) for e in training] if share < 1 else training
                x, cost, converged = descend(problem, x, part, pool, iterations=iterations)
            if best is None or cost < best[0]:
                best = (cost, x, converged)
        assert best is not None
        cost, x, converged = best
    count = sum(int(np.isfinite(e.measured).sum()) for e in training)
    chi2 = (cost - float(np.sum(prior(problem, x)[0] ** 2))) / max(count, 1)
    made = Fit(problem, x, cost, chi2, converged, np.zeros((n, n)))
    held = problem.chosen("hold_out")
    return known(made, (made.score(held) if held else chi2) - 1)


def known(made: Fit, left: float) -> Fit:
    """A fit with how well it knows its parameters.

    Args:
        made: where it ended.
        left: mean squared error on data that were not fitted, beyond the noise, in units of the noise.
    """
    covariance, weak, flat = uncertainty(made.problem, made.x, left)
    return replace(made, covariance=covariance, weak=weak, flat=flat)
