"""The operations that models are made of, as C, and numbers as C; ``fa_...`` are in ``functions.c``."""

from __future__ import annotations

import casadi as ca

BINARY = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_AND: "(double)({0} != 0 && {1} != 0)",
    ca.OP_OR: "(double)({0} != 0 || {1} != 0)",
    ca.OP_IF_ELSE_ZERO: "({0} != 0 ? {1} : 0.0)",
    ca.OP_FMIN: "fa_min({0}, {1})",
    ca.OP_FMAX: "fa_max({0}, {1})",
    ca.OP_FMOD: "fmod({0}, {1})",
    ca.OP_REMAINDER: "remainder({0}, {1})",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_HYPOT: "hypot({0}, {1})",
}
UNARY = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_NOT: "(double)({0} == 0)",
    ca.OP_FABS: "fabs({0})",
    ca.OP_SIGN: "fa_sign({0})",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_EXP: "fa_exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_ASINH: "asinh({0})",
    ca.OP_ACOSH: "acosh({0})",
    ca.OP_ATANH: "atanh({0})",
    ca.OP_ERF: "erf({0})",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
}
COSTLY = frozenset(UNARY) - {ca.OP_ASSIGN, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_NOT, ca.OP_FABS, ca.OP_SIGN}
COSTLY |= {ca.OP_DIV, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_ATAN2, ca.OP_HYPOT}
"""Operations that take many times as long as an addition."""
CALLED = COSTLY - {ca.OP_DIV, ca.OP_INV, ca.OP_SQRT}
"""Those of them that are functions of the C library."""
CALL = 20
"""How many additions and multiplications, among others of their kind, take as long as a sine; measured."""


def literal(value: float) -> str:
    """A number as C, to its last bit."""
    if value != value:
        return "(0.0/0.0)"
    if value in (float("inf"), float("-inf")):
        return "(1.0/0.0)" if value > 0 else "(-1.0/0.0)"
    text = repr(value)
    return f"({text})" if value < 0 else text
