"""Further starts of the search, from which other equilibria are reached."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.errors import ParameterError, TrimError
from engine.model import Vector
from engine.trimming.equations import allowed, equations
from engine.trimming.modes import solve
from engine.trimming.problem import Problem

Array = Any

FAR = 1e4
"""A solution that lies this many times farther from the start than its own start did is none of the machine's."""


def further_solutions(
    problem: Problem, random: np.random.Generator, tries: int
) -> Iterator[tuple[Vector, Vector, Array]]:
    """Solutions from other starts; those far beyond the starts are artefacts of the laws, not of the machine."""
    for _ in range(tries):
        begin = _spread(problem, random)
        try:
            z, m, J = solve(problem, begin, thorough=False)
        except (TrimError, ParameterError):
            continue
        far = np.abs(z - problem.start)[: problem.n] > FAR * np.maximum(1.0, np.abs(begin - problem.start)[: problem.n])
        if not far.any():
            yield _near(problem, z, m, J)


def distance(problem: Problem, z: Vector) -> float:
    """How far a solution lies from the start."""
    return float(np.linalg.norm((z - problem.start)[: problem.n + problem.n_d]))


def _spread(problem: Problem, random: np.random.Generator) -> Vector:
    """Another start: angles within half a turn, slides and modes within a centimetre, the rest about theirs."""
    z, n_q = problem.start.copy(), problem.model.coordinates
    reach = [math.pi if v.unit == "rad" else 0.01 for v in problem.model.states[:n_q]]
    size = np.concatenate([reach, np.zeros(n_q), np.full(len(z) - 2 * n_q, 0.5)])
    size[2 * n_q :] *= 1 + np.abs(z[2 * n_q :])
    z = z + size * random.uniform(-1, 1, len(z))
    inside = np.isfinite(problem.low) & np.isfinite(problem.high)
    z[inside] = random.uniform(problem.low[inside], problem.high[inside])
    z = np.clip(z, problem.low, problem.high)
    return np.asarray(np.where([m == "held" for m in _held(problem)], problem.start, z))


def _held(problem: Problem) -> list[str]:
    fixed = {index for kind, index, _ in problem.targets if kind == "state"}
    return ["held" if i in fixed else "" for i in range(len(problem.start))]


def _near(problem: Problem, z: Vector, m: Vector, J: Array) -> tuple[Vector, Vector, Array]:
    """The same equilibrium within half a turn of the start, where whole turns make no difference."""
    n_q = problem.model.coordinates
    turns = np.round((z - problem.start)[:n_q] / (2 * math.pi))
    turns *= [v.unit == "rad" for v in problem.model.states[:n_q]]
    there = z.copy()
    there[:n_q] -= 2 * math.pi * turns
    if not turns.any():
        return z, m, J
    r, J_there, _ = equations(problem, there, m, True)
    return (there, m, J_there) if (np.abs(r) <= allowed(there, J_there)).all() else (z, m, J)
