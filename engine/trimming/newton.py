"""Newton's method in one set of modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from engine.model import Vector
from engine.trimming.equations import RANK, allowed, equations
from engine.trimming.problem import Problem

Array = Any


def newton(
    problem: Problem, begin: Vector, m: Vector, thorough: bool, stuck_at: Vector | None = None
) -> tuple[Vector, Array, str]:
    """Unknowns and Jacobian in given modes, and the equation that is not met, in words; empty if all are."""
    worst, z, J = "", begin, np.zeros((0, 0))
    for stuck_free in (False, True) if problem.stuck(m) and problem.fix else (False,):
        r0, J0, _ = equations(problem, begin, m, stuck_free, stuck_at)
        if not (np.isfinite(r0).all() and np.isfinite(J0).all()):
            return begin, J0, "the rates at the start are not finite"
        scale = 1 / np.maximum(np.linalg.norm(J0, axis=1), np.maximum(np.abs(r0), 1e-12))

        def residual(z: Vector, free: bool = stuck_free, scale: Vector = scale) -> Vector:
            return np.nan_to_num(
                equations(problem, z, m, free, stuck_at)[0] * scale, nan=1e30, posinf=1e30, neginf=-1e30
            )

        def slope(z: Vector, free: bool = stuck_free, scale: Vector = scale) -> Array:
            return np.nan_to_num(equations(problem, z, m, free, stuck_at)[1] * scale[:, None])

        z = _minimise(problem, residual, slope, begin, thorough)
        r, J, names = equations(problem, z, m, stuck_free, stuck_at)
        over = np.abs(r) / allowed(z, J)
        if np.isfinite(r).all() and over.max(initial=0.0) <= 1:
            return z, J, ""
        k = int(np.argmax(np.where(np.isfinite(over), over, np.inf)))
        worst = (
            f"'{names[k]}' cannot be met, {r[k]:.3g} is left"
            if k >= problem.n
            else f"the rate of '{names[k]}' cannot be brought below {abs(r[k]):.3g} per second"
        )
    return z, J, worst


def _minimise(problem: Problem, residual: Any, slope: Any, begin: Vector, thorough: bool) -> Vector:
    """Gauss-Newton with steps of least length, so that what nothing determines stays; then scipy's trust region."""
    z = begin.copy()
    for _ in range(30):
        r, J = residual(z), slope(z)
        move = -np.linalg.lstsq(J, r, rcond=RANK)[0]
        cost, share = float(r @ r), 1.0
        while share > 1e-4:
            there = np.clip(z + share * move, problem.low, problem.high)
            found = residual(there)
            if float(found @ found) <= cost * (1 - 1e-4 * share) or float(found @ found) < 1e-28:
                break
            share /= 2
        else:
            break
        done = np.abs(there - z).max(initial=0.0) <= 1e-13 * (1 + np.abs(z).max(initial=0.0))
        z = there
        if done or float(found @ found) == 0.0:
            return np.asarray(z)
    if float(residual(z) @ residual(z)) < 1e-24 or not len(z) or not thorough:
        return np.asarray(z)
    inside = np.clip(z, np.nextafter(problem.low, np.inf), np.nextafter(problem.high, -np.inf))
    found = least_squares(
        residual, inside, slope, (problem.low, problem.high), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return np.asarray(found.x)
