"""The equations of a trim problem in one set of modes."""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.model import Vector
from engine.trimming.problem import Problem

Array = Any

RESIDUAL = 1e-8
"""An equation is met when what is left is below this share of its terms."""

RANK = 1e-9
"""Singular values below this share of the largest are zero, rows and columns scaled."""


def equations(
    problem: Problem, z: Vector, m: Vector, stuck_free: bool, stuck_at: Vector | None = None
) -> tuple[Vector, Array, list[str]]:
    """What is left of each equation, its Jacobian by z, and the names of the equations."""
    model = problem.model
    x, d, reads, u, slide = problem.unpack(z)
    fire = np.concatenate([np.ones(len(model.clocks)), reads])
    values = problem.function(problem.point.t, x, u, d, m, problem.p, fire)
    f, y, after, entering, *slopes = (np.array(v.full()) for v in values)
    by = [np.hstack(slopes[4 * k : 4 * k + 4]) for k in range(4)]  # of f, y, after, entering by x, d, fire, u
    columns = _columns(problem, by)
    f, y, after, entering = f.ravel(), y.ravel(), after.ravel(), entering.ravel()
    rest = [np.zeros((len(block), problem.slides.shape[1])) for block in columns]
    N = problem.slides
    rows = [f - N @ slide]
    J = [np.hstack([columns[0], -N])]
    names = [v.name for v in model.states]
    if problem.n_d:
        identity = np.eye(len(z))[problem.n : problem.n + problem.n_d]
        rows.append(after - d)
        J.append(np.hstack([columns[2], rest[2]]) - identity)
        names += [v.name for v in model.memories]
    if len(problem.lines):
        index = [i for i, line in enumerate(model.lines) for _ in line.stages]
        identity = np.eye(len(z))[problem.n + problem.n_d : problem.n + problem.n_d + len(problem.lines)]
        rows.append(entering[index] - reads)
        J.append(np.hstack([columns[3], rest[3]])[index] - identity)
        names += [f"{line.name} (delay)" for line in problem.lines]
    n_q = model.coordinates
    for (kind, index, value), name in zip(problem.targets, problem.fix, strict=True):
        row = np.zeros(len(z))
        if kind == "state":
            row[index] = 1.0
            left = z[index] - value
        elif kind == "output":
            row[:] = np.hstack([columns[1], rest[1]])[index]
            left = y[index] - value
        else:
            motion, order = index
            row[order * n_q : (order + 1) * n_q] = np.array(model.functions["transform"](problem.p).full())[motion]
            offset = np.array(model.functions["imposed"](problem.point.t, x, u, d, m, problem.p).full()).reshape(2, -1)
            left = row @ z + offset[order, motion] - value
        rows.append(np.array([left]))
        J.append(row[None])
        names.append(f"{name} = {value:g}")
    held = problem.stuck(m)
    n_q = model.coordinates
    for c in held:  # a stuck joint: its speed is zero, its rates are no equations
        row = np.zeros(len(z))
        row[n_q + c] = 1.0
        for k, left in ((c, 0.0), (n_q + c, z[n_q + c])):
            J[0][k], rows[0][k] = (row, left) if k != c else (0.0, 0.0)
        if not stuck_free:
            J[0][c, c], rows[0][c] = 1.0, z[c] - (problem.start if stuck_at is None else stuck_at)[c]
        rows.append(problem.slides[[c]] @ slide)
        J.append(np.concatenate([np.zeros(len(z) - len(slide)), problem.slides[c]])[None])
        names.append(f"{model.states[c].name} stands still")
    return np.concatenate(rows), np.vstack(J), names


def allowed(z: Vector, J: Array) -> Vector:
    """What may be left of each equation that is met."""
    return np.asarray(1e-10 + RESIDUAL * (np.abs(J) @ np.maximum(np.abs(z), 1e-3)))


def _columns(problem: Problem, by: list[Array]) -> list[Array]:
    """Slopes by (x, d, fire, u) as slopes by z without the slides."""
    ends = [problem.n, problem.n + problem.n_d]
    first = ends[1] + len(problem.model.clocks)
    inputs = first + len(problem.lines)
    keep = [*range(ends[1]), *range(first, inputs), *(inputs + k for k in problem.free)]
    return [block[:, keep] for block in by]
