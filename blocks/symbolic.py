"""Functions for writing laws on symbols. CasADi is imported only when a law is stamped."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from engine.ports import Expression


def exp(x: Expression) -> Expression:
    """Exponential."""
    import casadi

    return casadi.exp(x)


def log(x: Expression) -> Expression:
    """Natural logarithm."""
    import casadi

    return casadi.log(x)


def cos(x: Expression) -> Expression:
    """Cosine."""
    import casadi

    return casadi.cos(x)


def sin(x: Expression) -> Expression:
    """Sine."""
    import casadi

    return casadi.sin(x)


def sinh(x: Expression) -> Expression:
    """Hyperbolic sine."""
    import casadi

    return casadi.sinh(x)


def cosh(x: Expression) -> Expression:
    """Hyperbolic cosine."""
    import casadi

    return casadi.cosh(x)


def expm1(x: Expression) -> Expression:
    """exp(x) - 1, also for small x."""
    import casadi

    return casadi.expm1(x)


def magnitude(x: Expression) -> Expression:
    """Absolute value."""
    import casadi

    return casadi.fabs(x)


def sqrt(x: Expression) -> Expression:
    """Square root."""
    import casadi

    return casadi.sqrt(x)


def floor(x: Expression) -> Expression:
    """Largest whole number that is not above ``x``. In linear models it counts as ``x`` (`engine.roundings`)."""
    import casadi

    return casadi.floor(x)


def least(a: Expression, b: Expression) -> Expression:
    """The smaller of two values."""
    import casadi

    return casadi.fmin(a, b)


def greatest(a: Expression, b: Expression) -> Expression:
    """The larger of two values."""
    import casadi

    return casadi.fmax(a, b)


def choose(condition: Expression, then: Expression, otherwise: Expression) -> Expression:
    """``then`` where the condition holds, else ``otherwise``; both are evaluated."""
    import casadi

    return casadi.if_else(condition, then, otherwise)


def by_mode(mode: Expression, below: Expression, inside: Expression, above: Expression) -> Expression:
    """One of three values, for a switch's mode of -1, 0 and +1."""
    return choose(mode > 0, above, choose(mode < 0, below, inside))


def select(index: Expression, values: list[float]) -> Expression:
    """The value at a whole ``index``; the last one beyond the end."""
    chosen: Expression = values[-1]
    for i in range(len(values) - 2, -1, -1):
        chosen = choose(index < i + 1, values[i], chosen)
    return chosen


def polyline(x: Expression, lower: Expression, upper: Expression, values: Sequence[Expression]) -> Expression:
    """Straight lines through values at equal distances from lower to upper; the end values hold beyond.

    Args:
        x: where.
        lower: first abscissa.
        upper: last abscissa.
        values: at least two.
    """
    width = (upper - lower) / (len(values) - 1)
    slopes = [0.0, *((b - a) / width for a, b in itertools.pairwise(values)), 0.0]
    total = values[0]
    for k in range(len(values)):
        total = total + (slopes[k + 1] - slopes[k]) * greatest(x - lower - k * width, 0.0)
    return total


def hats(x: Expression, places: Sequence[Expression]) -> list[Expression]:
    """Weights of linear interpolation between values at ``places``, one each: 1 at its own place and 0 at the others.

    They add up to 1; beyond the ends the end's weight stays 1.

    Args:
        x: where.
        places: rising, at least two.
    """
    weights: list[Expression] = []
    for k, place in enumerate(places):
        weight: Expression = 1.0
        if k > 0:
            weight = (x - places[k - 1]) / (place - places[k - 1])
        if k + 1 < len(places):
            falling = (places[k + 1] - x) / (places[k + 1] - place)
            weight = least(weight, falling)
        weights.append(greatest(least(weight, 1.0), 0.0))
    return weights
