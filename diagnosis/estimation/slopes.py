"""How residuals answer to the search vector over a distance: by tangents where these hold that far, else by secants.

Where contacts bounce, two runs that begin a hair apart part at every bounce. Their tangents are right, and grow with
each bounce until they tell of that hair alone: steps along them gain nothing, and what they promise is nothing. Between
runs that are farther apart the answer is as gentle as of any other model; so slopes are taken over a distance there.

Where a model leaves no more than the sensors' noise, no lower place is farther off, and its tangents are the slopes: of
a wave of many turns they hold over a fraction of a turn, which recordings may tell a hundred times as finely.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, moved, sides
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import FITTING
from engine.errors import SimulationError

Split = Callable[[Experiment, Array], Array]
Over = Callable[..., Iterable[list[Array]]]


def whole(_: Experiment, r: Array) -> Array:
    """A residual as it is."""
    return r


def secants(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    distance: float,
    numbers: Sequence[int] | None = None,
    split: Split = whole,
    over: Over = map,
) -> list[Array]:
    """Slopes of residuals from one side of ``x`` to the other, shape (samples, signals, variables) each.

    Args:
        problem: whose.
        x: search vector, shape (n,).
        experiments: of any role.
        distance: to either side, in tolerances.
        numbers: of the search variables; all if None.
        split: what is made of a residual.
        over: as `map`, such as that of a pool of threads.
    """
    numbers = range(len(x)) if numbers is None else numbers
    slopes = [np.zeros((*e.measured.shape, len(numbers))) for e in experiments]
    ends: list[tuple[int, int, float]] = []
    cases: list[tuple[Array, Experiment]] = []
    for k, i in enumerate(numbers):
        ends_of = [moved(problem.free, x, [side], [i]) for side in (distance, -distance)]
        apart = float(ends_of[0][i] - ends_of[1][i])
        for n, e in enumerate(experiments):
            if apart and problem.free[i].recording in ("", e.name):
                ends.append((n, k, apart))
                cases += [(side, e) for side in ends_of]
    rows = problem.residuals_of(cases, split, over)
    for (n, k, apart), after, before in zip(ends, rows[::2], rows[1::2], strict=True):
        slopes[n][..., k] = (after - before) / apart
    return slopes


def hold(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    slopes: Sequence[Array],
    numbers: Sequence[int] | None = None,
    split: Split = whole,
    over: Over = map,
    distance: float = FITTING.held_over,
) -> bool:
    """Whether slopes foretell how residuals change over a distance, all variables together, or need not.

    They need not where the model leaves nothing over that could be explained.

    Args:
        problem: whose.
        x: search vector, shape (n,).
        experiments: of any role.
        slopes: of the residuals, shape (samples, signals, variables) each.
        numbers: of the search variables; all if None.
        split: what is made of a residual.
        over: as `map`, such as that of a pool of threads.
        distance: to either side, in tolerances.
    """
    numbers = range(len(x)) if numbers is None else numbers
    after, before = sides(problem.free, x, distance, numbers)
    apart = (after - before)[list(numbers)]
    missed = changed = 0.0
    ends = (problem.residuals(there, experiments, split, over) for there in (after, before))
    for one, other, J in zip(*ends, slopes, strict=True):
        missed += float(np.sum((one - other - J @ apart) ** 2))
        changed += float(np.sum((one - other) ** 2))
    if missed <= FITTING.foretold * max(changed, 1.0):  # less than one value's noise is nothing
        return True
    return problem.unexplained(x, experiments) == 0.0


def foretell(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    numbers: Sequence[int] | None = None,
    distance: float = FITTING.held_over,
) -> bool:
    """Whether tangents foretell how residuals change over a distance; arguments as of `hold`."""
    numbers = range(len(x)) if numbers is None else numbers
    try:
        slopes = [problem.linearised(x, e, numbers)[1].reshape(*e.measured.shape, len(x)) for e in experiments]
    except SimulationError:
        return False
    return hold(problem, x, experiments, [J[..., list(numbers)] for J in slopes], numbers, distance=distance)


def linearised(problem: Problem, x: Array, experiments: Sequence[Experiment]) -> list[tuple[Array, Array]]:
    """Residuals and slopes, shapes (samples, signals) and (samples, signals, n), that hold over `FITTING.held_over`.

    Raises:
        SimulationError: the model cannot be simulated there.
    """
    shapes = [(*e.measured.shape, len(x)) for e in experiments]
    try:
        pairs = [problem.linearised(x, e) for e in experiments]
        slopes = [J.reshape(shape) for (_, J), shape in zip(pairs, shapes, strict=True)]
        if hold(problem, x, experiments, slopes):
            return [(r.reshape(shape[:-1]), J) for (r, _), J, shape in zip(pairs, slopes, shapes, strict=True)]
    except SimulationError:
        if not runs(problem, x, experiments):
            raise
    return list(
        zip(problem.residuals(x, experiments), secants(problem, x, experiments, FITTING.held_over), strict=True)
    )


def runs(problem: Problem, x: Array, experiments: Sequence[Experiment]) -> bool:
    """Whether the model can be simulated in all experiments, and does not run away."""
    return all(np.abs(r).max(initial=0.0) < FITTING.huge for r in problem.residuals(x, experiments))
