"""How residuals answer to the search vector over a distance: by tangents where these hold that far, else by secants.

Where contacts bounce, two runs that begin a hair apart part at every bounce. Their tangents are right, and grow with
each bounce until they tell of that hair alone: steps along them gain nothing, and what they promise is nothing. Between
runs that are farther apart the answer is as gentle as of any other model; so slopes are taken over a distance there.

Of a wave of many turns tangents hold over a fraction of a turn, which recordings may tell a hundred times as finely. So
they need to foretell no change that would make a model unlikelier by more than what it leaves could make it likelier.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, moved, sides
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import EVIDENCE, FITTING
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
) -> bool:
    """Whether slopes foretell how residuals change over `FITTING.held_over`, all variables together, or need not.

    Where a model leaves no more than a sensor's noise may be, they need not farther than half the change's squares
    reach what could still be explained: up to that barrier the cost is a parabola, and beyond it a step does not lead.
    Where it leaves no more than the noise that is stated, they need not at all.

    Args:
        problem: whose.
        x: search vector, shape (n,).
        experiments: of any role.
        slopes: of the residuals, shape (samples, signals, variables) each.
        numbers: of the search variables; all if None.
        split: what is made of a residual.
        over: as `map`, such as that of a pool of threads.
    """
    told = _Foretold(problem, x, experiments, slopes, numbers, split, over)
    holds, squares = told.within(FITTING.held_over)
    if holds:
        return True
    left = problem.unexplained(x, experiments)
    if left == 0 or problem.chi2(x, experiments) >= EVIDENCE.stated:
        return left == 0
    share = math.sqrt(2 * left / squares) if squares else 1.0
    return share < 1 and told.within(share * FITTING.held_over)[0]


def foretell(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    numbers: Sequence[int] | None = None,
    distance: float = FITTING.held_over,
) -> bool:
    """Whether tangents foretell how residuals change over a distance (tolerances), or nothing could be explained.

    Other arguments as of `hold`.
    """
    numbers = range(len(x)) if numbers is None else numbers
    try:
        slopes = [problem.linearised(x, e, numbers)[1].reshape(*e.measured.shape, len(x)) for e in experiments]
    except SimulationError:
        return False
    told = _Foretold(problem, x, experiments, [J[..., list(numbers)] for J in slopes], numbers)
    return told.within(distance)[0] or problem.unexplained(x, experiments) == 0.0


class _Foretold:
    """How well slopes foretell the change of residuals between two sides of a point; arguments as of `hold`."""

    def __init__(
        self,
        problem: Problem,
        x: Array,
        experiments: Sequence[Experiment],
        slopes: Sequence[Array],
        numbers: Sequence[int] | None = None,
        split: Split = whole,
        over: Over = map,
    ) -> None:
        self.problem, self.x, self.experiments, self.slopes = problem, x, experiments, slopes
        self.numbers = list(range(len(x)) if numbers is None else numbers)
        self.split, self.spread = split, over

    def within(self, distance: float) -> tuple[bool, float]:
        """Whether they do over a distance to either side, and the sum of the squares that they foretell."""
        after, before = sides(self.problem.free, self.x, distance, self.numbers)
        apart = (after - before)[self.numbers]
        missed = changed = foretold = 0.0
        ends = (self.problem.residuals(at, self.experiments, self.split, self.spread) for at in (after, before))
        for one, other, J in zip(*ends, self.slopes, strict=True):
            missed += float(np.sum((one - other - J @ apart) ** 2))
            changed += float(np.sum((one - other) ** 2))
            foretold += float(np.sum((J @ apart) ** 2))
        return missed <= FITTING.foretold * max(changed, 1.0), foretold  # less than one value's noise is nothing


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
