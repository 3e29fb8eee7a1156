"""Solve for accelerations symbolically, by a sparse LDL' factorisation ordered to leave little work for each step.

Rows that depend on parameters only are eliminated first, then those that a stuck joint may mask, then those that change
with the configuration. The code generator computes what depends on parameters once per parameter set, so the order
decides how much of the factorisation is left for every step. Where the factors of the first rows are full, as for modes
of a link with a payload, their inverse is used instead of the factors: it takes as many products, and they do not wait
for each other.
"""

from __future__ import annotations

import casadi as ca

from engine.ports import Expression


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
    known = _known(parameters), _known(ca.vertcat(ca.SX(0, 1), *modes))
    late = [_level(matrix[i, i], *known) for i in range(n)]
    groups = [[i for i in range(n) if late[i] == level] for level in (0, 1, 2)]
    first, rest = groups[0], groups[1] + groups[2]
    inverse = _full_inverse(matrix[first, first])
    if inverse is not None and _level(matrix[first, :], *known) < 2:
        ties = inverse @ matrix[first, rest]
        others = ca.SX(0, 1)
        if rest:
            reduced = matrix[rest, rest] - matrix[rest, first] @ ties
            others = solve(reduced, right[rest] - ties.T @ right[first], parameters, modes)
        found = ca.vertcat(inverse @ right[first] - ties @ others, others)
        return found[sorted(range(n), key=(first + rest).__getitem__)]
    order: list[int] = []
    for group in groups:
        if group:
            order += [group[k] for k in matrix[group, group].sparsity().amd()]
    diagonal, upper, permutation = ca.ldl(matrix[order, order], False)
    solution = ca.ldl_solve(right[order], diagonal, upper, permutation)
    back = sorted(range(n), key=order.__getitem__)
    return solution[back]


def _full_inverse(matrix: Expression) -> Expression | None:
    """The inverse of a symmetric matrix of more than one row, if its factors are as full; else None."""
    n = matrix.shape[0]
    if n < 2:
        return None
    diagonal, upper, permutation = ca.ldl(matrix, False)
    if 2 * upper.nnz() + n < n * n:
        return None
    inverse = ca.ldl_solve(ca.SX.eye(n), diagonal, upper, permutation)
    return ca.tril2symm(ca.tril(inverse))


def _known(symbols: Expression) -> frozenset[int]:
    return frozenset(symbol.element_hash() for symbol in ca.symvar(symbols))


def _level(entry: Expression, fixed: frozenset[int], switched: frozenset[int]) -> int:
    """0 for parameters only, 1 with modes, 2 with anything else."""
    found = {symbol.element_hash() for symbol in ca.symvar(entry)} - fixed
    return 0 if not found else 1 if found <= switched else 2
