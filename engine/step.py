"""How fine the internal steps must be: from the fastest mode, contacts closed; and whether they were fine enough."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from engine.model import FRICTION, SWITCH, Model, Vector

STEP_PER_RATE = 0.5
"""Internal step times the fastest rate; RK4 is stable up to 2.78, and loses 1e-4 of a cycle's phase at 0.5."""


@dataclass(frozen=True)
class Fastest:
    """The fastest mode of a model.

    Attributes:
        rate: |eigenvalue| (1/s), zero for a model without dynamics.
        state: the state that takes the largest part in it.
    """

    rate: float
    state: str


def fastest(model: Model, p: Vector, x: Vector, u: Vector | None = None) -> Fastest:
    """The fastest mode at ``x`` and inputs ``u``, joints sliding, over switches open and closed to either side."""
    e = model.equations
    if "jacobian" not in model.functions:
        model.functions["jacobian"] = ca.Function("jacobian", e.arguments, [ca.jacobian(e.derivative, e.x)])
    found = Fastest(0.0, "")
    for level in (0.0, 1.0, -1.0):
        m = [{FRICTION: 1.0, SWITCH: level}.get(mode.kind, 0.0) for mode in model.modes]
        matrix = model.functions["jacobian"](
            0, x, np.zeros(e.u.numel()) if u is None else u, np.zeros(e.d.numel()), m, p
        )
        matrix = np.array(matrix.full())
        if not matrix.size or not np.isfinite(matrix).all():
            continue
        try:
            values, vectors = np.linalg.eig(matrix)
        except np.linalg.LinAlgError:  # numbers out of all proportion; the run itself says where they lead
            continue
        k = int(np.argmax(np.abs(values)))
        if np.abs(values[k]) > found.rate:
            share = np.abs(vectors[:, k]) * np.linalg.norm(matrix, axis=0)
            found = Fastest(float(np.abs(values[k])), model.states[int(np.argmax(share))].name)
    return found


def internal_step(model: Model, p: Vector, x: Vector, step: float, u: Vector | None = None) -> float:
    """A step (s) no longer than ``step`` that resolves the fastest mode; see `fastest`."""
    rate = fastest(model, p, x, u).rate
    return min(step, STEP_PER_RATE / rate) if rate > 0 else step
