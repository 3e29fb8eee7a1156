"""What an equilibrium leaves open: states that stay where the search began, and which solutions are the same."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.linalg

from engine.errors import TrimError
from engine.model import Vector
from engine.trimming.equations import RANK
from engine.trimming.problem import Problem

Array = Any

STEADY = "steady motion"
"""Of shafts that turn without end."""


def kept_states(problem: Problem, z: Vector, m: Vector, J: Array) -> dict[str, str]:
    """States that stay where the search began, and why.

    Raises:
        TrimError: more is left open than stuck joints and what nothing depends on.
    """
    names = [v.name for v in (*problem.model.states, *problem.model.memories)]
    names += [f"{line.name} (delay)" for line in problem.lines] + [problem.model.inputs[j].name for j in problem.free]
    names += [STEADY] * problem.slides.shape[1]
    kept = {names[c]: "stuck" for c in problem.stuck(m)}
    J = np.nan_to_num(J)
    rows = np.linalg.norm(J, axis=1)
    scaled = J[rows > 0] / rows[rows > 0, None]
    columns = np.linalg.norm(scaled, axis=0) if len(scaled) else np.ones(len(z))
    columns = np.where(columns > 0, columns, 1.0)
    open_ = scipy.linalg.null_space(np.vstack([scaled / columns, np.zeros((1, len(z)))]), rcond=RANK)
    open_ = open_ / columns[:, None]
    basis = _indifferent(problem, m, len(z))
    left = open_ - basis @ (basis.T @ open_)
    size = np.linalg.norm(left, axis=0) / np.maximum(np.linalg.norm(open_, axis=0), 1e-300)
    if (size > 1e-6).any():
        vector = left[:, int(np.argmax(size))]
        order = np.argsort(-np.abs(vector))
        several = [names[i] for i in order if abs(vector[i]) > 0.05 * np.abs(vector).max()][:4]
        told = [name if name == STEADY else f"'{name}'" for name in several]
        states = [v.name for v in problem.model.states]
        known = sorted((name for name in several if name != STEADY), key=lambda name: name not in states)
        such = f" --fix '{known[0]}={z[names.index(known[0])]:g}'" if known else " a state of them with --fix"
        raise TrimError(
            f"the equilibrium is not unique: {' and '.join(told)} "
            f"can {'change together' if len(several) > 1 else 'take any value'}",
            remedy=f"fix one of them: by flexarm trim{such}, or under fix: in an analysis of kind trim",
        )
    for i in np.flatnonzero(np.abs(open_[: problem.n]).max(axis=1, initial=0.0) > 1e-9):
        kept.setdefault(names[i], "indifferent")
    return kept


def same(problem: Problem, one: Vector, other: Vector, m: Vector) -> bool:
    """Whether two solutions differ in nothing but what is kept, whole turns apart."""
    count = problem.n + problem.n_d + len(problem.lines) + len(problem.free)
    change = (one - other)[:count]
    basis = _indifferent(problem, m, count)
    change = change - basis @ (basis.T @ change)
    n_q = problem.model.coordinates
    turn = [v.unit == "rad" for v in problem.model.states[:n_q]]
    change[:n_q] = np.where(turn, (change[:n_q] + math.pi) % (2 * math.pi) - math.pi, change[:n_q])
    return bool(np.abs(change).max(initial=0.0) < 1e-5 * (1 + np.abs(other[:count]).max(initial=0.0)))


def _indifferent(problem: Problem, m: Vector, size: int) -> Array:
    """Orthonormal directions of the unknowns along which a solution may lie anywhere, shape (size, k)."""
    known = np.zeros((size, problem.slides.shape[1] + len(problem.stuck(m))))
    known[: problem.n, : problem.slides.shape[1]] = problem.slides
    for k, c in enumerate(problem.stuck(m)):
        known[c, problem.slides.shape[1] + k] = 1.0
    return scipy.linalg.orth(known) if known.size else np.zeros((size, 0))
