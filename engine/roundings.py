"""Roundings in slopes, of linear models and of runs: `floor` and `ceil` count as a gain of 1.

An encoder's or a quantiser's staircase is flat between its steps: its derivative is zero wherever it has one. That is
of no use to a linear model, since it opens the loop that the encoder closes, nor to a fit. Over motions of many steps
the staircase is the straight line through it, with noise of a step's width on top [Widrow 2008]; so the line's slope is
taken.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from engine.ports import Expression

_ROUNDINGS = (ca.OP_FLOOR, ca.OP_CEIL)


def has_rounding(expression: Expression, moved: Expression | None = None) -> bool:
    """Whether a rounding stands in an expression: of anything, or of what depends on some symbols."""
    return bool(expression.numel() and _rounded(_function(expression), ca.symvar(expression), moved))


def jacobian(expression: Expression, symbols: Expression, moved: Expression | None = None) -> Expression:
    """The Jacobian in which each rounding has the slope 1, at the values that the roundings give.

    Args:
        expression: a column, shape (n, 1).
        symbols: a column of symbols, shape (m, 1).
        moved: symbols, such as the states. Where they are given, a rounding of what depends on none of them keeps its
            own slope, which is zero.

    Returns:
        Shape (n, m).
    """
    if not has_rounding(expression, moved):
        return ca.jacobian(expression, symbols)
    relaxed, offsets, values = _relaxed(expression, moved)
    return ca.substitute([ca.jacobian(relaxed, symbols)], [ca.vertcat(*offsets)], [ca.vertcat(*values)])[0]


def _function(expression: Expression) -> Any:
    symbols = ca.symvar(expression)
    return ca.Function("expression", [ca.vertcat(*symbols)] if symbols else [], [ca.densify(expression)])


def _rounded(function: Any, symbols: list[Expression], moved: Expression | None) -> set[int]:
    """Numbers of the instructions that round what depends on some symbols, or anything."""
    among = None if moved is None else {symbol.element_hash() for symbol in ca.symvar(moved)}
    depends: dict[int, bool] = {}  # by the place that an instruction writes to, which a later one may use again
    found = set()
    for k in range(function.n_instructions()):
        operation, inputs = function.instruction_id(k), function.instruction_input(k)
        if operation == ca.OP_OUTPUT:
            continue
        if operation == ca.OP_INPUT:
            here = among is None or symbols[inputs[1]].element_hash() in among
        else:
            here = operation != ca.OP_CONST and any(depends[i] for i in inputs)
        depends[function.instruction_output(k)[0]] = here
        if operation in _ROUNDINGS and (here or among is None):
            found.add(k)
    return found


def _relaxed(expression: Expression, moved: Expression | None) -> tuple[Expression, list[Expression], list[Expression]]:
    """The expression with a symbol c in each rounding r(u): u + c; those symbols, and their values r(u) - u."""
    function, symbols = _function(expression), ca.symvar(expression)
    rounded = _rounded(function, symbols, moved)
    exact: dict[int, Expression] = {}
    free: dict[int, Expression] = {}
    results: list[Expression] = [ca.SX(0)] * expression.numel()
    offsets: list[Expression] = []
    values: list[Expression] = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[outputs[1]] = free[inputs[0]]
            continue
        here = outputs[0]
        if operation == ca.OP_CONST:
            exact[here] = free[here] = ca.SX(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            exact[here] = free[here] = symbols[inputs[1]]
        elif k in rounded:
            below, line = exact[inputs[0]], free[inputs[0]]
            exact[here] = ca.SX.unary(operation, below)
            offsets.append(ca.SX.sym(f"rounding{len(offsets)}"))
            values.append(exact[here] - below)
            free[here] = line + offsets[-1]
        else:
            same = all(exact[i] is free[i] for i in inputs)
            exact[here] = _applied(operation, [exact[i] for i in inputs])
            free[here] = exact[here] if same else _applied(operation, [free[i] for i in inputs])
    return ca.vertcat(*results), offsets, values


def _applied(operation: int, operands: list[Expression]) -> Expression:
    return ca.SX.unary(operation, *operands) if len(operands) == 1 else ca.SX.binary(operation, *operands)
