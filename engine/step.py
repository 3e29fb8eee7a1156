"""Choose the internal step from the fastest mode, with contacts closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.model import FRICTION, SWITCH, Model, Vector

STEP_PER_RATE = 0.5
"""Internal step times the fastest rate; RK4 is stable up to 2.78, and loses 1e-4 of a cycle's phase at 0.5."""


SAME = 1e-6
"""Rates and shares that differ by no more than this fraction are equal."""


@dataclass(frozen=True)
class Fastest:
    """The fastest mode of a model.

    Attributes:
        rate: |eigenvalue| (1/s), zero for a model without dynamics.
        state: the state that takes the largest part in it; the first of several that take the same part.
    """

    rate: float
    state: str


def fastest(model: Model, p: Vector, x: Vector) -> Fastest:
    """The fastest mode at ``x`` with joints sliding, over switches open and closed to either side."""
    e = model.equations
    found = Fastest(0.0, "")
    for level in (0.0, 1.0, -1.0):
        m = [{FRICTION: 1.0, SWITCH: level}.get(mode.kind, 0.0) for mode in model.modes]
        matrix = model.jacobian(0, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), m, p)
        matrix = np.array(matrix.full())
        if not matrix.size or not np.isfinite(matrix).all():
            continue
        try:
            values, vectors = np.linalg.eig(matrix)
        except np.linalg.LinAlgError:  # numbers too large or too small; the run itself reports what fails
            continue
        sizes = np.abs(values)
        rate = float(sizes.max())
        if rate > found.rate:
            # Which of several equal eigenvalues comes first, and which of equal shares is larger, is rounding.
            alike = sizes >= (1 - SAME) * rate
            share = np.abs(vectors[:, alike]).max(axis=1) * np.linalg.norm(matrix, axis=0)
            lead = model.states[int(np.argmax(share >= (1 - SAME) * share.max()))].name
            found = Fastest(rate, found.state if found.state and rate <= (1 + SAME) * found.rate else lead)
    return found


def internal_step(model: Model, p: Vector, x: Vector, step: float) -> float:
    """A step (s) no longer than ``step`` that resolves the fastest mode."""
    rate = fastest(model, p, x).rate
    return min(step, STEP_PER_RATE / rate) if rate > 0 else step
