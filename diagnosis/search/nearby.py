"""What a fitted model leaves over with a size that is only chosen, such as a delay, at another value.

A model has no derivative with respect to such a size. So each value of it is simulated, once, and the parameters are
taken to follow: by the tangents of the model that is known, to where they leave least. A fit for each value would need
tangents of its own at every step. The size itself is found by Gauss-Newton steps on what is left then, its slope taken
between two values that were simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.leftover import Noise
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.whitened import WhitenedResiduals
from diagnosis.thresholds import SEARCH
from engine.threads import Threads


@dataclass(frozen=True)
class Followed:
    """A model whose parameters followed the tangents.

    Attributes:
        x: its search vector, shape (n,).
        cost: there.
        left: its whitened residual less what parameters can still change, shape (rows,).
    """

    x: Array
    cost: float
    left: Array


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
        self.pool, self.noise = pool, noise
        known = WhitenedResiduals(problem, problem.training, pool, noise=noise)
        rows, self._slopes = known.held(x)
        self._weights = known.weights(rows)
        self._turned, self._upper = np.linalg.qr(known.whitened_slopes(x, self._slopes, self._weights))
        left = known.whitened(x, rows, self._weights)
        self.known = Followed(x, known.cost(x, rows), left - self._turned @ (self._turned.T @ left))

    def fitted(self, other: Problem) -> Followed:
        """Another model with the same parameters, which follow the tangents."""
        x = self.known.x
        beside = WhitenedResiduals(other, other.training, self.pool, noise=self.noise)
        rows = beside.residual(x)
        left = beside.whitened(x, rows, self._weights)
        pull = self._turned.T @ left
        moved = beside.moved(x, -np.linalg.lstsq(self._upper, pull, rcond=None)[0])
        step = (moved - x)[beside.numbers]
        cost = beside.cost(moved, [r + J @ step for r, J in zip(rows, self._slopes, strict=True)])
        return Followed(moved, cost, left - self._turned @ pull)

    def sought(self, at: Callable[[float], Problem | None], within: Sequence[float]) -> tuple[float, Followed]:
        """Where least is left: of values to either side of the best, ever nearer, and where Gauss-Newton steps lead.

        A step is taken where what is left bends half as much between two sides as it slopes, or less. One that promises
        little ends it.

        Args:
            at: the model at a distance, that is 0 for the known one; None where there is none.
            within: distances to either side, the largest first.

        Returns:
            Distance, and the model there.
        """
        place, best = 0.0, self.known
        for far in within:
            begun = best
            sides = [
                (there, self.fitted(other)) for there in (place - far, place + far) if (other := at(there)) is not None
            ]
            promised = math.inf
            if len(sides) == 2:
                low, high = (side.left for _, side in sides)
                across, bend = high - low, high + low - 2 * begun.left
                square, pull = float(across @ across), float(across @ begun.left)
                if float(bend @ bend) < SEARCH.bend**2 * square:
                    promised = pull**2 / square
                    step = place + min(max(-2 * far * pull / square, -2 * far), 2 * far)
                    if promised > SEARCH.slow and (other := at(step)) is not None:
                        sides.append((step, self.fitted(other)))
            place, best = min([(place, best), *sides], key=lambda side: side[1].cost)
            if promised < SEARCH.slow and best.cost > begun.cost - SEARCH.slow:
                break
        return place, best
