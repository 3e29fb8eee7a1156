"""What a fitted model leaves over with a size that is only chosen, such as a delay, at another value.

A model has no derivative with respect to such a size. So each value of it is simulated, once, and the parameters are
taken to follow: by the tangents of the model that is known, to where they leave least. A fit for each value would need
tangents of its own at every step.
"""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.leftover import Noise
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.whitened import WhitenedResiduals
from engine.threads import Threads


class Nearby:
    """The tangents of a model, with which others are fitted that differ in a size that is only chosen.

    Args:
        problem: the model.
        x: its search vector, shape (n,).
        pool: threads.
        noise: as of `Bands`.

    Raises:
        SimulationError: it cannot be differentiated there.
    """

    def __init__(self, problem: Problem, x: Array, pool: Threads, *, noise: Noise) -> None:
        self.x, self.pool, self.noise = x, pool, noise
        known = WhitenedResiduals(problem, problem.training, pool, noise=noise)
        rows, self._slopes = known.held(x)
        self._weights = known.weights(rows)
        self._turned, self._upper = np.linalg.qr(known.whitened_slopes(x, self._slopes, self._weights))
        self.cost = known.cost(x, rows)

    def fitted(self, other: Problem) -> tuple[Array, float]:
        """Search vector and cost of another model with the same parameters, which follow the tangents."""
        beside = WhitenedResiduals(other, other.training, self.pool, noise=self.noise)
        rows = beside.residual(self.x)
        pull = self._turned.T @ beside.whitened(self.x, rows, self._weights)
        moved = beside.moved(self.x, -np.linalg.lstsq(self._upper, pull, rcond=None)[0])
        step = (moved - self.x)[beside.numbers]
        return moved, beside.cost(moved, [r + J @ step for r, J in zip(rows, self._slopes, strict=True)])
