"""Reduced linear models with the error bound stated: balanced truncation and modal truncation.

Balanced truncation by the square-root method works on the asymptotically stable part; poles on the axis or to its right
are kept as they are. The H-infinity error is at most twice the sum of the Hankel singular values left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg

from engine.errors import ParameterError
from engine.linearise import LinearModel
from engine.model import Vector

AXIS = 1e-7
"""Poles with a real part above minus this share of the fastest are kept: integrators do not decay."""


@dataclass(frozen=True)
class Reduction:
    """A reduced model.

    Attributes:
        model: with states ``x1``, ``x2``, ...
        bound: on the largest gain of the difference at any frequency; inf where none is known.
        hankel: Hankel singular values of the stable part, falling; empty for modal truncation.
        kept: number of poles kept because they do not decay.
    """

    model: LinearModel
    bound: float
    hankel: Vector
    kept: int


def reduce(
    linear: LinearModel, order: int | None = None, *, bound: float | None = None, method: str = "balanced"
) -> Reduction:
    """A model with fewer states.

    Args:
        linear: continuous-time.
        order: number of states, those that do not decay included.
        bound: in place of an order: the fewest states whose error is at most this, in the unit of the gain.
        method: ``balanced``, or ``modal``: the slowest modes.

    Raises:
        ParameterError: neither order nor bound, an order that cannot be, an unknown method.
    """
    if method not in ("balanced", "modal"):
        raise ParameterError(f"there is no method '{method}'", remedy="allowed: balanced, modal")
    if (order is None) == (bound is None):
        raise ParameterError("either an order or a bound says how far to reduce", remedy="give one of the two")
    split = _split(linear)
    n, marginal = len(linear.states), split.marginal
    if order is not None and not marginal <= order <= n:
        raise ParameterError(
            f"{order} states cannot be: the model has {n}, of which {marginal} do not decay",
            remedy=f"give {marginal} to {n}",
        )
    return (_balanced if method == "balanced" else _modal)(linear, split, order, bound)


@dataclass(frozen=True)
class _Split:
    """The model apart: ``marginal`` states that do not decay, then the rest, without coupling."""

    A: Any
    B: Any
    C: Any
    marginal: int


def _split(linear: LinearModel) -> _Split:
    A, n = linear.A, len(linear.states)
    limit = -AXIS * max(1.0, float(np.abs(np.linalg.eigvals(A)).max(initial=0.0))) if n else 0.0
    T, Z, k = scipy.linalg.schur(A, output="real", sort=lambda re, im: re >= limit) if n else (A, np.eye(0), 0)
    # Without the coupling block: T11 X - X T22 = -T12.
    X = scipy.linalg.solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < n else np.zeros((k, n - k))
    S = Z @ np.block([[np.eye(k), X], [np.zeros((n - k, k)), np.eye(n - k)]])
    inverse = np.block([[np.eye(k), -X], [np.zeros((n - k, k)), np.eye(n - k)]]) @ Z.T
    apart = T.copy()
    apart[:k, k:] = 0.0
    return _Split(apart, inverse @ linear.B, linear.C @ S, k)


def _joined(linear: LinearModel, split: _Split, A: Any, B: Any, C: Any, D: Any) -> LinearModel:
    """The states that do not decay with a reduced rest."""
    k = split.marginal
    names = tuple(f"x{i + 1}" for i in range(k + len(A)))
    return replace(
        linear,
        A=scipy.linalg.block_diag(split.A[:k, :k], A) if k + len(A) else np.zeros((0, 0)),
        B=np.vstack([split.B[:k], B]),
        C=np.hstack([split.C[:, :k], C]),
        D=D,
        states=names,
        units={name: linear.units.get(name, "") for name in (*linear.inputs, *linear.outputs)},
        moving={},
    )


def _balanced(linear: LinearModel, split: _Split, order: int | None, bound: float | None) -> Reduction:
    k = split.marginal
    A, B, C = split.A[k:, k:], split.B[k:], split.C[:, k:]
    reach, see = _factor(A, B), _factor(A.T, C.T)
    U, sigma, V = np.linalg.svd(see.T @ reach)
    errors = [2 * float(sigma[r:].sum()) for r in range(len(sigma) + 1)]
    if order is None:
        assert bound is not None
        order = k + next((r for r, error in enumerate(errors) if error <= bound), len(sigma))
    r = order - k
    usable = int((sigma > 1e-14 * sigma.max(initial=1e-300)).sum())
    r = min(r, usable)
    root = 1 / np.sqrt(sigma[:r])
    left, right = root[:, None] * (U[:, :r].T @ see.T), (reach @ V[:r].T) * root
    made = _joined(linear, split, left @ A @ right, left @ B, C @ right, linear.D)
    return Reduction(made, errors[min(r, len(errors) - 1)], sigma, k)


def _factor(A: Any, B: Any) -> Any:
    """L with L L' the Gramian of (A, B)."""
    if not len(A):
        return np.zeros((0, 0))
    gram = scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)
    values, vectors = np.linalg.eigh((gram + gram.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _modal(linear: LinearModel, split: _Split, order: int | None, bound: float | None) -> Reduction:
    """The slowest modes; what the others add at rest goes into D.

    The bound is the sum over the modes left out of the largest gain of each, which is |R| / |Re p| for a real pole, and
    the sum of both of a pair for a complex one, twice: once for the mode and once for its gain at rest.
    """
    k = split.marginal
    A, B, C = split.A[k:, k:], split.B[k:], split.C[:, k:]
    poles, vectors = np.linalg.eig(A) if len(A) else (np.zeros(0), np.zeros((0, 0)))
    inverse = np.linalg.inv(vectors) if len(A) else vectors
    residues = [
        float(np.linalg.norm(np.outer(C @ vectors[:, i], inverse[i] @ B), 2)) / max(-poles[i].real, 1e-300)
        for i in range(len(poles))
    ]
    by_size = np.argsort(np.abs(poles), kind="stable")
    cuts = [0]
    while cuts[-1] < len(poles):  # a pair stays together
        i = by_size[cuts[-1]]
        cuts.append(cuts[-1] + (2 if abs(poles[i].imag) > 1e-12 * abs(poles[i]) else 1))
    errors = {r: 2 * math.fsum(residues[i] for i in by_size[r:]) for r in cuts}
    if order is None:
        assert bound is not None
        r = next((r for r in cuts if errors[r] <= bound), len(poles))
    else:
        r = max(c for c in cuts if c <= order - k)
    keep = by_size[:r]
    basis = []
    for i in keep:
        if poles[i].imag > 0:
            basis += [vectors[:, i].real, vectors[:, i].imag]
        elif abs(poles[i].imag) <= 1e-12 * abs(poles[i]):
            basis.append(vectors[:, i].real)
    T = np.column_stack(basis) if basis else np.zeros((len(A), 0))
    rows = []
    for i in keep:
        if poles[i].imag > 0:
            rows += [2 * inverse[i].real, -2 * inverse[i].imag]
        elif abs(poles[i].imag) <= 1e-12 * abs(poles[i]):
            rows.append(inverse[i].real)
    W = np.array(rows) if rows else np.zeros((0, len(A)))
    rest = linear.D.astype(float)
    if len(A):
        whole = -C @ np.linalg.solve(A, B)
        kept = -(C @ T) @ np.linalg.solve(W @ A @ T, W @ B) if r else np.zeros_like(whole)
        rest = rest + whole - kept
    made = _joined(linear, split, W @ A @ T, W @ B, C @ T, rest)
    return Reduction(made, errors[r], np.zeros(0), k)
