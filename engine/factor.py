"""Solving for accelerations with symbols: a sparse LDL' whose order keeps work out of the right-hand side.

Rows that depend on parameters only are eliminated first, then those that a stuck joint may mask, then those that change
with the configuration. The code generator computes what depends on parameters once per parameter set, so the order
decides how much of the factorisation is left for every step.
"""

from __future__ import annotations

import casadi as ca

from engine.block import Expression


def solve(matrix: Expression, right: Expression, parameters: Expression, modes: list[Expression]) -> Expression:
    """``matrix^-1 right`` for a symmetric positive definite SX matrix.

    Args:
        matrix: shape (n, n).
        right: shape (n, 1).
        parameters: symbols whose functions are free of cost.
        modes: symbols whose functions cost only at a switch.
    """
    n = matrix.shape[0]
    matrix = ca.sparsify(matrix)
    late = [_level(matrix[i, i], parameters, modes) for i in range(n)]
    order: list[int] = []
    for level in (0, 1, 2):
        group = [i for i in range(n) if late[i] == level]
        if group:
            order += [group[k] for k in matrix[group, group].sparsity().amd()]
    diagonal, upper, permutation = ca.ldl(matrix[order, order], False)
    solution = ca.ldl_solve(right[order], diagonal, upper, permutation)
    back = sorted(range(n), key=order.__getitem__)
    return solution[back]


def _level(entry: Expression, parameters: Expression, modes: list[Expression]) -> int:
    """0 for parameters only, 1 with modes, 2 with anything else."""
    fixed = {symbol.element_hash() for symbol in ca.symvar(parameters)}
    switched = {symbol.element_hash() for symbol in modes}
    found = {symbol.element_hash() for symbol in ca.symvar(entry)} - fixed
    return 0 if not found else 1 if found <= switched else 2
