"""Solving for accelerations along recursions of velocities, at a cost that grows linearly with the length of a chain.

With z the accelerations of the coordinates, then those of the velocities v_1, v_2, ... in the order they are built on
one another (`engine.stamps.Velocity`), the equations are those of Gauss's principle:

    z minimises z' M z / 2 - f' z        subject to        v_k' = sum c_kj z_j + b_k,  j before k

Two steps alternate from the end of the recursion to its root: a velocity is replaced by what it is built on, which adds
its inertia there, and a coordinate that no velocity needs any more is eliminated by a step of LDL'. Every pivot is a
reduced inertia and positive, so nothing is pivoted. For a serial arm this is the articulated-body recursion.
[Featherstone 2008, ch. 7]; the DeNOC form of the same recursion [Mohan 2010, sec. 2].
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from engine.ports import Expression


def rows_of(matrix: Expression) -> list[dict[int, Expression]]:
    """The entries of a sparse SX matrix by row and column, without those that are constant zeros."""
    rows: list[dict[int, Expression]] = [{} for _ in range(matrix.shape[0])]
    places = matrix.sparsity().get_triplet()
    for i, j, value in zip(*places, matrix.nonzeros(), strict=True):
        if not value.is_zero():
            rows[i][j] = ca.SX(value)
    return rows


class _Elimination:
    """The symmetric system while it shrinks."""

    def __init__(self, matrix: Expression, right: Expression, recursion: Expression, bias: Expression) -> None:
        self.count = matrix.shape[0] - recursion.shape[0]
        self.rows = rows_of(matrix)
        self.right: list[Expression] = ca.vertsplit(right)
        self.terms = rows_of(recursion)
        self.bias: list[Expression] = ca.vertsplit(bias)
        self.steps: list[Callable[[list[Expression]], None]] = []

    def add(self, i: int, j: int, value: Expression) -> None:
        self.rows[i][j] = self.rows[i][j] + value if j in self.rows[i] else value
        if i != j:
            self.rows[j][i] = self.rows[i][j]

    def drop(self, i: int) -> dict[int, Expression]:
        """Take row and column i out; the row's entries off the diagonal."""
        row = {j: value for j, value in self.rows[i].items() if j != i}
        for j in row:
            del self.rows[j][i]
        return row

    def replace(self, velocity: int) -> None:
        """Put ``sum c_j z_j + b`` in place of a velocity's acceleration."""
        here = self.count + velocity
        terms, bias = self.terms[velocity], self.bias[velocity]
        own = self.rows[here].get(here, ca.SX(0))
        row = self.drop(here)
        force = self.right[here] - own * bias
        half = {j: own * c / 2 + row.get(j, ca.SX(0)) for j, c in terms.items()}
        half |= {j: value for j, value in row.items() if j not in terms}
        for j, c in terms.items():
            for k, h in half.items():
                if k == j:
                    self.add(j, j, 2 * c * h)
                elif k not in terms:
                    self.add(j, k, c * h)
                elif k > j:
                    self.add(j, k, c * h + terms[k] * half[j])
            self.right[j] += c * force
        for j, value in row.items():
            self.right[j] -= value * bias

        def recover(z: list[Expression]) -> None:
            z[here] = sum((c * z[j] for j, c in terms.items()), bias)

        self.steps.append(recover)

    def eliminate(self, i: int) -> None:
        """One step of LDL'."""
        inverse = 1 / self.rows[i][i]
        row, right = self.drop(i), self.right[i]
        share = {j: value * inverse for j, value in row.items()}
        for j, value in row.items():
            for k, factor in share.items():
                if k >= j:
                    self.add(j, k, -value * factor)
            self.right[j] -= share[j] * right

        def recover(z: list[Expression]) -> None:
            z[i] = right * inverse - sum((factor * z[j] for j, factor in share.items()), ca.SX(0))

        self.steps.append(recover)


def solve(matrix: Expression, right: Expression, recursion: Expression, bias: Expression) -> Expression:
    """Accelerations of the coordinates and of the velocities.

    Args:
        matrix: M, shape (n + k, n + k), symmetric, positive definite once the velocities are replaced.
        right: f, shape (n + k, 1).
        recursion: c, shape (k, n + k); row k has entries for coordinates and earlier velocities only.
        bias: b, shape (k, 1).

    Returns:
        z, shape (n + k, 1).
    """
    work = _Elimination(matrix, right, recursion, bias)
    n, total = work.count, matrix.shape[0]
    needed = [0] * total
    for terms in work.terms:
        for j in terms:
            needed[j] += 1
    ready = {j for j in range(n) if not needed[j]}
    for velocity in [*reversed(range(total - n)), -1]:
        while ready:
            i = min(ready, key=lambda j: (len(work.rows[j]), j))
            ready.discard(i)
            work.eliminate(i)
        if velocity >= 0:
            work.replace(velocity)
            for j in work.terms[velocity]:
                needed[j] -= 1
                if j < n and not needed[j]:
                    ready.add(j)
    z: list[Expression] = [ca.SX(0)] * total
    for recover in reversed(work.steps):
        recover(z)
    return ca.vertcat(*z)


def gather(residual: Expression, recursion: Expression) -> Expression:
    """Residuals of the coordinates' balances, those of the velocities carried down to what they are built on.

    Args:
        residual: shape (n + k, 1).
        recursion: c, shape (k, n + k).

    Returns:
        Shape (n, 1).
    """
    terms = rows_of(recursion)
    n = residual.shape[0] - len(terms)
    values: list[Expression] = ca.vertsplit(residual)
    for k in reversed(range(len(terms))):
        for j, c in terms[k].items():
            values[j] += c * values[n + k]
    return ca.vertcat(ca.SX(0, 1), *values[:n])


def condense(matrix: NDArray[np.float64], recursion: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mass matrix of the coordinates alone, in numbers: shapes as for `solve`, result (n, n)."""
    n = len(matrix) - len(recursion)
    basis = np.vstack([np.eye(n), np.zeros((len(recursion), n))])
    for k, row in enumerate(recursion):
        basis[n + k] = row @ basis
    return np.asarray(basis.T @ matrix @ basis)
