"""The fit of a weight to the gains that it is to have."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexarm.design.uncertainty.results import Weight
from flexarm.design.uncertainty.spectra import binned

ORDER = 2
"""Highest order of a weight."""


def fit_weight(signal: str, omega: NDArray[np.float64], size: NDArray[np.float64]) -> Weight:
    """The weight of lowest order that fits log gains, least squares over log frequency."""
    low, high = float(omega.min()), float(omega.max())
    w, mean = binned(omega, size**2)
    target = np.log(np.maximum(np.sqrt(mean), 1e-9))
    best = Weight(signal, (), (), float(np.exp(target.mean())))
    cost = float(np.sum((target - target.mean()) ** 2))
    for order in range(1, ORDER + 1):
        side = np.repeat([1.0, -1.0], order)  # zeros raise the gain, poles lower it

        def squares(v: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray((w[:, None] / np.exp(v[1:])) ** 2)

        def left(v: NDArray[np.float64], side: Any = side) -> NDArray[np.float64]:
            return np.asarray(v[0] + np.log1p(squares(v)) @ side / 2 - target)

        def slope(v: NDArray[np.float64], side: Any = side) -> NDArray[np.float64]:
            share = squares(v) / (1 + squares(v))
            return np.column_stack([np.ones(len(w)), -share * side])

        spots = np.log(np.geomspace(low, high, 2 * order + 2)[1:-1])
        for begin in (
            np.concatenate([[target[0]], spots[::2], spots[1::2]]),
            np.concatenate([[target[0]], spots[1::2], spots[::2]]),
        ):
            span = math.log(10)
            lowest = np.concatenate([[-25.0], np.full(2 * order, math.log(low) - span)])
            highest = np.concatenate([[25.0], np.full(2 * order, math.log(high) + span)])
            found = least_squares(left, np.clip(begin, lowest + 1e-6, highest - 1e-6), slope, bounds=(lowest, highest))
            if 2 * found.cost < 0.8 * cost:
                v, cost = found.x, 2 * float(found.cost)
                best = Weight(
                    signal, tuple(np.exp(v[1 : order + 1])), tuple(np.exp(v[order + 1 :])), float(np.exp(v[0]))
                )
    return best
