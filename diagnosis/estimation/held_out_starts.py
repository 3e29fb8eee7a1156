"""Where held-out recordings begin: starting values that nothing else determines, fitted to the recording itself."""

from __future__ import annotations

import math
from collections.abc import Sequence

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.growing import doubled, grown
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.leftover import Noise
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import foretell
from diagnosis.thresholds import EVIDENCE
from engine.threads import Threads


def with_held_out_starts(problem: Problem, x: Array, iterations: int = 20, noise: Noise = "stated") -> Array:
    """The search vector with the starting values of held-out recordings fitted, everything else frozen.

    No other recording determines the state in which a held-out one begins, so that state is fitted to the whole of it:
    a few numbers, against thousands of samples. Fits with coloured noise go by way of white noise, as all do. Where
    much is left, the machine may have been lost on the way: the state is then fitted to the beginning first, too,
    unless the recording answers in proportion to it over a tolerance: then one place is lowest.

    Args:
        problem: with experiments of all roles.
        x: search vector.
        iterations: at most, per experiment.
        noise: as of `descend`.
    """
    x = x.copy()
    for e in problem.held_out:
        mine = [i for i, f in enumerate(problem.free) if f.recording == e.name]
        if mine:
            there, cost = _fitted(problem, x, e, mine, iterations, noise)
            if problem.chi2(there, [e]) >= EVIDENCE.stated and not foretell(problem, there, [e], mine, 1.0):
                followed = grown(problem, [x], [e], mine)
                begun = doubled(problem, x, [e], mine) if followed is None else followed
                again, other = _fitted(problem, begun, e, mine, iterations, noise)
                there = again if other < cost else there
            x = there
    return x


def _fitted(
    problem: Problem, x: Array, e: Experiment, only: Sequence[int], iterations: int, noise: Noise
) -> tuple[Array, float]:
    """Search vector and cost of a recording to which its starting values were fitted."""
    ways: Sequence[Noise] = ("white", "coloured") if noise == "coloured" else (noise,)
    cost = math.inf
    with Threads(1) as pool:
        for way in ways:
            x, cost, _ = descend(problem, x, [e], pool, only=only, iterations=iterations, noise=way)
    return x, cost
