"""The modes in which an equilibrium holds: those whose guards are violated change, and it is solved again."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from engine.errors import TrimError
from engine.linearise import modes_at
from engine.model import FRICTION, TIME, Mode, Model, Vector
from engine.trimming.newton import newton
from engine.trimming.problem import Problem

Array = Any

GUARD = 1e-7
"""A guard that is violated by less than this share of its change over the span of its arguments holds."""


def solve(problem: Problem, begin: Vector, thorough: bool = True) -> tuple[Vector, Vector, Array]:
    """Unknowns, modes and Jacobian at the equilibrium that is reached from ``begin``."""
    x, d, _, u, _ = problem.unpack(begin)
    m = modes_at(problem.model, problem.point.t, x, u, d, problem.p, problem.asked)
    tried: list[tuple[float, ...]] = []
    worst = ""
    z = begin
    while tuple(m) not in tried and len(tried) < 4 * len(m) + 20:
        tried.append(tuple(m))
        z, J, worst = newton(problem, begin, m, thorough)
        if worst:
            break
        wrong = _violated(problem, z, m)
        if wrong is None:
            return _settled(problem, z, m, J)
        k, side = wrong
        m = m.copy()
        m[k] = 0 if m[k] != 0 else side
    for trial in _combinations(problem, tried) if thorough else []:
        z, J, failed = newton(problem, begin, trial, thorough)
        if not failed and _violated(problem, z, trial) is None:
            return z, trial, J
    raise _none(problem, worst, m)


def _settled(problem: Problem, z: Vector, m: Vector, J: Array) -> tuple[Vector, Vector, Array]:
    """The same with joints stuck that are said to slide and stand still: at their level of friction they hold."""
    still = m.copy()
    for k, mode in enumerate(problem.model.modes):
        if mode.kind == FRICTION and m[k] and mode.name not in problem.asked:
            still[k] = 0.0 if abs(z[problem.model.coordinates + mode.coordinate]) < 1e-9 else m[k]
    if (still == m).all() or _violated(problem, z, still) is not None:
        return z, m, J
    there, J_there, worst = newton(problem, z, still, False, z)
    return (z, m, J) if worst or _violated(problem, there, still) is not None else (there, still, J_there)


def _combinations(problem: Problem, tried: list[tuple[float, ...]]) -> list[Vector]:
    """Other sets of modes to try, where following the guards led nowhere; none where there are too many."""
    asked, choices = problem.asked, []
    for k, mode in enumerate(problem.model.modes):
        fixed = mode.name in asked or mode.kind == TIME
        choices.append((tried[0][k],) if fixed else (0.0, 1.0, -1.0))
    if math.prod(len(c) for c in choices) > 243:
        return []
    return [np.array(c) for c in itertools.product(*choices) if c not in tried]


def _none(problem: Problem, worst: str, m: Vector) -> TrimError:
    said = ", ".join(f"'{mode.name}' {label}" for mode, label in labels(problem.model, m).items())
    if worst:
        return TrimError(
            f"there is no equilibrium: {worst}" + (f" (with {said})" if said else ""),
            remedy=_remedy(problem),
        )
    return TrimError(
        f"no combination of modes has an equilibrium in which it holds (the last: {said})",
        remedy="give a mode (--mode), another start (--at), or a free input (--free)",
    )


def _remedy(problem: Problem) -> str:
    names = [v.name for j, v in enumerate(problem.model.inputs) if j not in problem.free]
    say = f"let an input be searched for (--free {names[0]}), " if names else ""
    return f"{say}fix less, widen the bounds, or begin elsewhere (--at)"


def labels(model: Model, m: Vector) -> dict[Mode, str]:
    """Modes of a model, those that follow the time left out, and the label of each."""
    return {mode: mode.labels[int(v) + 1] for mode, v in zip(model.modes, m, strict=True) if mode.kind != TIME}


def _violated(problem: Problem, z: Vector, m: Vector) -> tuple[int, float] | None:
    """The mode whose guard is most violated, and the side to which it leaves; None if all hold."""
    x, d, _, u, _ = problem.unpack(z)
    g = np.array(problem.model.functions["guards"](problem.point.t, x, u, d, m, problem.p).full()).ravel()
    names = [mode.name for mode in problem.model.modes]
    rows = [k for k in range(len(g) // 2) if names[k] not in problem.asked]
    worst = max(rows, key=lambda k: max(g[2 * k], g[2 * k + 1]), default=None)
    if worst is None or max(g[2 * worst], g[2 * worst + 1]) <= GUARD:
        return None
    return worst, 1.0 if g[2 * worst] >= g[2 * worst + 1] else -1.0
