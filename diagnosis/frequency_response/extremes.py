"""The highest and lowest value of simulated outputs, between the rows too: smooth tops, corners and jumps.

A smooth extreme is that of a polynomial through five rows. A switch makes a corner or a jump, which no polynomial
through the rows shows: outputs are read at the switch itself, and no polynomial spans it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq

from engine.model import Vector

Array = Any

TOPS = 6
"""Number of highest rows around which the maximum of an output is sought."""

CLEAR = 0.6
"""Distance from the middle of an output's range, as a fraction of half the range, at which neighbours may begin."""


def extremes(y: Array, switches: Vector, at: Callable[[float], Array], repeats: bool) -> tuple[Vector, Vector, Array]:
    """The highest and the lowest value of each output, and their rows, shape (2, outputs).

    Args:
        y: shape (rows, outputs).
        switches: positions of the switches (fractional rows), ascending.
        at: gives the outputs on both sides of a switch, shape (sides, outputs).
        repeats: whether the last row equals the first, as in a whole period.
    """
    last = len(y) - 1
    tops, bottoms = ([_maximum(sign * column, switches, repeats) for column in y.T] for sign in (1.0, -1.0))
    high, low = np.array([value for value, _ in tops]), -np.array([value for value, _ in bottoms])
    places = np.array([[row for _, row in tops], [row for _, row in bottoms]])
    inside = switches[(switches > 0) & (switches < last)]
    cells = inside.astype(int)
    if len(cells):
        # Only switches where an output could exceed its extremes, at twice its slope nearby, are worth a look.
        here, there = y[cells], y[cells + 1]
        slope = np.maximum(np.abs(here - y[np.maximum(cells - 1, 0)]), np.abs(y[np.minimum(cells + 2, last)] - there))
        reach = np.maximum(here, there) + 2 * slope >= high, np.minimum(here, there) - 2 * slope <= low
        for k in np.flatnonzero((reach[0] | reach[1]).any(axis=1)):
            sides = at(float(inside[k]))
            places = np.where([sides.max(axis=0) > high, sides.min(axis=0) < low], cells[k], places)
            high, low = np.maximum(high, sides.max(axis=0)), np.minimum(low, sides.min(axis=0))
    return high, low, places


def half_range(values: Array, switches: Vector) -> Vector:
    """Half the peak to peak of each column over its rows, for a run that cannot be repeated at its switches.

    Outputs at a switch are extrapolated from three rows on either side by parabolas.

    Args:
        values: shape (rows, columns).
        switches: positions of the switches (fractional rows), ascending.
    """

    def at(position: float) -> Array:
        cell = int(position)
        sides = [np.arange(max(cell - 2, 0), cell + 1), np.arange(cell + 1, min(cell + 4, len(values)))]
        whole = [rows for rows in sides if len(rows) == 3]
        powers = np.power.outer([position - rows[0] for rows in whole], np.arange(3))
        weights = powers @ _interpolation(0, 3)
        return np.array([values[cell], *(w @ values[rows] for w, rows in zip(weights, whole, strict=True))])

    high, low, _ = extremes(values, switches, at, repeats=False)
    return np.asarray((high - low) / 2)


def _maximum(column: Vector, switches: Vector, repeats: bool) -> tuple[float, int]:
    """The highest value and its row; of two tops, the one with the lower row may be the higher."""
    ends = (column[-2], column[1]) if repeats else (-math.inf, -math.inf)
    around = np.concatenate([ends[:1], column, ends[1:]])
    least, most = np.minimum(around[:-2], around[2:]), np.maximum(around[:-2], around[2:])
    best = float(column.max())
    rows = np.flatnonzero((column >= most) & (column > least) & (column + (column - least) / 2 >= best))
    rows = rows[np.argsort(-column[rows], kind="stable")[:TOPS]]
    found = [(_top(column, int(i), switches, repeats), int(i)) for i in rows]
    return max([(best, int(np.argmax(column))), *found])


def _top(column: Vector, i: int, switches: Vector, repeats: bool) -> float:
    """The highest value within a row of row ``i``, of the polynomial through five rows between the same switches."""
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
    coefficients = (_interpolation(first, count) @ column[rows % last if repeats else rows]).tolist()
    slopes = [k * c for k, c in enumerate(coefficients)][1:]
    uphill = _polynomial(0.0, slopes)
    far = float(min(end, 1)) if uphill > 0 else float(max(begin, -1))
    if uphill * _polynomial(far, slopes) >= 0:  # no top on the way to the next row
        return here
    position = brentq(_polynomial, 0.0, far, args=(slopes,), xtol=1e-14, rtol=1e-14)
    return max(here, _polynomial(position, coefficients))


def _polynomial(x: float, coefficients: list[float]) -> float:
    """Value at ``x`` of a polynomial with these coefficients, constant first (Horner)."""
    value = 0.0
    for c in reversed(coefficients):
        value = value * x + c
    return value


@functools.cache
def _interpolation(first: int, count: int) -> Array:
    """From values at ``count`` rows, the first being ``first``, to the coefficients of the polynomial through them."""
    return np.linalg.inv(np.vander(np.arange(first, first + count, dtype=float), increasing=True))


def quiet_row(y: Array, switches: Vector) -> int:
    """A row of a period, shape (rows, outputs), far from the extremes of every output and from every switch.

    A neighbour's run does not repeat at once: it reads what lies near its ends twice, with different values.
    """
    rows = len(y) - 1
    half = np.ptp(y, axis=0) / 2
    level = np.abs(y[:-1] - (y.max(axis=0) + y.min(axis=0)) / 2) / np.where(half > 0, half, np.inf)
    worst = level.max(axis=1, initial=0.0)
    distance, row = np.full(rows, float(rows)), np.arange(rows)
    if len(switches):
        around = np.concatenate([[switches[-1] - rows], switches, [switches[0] + rows]])
        k = np.clip(np.searchsorted(around, row), 1, len(around) - 1)
        distance = np.minimum(row - around[k - 1], around[k] - row)
    return int(np.argmax(np.where(worst <= max(CLEAR, float(worst.min())), distance, -1.0)))
