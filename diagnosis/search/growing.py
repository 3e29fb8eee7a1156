"""Fits to the beginning of each recording, and to ever more of it.

Where a machine sticks, or turns over the waves of its magnets, what it does next hangs on where it is now: over a whole
recording a parameter that is off by a thousandth makes another run of it, and a fit from there ends in a hollow of its
own. Over the beginning it does not, and each doubling of the time moves the parameters only a little.
"""

from __future__ import annotations

from dataclasses import replace

from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import SEARCH
from engine.threads import Threads


def beginning(made: Problem, share: float) -> Problem:
    """The problem with the beginning of each recording."""
    return replace(made, experiments=tuple(e.cut(share) for e in made.experiments))


def grown(made: Problem, x: Array) -> Array:
    """The search vector fitted to the beginning of each recording, and then to twice as much until it is nearly whole.

    Args:
        made: what is fitted.
        x: where to begin.
    """
    share = SEARCH.beginning
    while share < 1:
        begun = beginning(made, share)
        with Threads(1) as pool:
            x, *_ = descend(begun, x, begun.training, pool, iterations=SEARCH.first_steps, noise="white")
        share *= 2
    return x
