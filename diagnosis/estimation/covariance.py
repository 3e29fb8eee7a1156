"""How well a fit knows its parameters, and which combinations the recordings do not tell apart.

The covariance of least squares alone claims too much: what disturbs a real recording is not white noise. Here it is the
sum of three parts: noise that is correlated over a fraction of a second (a sandwich over blocks); the input, whose size
and timing no amplifier keeps exactly; and unmodelled dynamics, which a fit absorbs in its parameters, so that only
held-out data reveal them. A parameter that the recordings only bound, such as the
limit of an amplifier that is never reached, has no covariance: the cost is followed until it rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
from diagnosis.thresholds import INTERVALS
from engine.errors import SimulationError

Flat = tuple[tuple[int, float, float], ...]
"""Parameters that the recordings only bound: number, least and greatest search variable, infinite without bound."""


def covariance(problem: Problem, x: Array, left: float = 0.0) -> tuple[Array, tuple[str, ...], Flat]:
    """Covariance of the search vector, weak combinations in words, and parameters that are only bounded.

    Args:
        problem: what was fitted.
        x: where the fit ended, shape (n,).
        left: mean squared error on data that were not fitted, beyond the noise, in units of the noise.

    Returns:
        Covariance, shape (n, n); combinations along which the data say less than the tolerances; bounds.
    """
    weights = problem.prior(x)[1]
    score_covariance, data = weights.T @ weights, np.zeros((len(x), len(x)))
    shifts = np.zeros((2, len(x)))
    for e in problem.training:
        try:
            [(r, slopes)] = linearised(problem, x, [e])
        except SimulationError:
            continue
        J = slopes.reshape(-1, len(x))
        data += J.T @ J
        each = slopes * r[..., None]
        score_covariance = score_covariance + sum(np.outer(g, g) for g in _sums(each.sum(axis=1), INTERVALS.block, e))
        share = min(max(left, INTERVALS.least_left), INTERVALS.most_left)
        # Each signal errs on its own.
        score_covariance = score_covariance + share * sum(g.T @ g for g in _sums(slopes, INTERVALS.left_length, e))
        for k, there in enumerate(_disturbed(problem, x, e)):
            shifts[k] += J.T @ (there - r.ravel())
    inverse = np.linalg.pinv(weights.T @ weights + data)
    robust = inverse @ score_covariance @ inverse
    least = np.maximum(np.diag(robust), np.diag(inverse))
    found = robust + np.diag(least - np.diag(robust))
    for shift in shifts @ inverse:
        found = found + np.outer(shift, shift)
    return found, _weak(problem, data), _bounds(problem, x, np.flatnonzero(np.diag(data) == 0).tolist())


def _sums(rows: Array, length: float, e: Experiment) -> list[Array]:
    """Sums of rows over blocks of time of ``e``; each row of a table is a block."""
    count = max(1, round(length / e.interval))
    return list(np.add.reduceat(rows, np.arange(0, len(rows), count), axis=0))


def _disturbed(problem: Problem, x: Array, e: Experiment) -> list[Array]:
    """Residuals with the input a little larger, and a little later; none where the input is known exactly."""
    if problem.reference:
        return []  # it is what the controller was told
    changed = e.disturbed_inputs(INTERVALS.input_size, INTERVALS.input_timing)
    return [r.ravel() for r in problem.residuals(x, changed)]


def _bounds(problem: Problem, x: Array, flat: Sequence[int]) -> Flat:
    """For each parameter that changes nothing, the range within which the cost stays flat."""
    rows = []
    for i in flat:
        if problem.free[i].prior or problem.free[i].recording:
            continue
        rows.append((i, _end(problem, x, i, -1.0), _end(problem, x, i, 1.0)))
    return tuple(rows)


def _end(problem: Problem, x: Array, i: int, sign: float) -> float:
    """Where the cost has risen by `INTERVALS.rise`; infinite if it does not within `INTERVALS.reach`."""
    here = problem.misfit(x, problem.training)

    def rise(distance: float) -> float:
        there = x.copy()
        there[i] += sign * distance
        return problem.misfit(there, problem.training) - here - INTERVALS.rise

    inner, outer = 0.0, INTERVALS.close
    while not rise(outer) > 0:
        inner, outer = outer, 2 * outer
        if outer > INTERVALS.reach:
            return sign * math.inf
    return float(x[i] + sign * brentq(rise, inner, outer, rtol=INTERVALS.close))


def _weak(problem: Problem, data: Array) -> tuple[str, ...]:
    """Combinations along which the data say less than the tolerances do."""
    if not len(data):
        return ()
    values, vectors = np.linalg.eigh(data)
    rows = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value < 1.0:
            order = np.argsort(-np.abs(vector))
            parts = [f"{problem.free[i].name} ({vector[i]:+.2f})" for i in order if abs(vector[i]) > 0.3]
            rows.append(" with ".join(parts) or problem.free[int(order[0])].name)
    return tuple(rows)
