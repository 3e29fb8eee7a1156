"""Functions for writing laws on symbols. CasADi is imported when a law is stamped, not when a block is named."""

from __future__ import annotations

from engine.block import Expression


def exp(x: Expression) -> Expression:
    """Exponential."""
    import casadi

    return casadi.exp(x)


def sin(x: Expression) -> Expression:
    """Sine."""
    import casadi

    return casadi.sin(x)


def sqrt(x: Expression) -> Expression:
    """Square root."""
    import casadi

    return casadi.sqrt(x)


def floor(x: Expression) -> Expression:
    """Largest whole number that is not above ``x``."""
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
