"""Starting values that belong to a recording: where they begin, and how those of held-out recordings are found."""

from __future__ import annotations

import math

import numpy as np

from diagnosis.estimation.problem import HUGE, Array, Experiment, FreeParameter, Problem
from diagnosis.recordings.columns import RecordingError
from diagnosis.recordings.mapping import Recording
from engine.errors import SimulationError, nearest
from engine.model import Model
from engine.ports import MOTION
from engine.start import start_values, starting_names

FIRST = 16
"""Samples through which the parabola goes whose slope is that at the start."""

USUAL = 0.05
"""Scale (SI) of a starting value that no measurement speaks of, such as the twist of a joint."""

_RATES = [(f".{names[1][0]}", f".{names[0][0]}") for names in MOTION.values()]


def starting_values(model: Model, recording: Recording, measured: Array) -> dict[str, float]:
    """Where the free starting values of a recording begin: at its first sample and slope if they are measured.

    Args:
        model: of the experiment.
        recording: names them.
        measured: shape (samples, signals), in the model's units.

    Raises:
        RecordingError: a name that has no starting value.
    """
    known = starting_names(model)
    made: dict[str, float] = {}
    at_rest = dict(zip((s.name for s in model.states), start_values(model, model.parameter_values), strict=True))
    for name in recording.free:
        if name not in known:
            raise RecordingError(
                f"'{name}' in 'initial: free' of recording '{recording.name}' has no starting value",
                remedy=nearest(name, known),
            )
        made[name] = _first(model, name, recording, measured, float(model.initial.get(name, at_rest.get(name, 0.0))))
    return made


def _first(model: Model, name: str, recording: Recording, measured: Array, otherwise: float) -> float:
    names = [v.name for v in model.outputs]
    whole = [k for k, c in enumerate(recording.measurements) if not c.from_first]
    for k in whole:
        there = np.flatnonzero(np.isfinite(measured[:, k]))[:FIRST]
        if names[k] == name and there.size:
            return float(measured[there[0], k])
    for rate, motion in _RATES:
        if name.endswith(rate) and name.removesuffix(rate) + motion in names:
            column = measured[:, names.index(name.removesuffix(rate) + motion)]
            there = np.flatnonzero(np.isfinite(column))[:FIRST]
            if there.size > 3:
                return float(np.polyfit(recording.time[there], column[there], 2)[1])
    return otherwise


def free_starts(experiment: Experiment) -> list[FreeParameter]:
    """The free starting values of an experiment, as parameters with a wide prior."""
    rows = []
    for name in experiment.free:
        value = experiment.initial.get(name, 0.0)
        rows.append(FreeParameter(name, value, max(0.1 * abs(value), USUAL), False, recording=experiment.name))
    return rows


def settled(problem: Problem, x: Array, iterations: int = 20) -> Array:
    """The search vector with the starting values of held-out recordings fitted, everything else frozen.

    A held-out recording begins in a state of its own, which no other recording tells. It is fitted to the whole of it:
    a few numbers, against thousands of samples.

    Args:
        problem: with experiments of all roles.
        x: search vector.
        iterations: at most, per experiment.
    """
    x = x.copy()
    for e in problem.chosen("hold_out"):
        mine = [i for i, f in enumerate(problem.free) if f.recording == e.name]
        if mine:
            x[mine] = _own(problem, x, e, mine, iterations)
    return x


def _own(problem: Problem, x: Array, e: Experiment, mine: list[int], iterations: int) -> Array:
    damping, x = 1e-3, x.copy()
    cost = float(np.sum(problem.residual(x, e) ** 2))
    for _ in range(iterations):
        try:
            r, J = problem.linearised(x, e)
        except SimulationError:
            break
        J = J[:, mine]
        H, g = J.T @ J + np.eye(len(mine)), J.T @ r + x[mine]
        for _ in range(8):
            trial = x.copy()
            trial[mine] -= np.clip(np.linalg.solve(H + damping * np.diag(np.diag(H)), g), -10.0, 10.0)
            there = float(np.sum(problem.residual(trial, e) ** 2))
            if there < cost:
                break
            damping *= 5
        else:
            break
        gain, x, cost, damping = cost - there, trial, there, max(damping / 10, 1e-9)
        if gain < max(1e-3, 1e-6 * cost) or not math.isfinite(cost) or cost > HUGE**2:
            break
    return x[mine]
