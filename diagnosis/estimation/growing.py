"""Fits to the beginning of each recording, and to ever more of it.

Where a machine sticks, or turns over the waves of its magnets, what it does next hangs on where it is now: over a whole
recording a parameter that is off by a thousandth makes another run of it, and a fit from there ends in a hollow of its
own. Over the beginning it does not, and each doubling of the time moves the parameters only a little.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import SEARCH
from engine.threads import Threads


def beginning(made: Problem, share: float) -> Problem:
    """The problem with the beginning of each recording."""
    return replace(made, experiments=tuple(e.cut(share) for e in made.experiments))


def grown(
    made: Problem, x: Array, experiments: Sequence[Experiment] | None = None, only: Sequence[int] | None = None
) -> Array:
    """The search vector fitted to the beginning of each recording, and then to twice as much until it is nearly whole.

    Args:
        made: what is fitted.
        x: where to begin.
        experiments: to fit to, those of the training recordings if None.
        only: numbers of the search variables that may move; all if None.
    """
    for share in _shares():
        x, _ = _fitted(made, x, share, experiments, only)
    return x


def raced(begun: Sequence[tuple[Problem, Array]]) -> list[tuple[int, Array]]:
    """The same for models of which one is sought: those that keep up with the best, by number, with their vectors.

    Over `SEARCH.telling` of the recordings and with each doubling after it, the half that leaves more is dropped.

    Args:
        begun: what is fitted to the same recordings, and where to begin.
    """
    found = [(k, x) for k, (_, x) in enumerate(begun)]
    for share in _shares():
        ends = [(k, *_fitted(begun[k][0], x, share)) for k, x in found]
        if share >= SEARCH.telling:
            ends = sorted(ends, key=lambda end: end[2])[: (len(ends) + 1) // 2]
        found = [(k, x) for k, x, _ in ends]
    return found


def _shares() -> Iterator[float]:
    share = SEARCH.beginning
    while share < 1:
        yield share
        share *= 2


def _fitted(
    made: Problem,
    x: Array,
    share: float,
    experiments: Sequence[Experiment] | None = None,
    only: Sequence[int] | None = None,
) -> tuple[Array, float]:
    """A few steps on the beginning of each recording: search vector and cost."""
    begun = [e.cut(share) for e in (made.training if experiments is None else experiments)]
    with Threads(1) as pool:
        x, cost, _ = descend(made, x, begun, pool, only=only, iterations=SEARCH.first_steps, noise="white")
    return x, cost
