"""Functions for writing a block's law on symbols, such as `by_mode` and `polyline`; for packages that add blocks.

    from flexarm import symbolic

    torque = self.stiffness * symbolic.sin(self.shaft.angle)

On numbers they work as well. `Expression` is the type of what they take and return.
"""

from blocks.symbolic import (
    by_mode,
    choose,
    cos,
    cosh,
    exp,
    expm1,
    floor,
    greatest,
    hats,
    least,
    log,
    magnitude,
    polyline,
    select,
    sin,
    sinh,
    sqrt,
)
from engine.ports import Expression

__all__ = [
    "Expression",
    "by_mode",
    "choose",
    "cos",
    "cosh",
    "exp",
    "expm1",
    "floor",
    "greatest",
    "hats",
    "least",
    "log",
    "magnitude",
    "polyline",
    "select",
    "sin",
    "sinh",
    "sqrt",
]
