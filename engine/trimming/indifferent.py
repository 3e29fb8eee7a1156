"""Directions of the states on which nothing depends, as the angle of a shaft that turns freely."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from engine.model import Model, Vector

Array = Any


def indifferent(model: Model, p: Vector) -> Array:
    """Directions of the states on which neither rates nor guards depend, orthonormal columns, shape (states, k).

    Found at six random points, so that a slope that is zero at one point alone does not count.
    """
    n, e = len(model.states), model.equations
    slope = model.derived("rate_slopes", lambda e: [ca.densify(ca.jacobian(ca.vertcat(e.derivative, e.guards), e.x))])
    random, rows = np.random.default_rng(1), [np.zeros((1, n))]
    for _ in range(6):
        x, m = random.normal(0, 1, n), random.choice([-1.0, 0.0, 1.0], len(model.modes))
        J = slope(0.1, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), m, p).full()
        size = np.linalg.norm(J, axis=1)
        usable = np.isfinite(size) & (size > 0)
        rows.append(J[usable] / size[usable, None])
    return scipy.linalg.null_space(np.vstack(rows), rcond=1e-9) if n else np.zeros((0, 0))
