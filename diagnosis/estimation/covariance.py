"""How well a fit knows its parameters, and which combinations the recordings do not tell apart.

The covariance of least squares alone claims far too much: nothing of what disturbs a real recording is white noise.
Here it has four parts: noise that is correlated over a fraction of a second (a sandwich over blocks); the input, whose
size and timing no amplifier keeps exactly; what the model still leaves out, which a fit turns towards its parameters,
where no residual shows it, but data that were not fitted do; and for a parameter that the recordings only bound, such
as the limit of an amplifier that is never reached, the cost itself, followed until it rises.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation.problem import Array, Experiment, Problem, prior
from diagnosis.recordings.feedback import plant_inputs
from engine.errors import SimulationError
from engine.simulate import Drive

BLOCK = 0.25
"""Length (s) of the blocks within which residuals are taken to be correlated."""

SIZE, TIMING = 0.03, 0.1
"""Standard deviations of the input: of its size, as a share, and of its instants, in sample intervals."""

LEAST, MOST, LONG = 0.02, 1.0, 0.5
"""What a model leaves out, as a share of the noise's power: at least and at most; and for how long (s) it keeps its
sign."""

REACH, RISE, CLOSE = 40.0, 3.84, 0.01
"""A cost that is flat is followed so far in the search variable, until it has risen by so much, to such a share."""

Flat = tuple[tuple[int, float, float], ...]
"""Parameters that the recordings only bound: number, least and greatest search variable, infinite without bound."""


def uncertainty(problem: Problem, x: Array, left: float = 0.0) -> tuple[Array, tuple[str, ...], Flat]:
    """Covariance of the search vector, weak combinations in words, and parameters that are only bounded.

    Args:
        problem: what was fitted.
        x: where the fit ended, shape (n,).
        left: mean squared error on data that were not fitted, beyond the noise, in units of the noise.

    Returns:
        Covariance, shape (n, n); combinations along which the data say less than the tolerances; bounds.
    """
    weights = prior(problem, x)[1]
    meat, data = weights.T @ weights, np.zeros((len(x), len(x)))
    shifts = np.zeros((2, len(x)))
    for e in problem.chosen("train", "repeat"):
        try:
            r, J = problem.linearised(x, e)
        except SimulationError:
            continue
        data += J.T @ J
        slopes = J.reshape(len(r) // e.measured.shape[1], -1, len(x))
        each = slopes * r.reshape(*slopes.shape[:2], 1)
        meat = meat + sum(np.outer(g, g) for g in _sums(each.sum(axis=1), BLOCK, e))
        share = min(max(left, LEAST), MOST)
        # Each signal errs on its own.
        meat = meat + share * sum(g.T @ g for g in _sums(slopes, LONG, e))
        shifts += np.array([J.T @ (there - r) for there in _disturbed(problem, x, e)])
    inverse = np.linalg.pinv(weights.T @ weights + data)
    robust = inverse @ meat @ inverse
    least = np.maximum(np.diag(robust), np.diag(inverse))
    found = robust + np.diag(least - np.diag(robust))
    for shift in shifts @ inverse:
        found = found + np.outer(shift, shift)
    return found, _weak(problem, data), _bounds(problem, x, np.flatnonzero(np.diag(data) == 0).tolist())


def _sums(rows: Array, length: float, e: Experiment) -> list[Array]:
    """Sums over blocks of time of rows that belong to its instants; the rows of a table are blocks of their own."""
    count = max(1, round(length / (e.step * e.every)))
    return list(np.add.reduceat(rows, np.arange(0, len(rows), count), axis=0))


def _disturbed(problem: Problem, x: Array, e: Experiment) -> tuple[Array, Array]:
    """Residuals with the input a little larger, and a little later; as they are where it is known exactly."""
    r = problem.residual(x, e).ravel()
    inputs = [v.name for v in problem.model.inputs]
    if e.drive is None or plant_inputs(problem.scenario.system, inputs):
        return r, r  # a reference is what the controller was told
    larger = replace(e.drive, values=np.asarray(e.drive.values, dtype=float) * (1 + SIZE))
    later = replace(e.drive, time=np.asarray(e.drive.time, dtype=float) + TIMING * e.shortest)
    return _driven(problem, x, e, larger), _driven(problem, x, e, later)


def _driven(problem: Problem, x: Array, e: Experiment, drive: Drive) -> Array:
    return problem.residual(x, replace(e, drive=drive)).ravel()


def _bounds(problem: Problem, x: Array, flat: Sequence[int]) -> Flat:
    """How far each parameter that changes nothing can move before it does."""
    rows = []
    for i in flat:
        if problem.free[i].prior or problem.free[i].recording:
            continue
        rows.append((i, _end(problem, x, i, -1.0), _end(problem, x, i, 1.0)))
    return tuple(rows)


def _end(problem: Problem, x: Array, i: int, sign: float) -> float:
    """Where the cost has risen, in one direction; infinite if it never does."""
    training = problem.chosen("train", "repeat")

    def risen(distance: float) -> bool:
        there = x.copy()
        there[i] += sign * distance
        return sum(float(np.sum(problem.residual(there, e) ** 2)) for e in training) > cost + RISE

    cost = sum(float(np.sum(problem.residual(x, e) ** 2)) for e in training)
    inner, outer = 0.0, CLOSE
    while not risen(outer):
        inner, outer = outer, 2 * outer
        if outer > REACH:
            return sign * math.inf
    while outer - inner > CLOSE * outer:
        middle = (inner + outer) / 2
        inner, outer = (inner, middle) if risen(middle) else (middle, outer)
    return float(x[i] + sign * outer)


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
