"""The exact response of a second-order system to an input held over one period."""

from __future__ import annotations

from blocks.symbolic import choose, cos, cosh, exp, magnitude, sin, sinh, sqrt
from engine.ports import Expression

Pair = tuple[Expression, Expression]


def held_response(corner: Expression, damping_ratio: Expression, period: float) -> tuple[Pair, Pair, Pair]:
    """Coefficients of x1' = x2, x2' = -w^2 x1 - 2 zeta w x2 + u for u held over a period.

    Args:
        corner: w (rad/s).
        damping_ratio: zeta, zero or more.
        period: T (s).

    Returns:
        Rows ((a11, a12), (a21, a22), (b1, b2)): x1 after = a11 x1 + a12 x2 + b1 u, x2 after = a21 x1 + a22 x2 + b2 u.
    """
    w, decay = corner, damping_ratio * corner
    # exp(A T) = exp(-decay T) (C I + S (A + decay I)), C and S the cosine and sine of the damped motion; beyond
    # critical damping they are hyperbolic, and near it S is T.
    square = w**2 - decay**2
    beta = sqrt(magnitude(square)) * period
    oscillates, critical = square > 0, beta < 1e-6
    safe = choose(critical, 1.0, beta)
    c = choose(critical, 1.0, choose(oscillates, cos(beta), cosh(choose(oscillates, 0.0, beta))))
    s = period * choose(critical, 1.0, choose(oscillates, sin(beta), sinh(choose(oscillates, 0.0, beta))) / safe)
    fade = exp(-decay * period)
    a11, a12 = fade * (c + decay * s), fade * s
    a21, a22 = -fade * w**2 * s, fade * (c - decay * s)
    return (a11, a12), (a21, a22), ((1 - a11) / w**2, a12)
