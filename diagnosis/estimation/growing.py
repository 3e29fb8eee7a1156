"""Fits to the beginning of each recording, and to ever more of it.

Where a machine sticks, turns over the waves of its magnets or bounces between the ends of its play, what it does next
hangs on where it is now: over a whole recording a parameter that is off by a thousandth makes another run of it, and a
fit from there ends in a hollow of its own. Over the beginning it does not, and a little more of the time moves the
parameters only a little.
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
    made: Problem,
    starts: Sequence[Array],
    experiments: Sequence[Experiment] | None = None,
    only: Sequence[int] | None = None,
) -> Array | None:
    """The search vector fitted to the beginning of each recording, and to ever more of each while it is followed.

    A recording is lost where it leaves `SEARCH.lost` times the noise, or what half as much of it left, if that is more.
    What is lost goes on in half the stride, down to `SEARCH.stride`, and then waits until the others have come as far
    as they can: they make the parameters more exact. No stride becomes longer again: what lacks physics would go on for
    long in the least. None where the beginnings are followed from no start: such a model has more than its way to find.

    Args:
        made: what is fitted.
        starts: where to begin, by turns until the beginnings are followed.
        experiments: to fit to, those of the training recordings if None.
        only: numbers of the search variables that may move; all if None.
    """
    given = made.training if experiments is None else experiments
    shares, strides = [SEARCH.beginning] * len(given), [1.0] * len(given)
    before: list[dict[float, float]] = [{} for _ in given]
    for start in starts:
        x, left = _followed(made, start, given, shares, only, SEARCH.most_steps)
        if not _lost(shares, left, before):
            break
    else:
        return None
    gained = True
    while True:
        for known, share, leaves in zip(before, shares, left, strict=True):
            known[share] = leaves
        behind = {k for k, share in enumerate(shares) if share < 1}
        wanted = {k for k in behind if strides[k] >= SEARCH.stride}
        if not wanted and not (gained and behind):
            return x
        if not wanted:
            wanted, gained = behind, False
            strides = [SEARCH.stride if k in behind else stride for k, stride in enumerate(strides)]
        more = [min(share * 2 ** strides[k], 1.0) if k in wanted else share for k, share in enumerate(shares)]
        there, leaving = _followed(made, x, given, more, only, SEARCH.first_steps)
        if lost := _lost(more, leaving, before):
            strides = [0.5 * stride if k in (lost & wanted or wanted) else stride for k, stride in enumerate(strides)]
        else:
            x, shares, left, gained = there, more, leaving, True


def doubled(
    made: Problem, x: Array, experiments: Sequence[Experiment] | None = None, only: Sequence[int] | None = None
) -> Array:
    """The search vector fitted to the beginnings, and to twice as much of all recordings until they are nearly whole.

    What little of them is not followed may be all the same with more of them, which leads out of a hollow. Arguments as
    of `grown`.
    """
    given = made.training if experiments is None else experiments
    for share in _shares():
        x, _ = _followed(made, x, given, [share] * len(given), only, SEARCH.first_steps)
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


def _lost(shares: Sequence[float], left: Sequence[float], before: Sequence[dict[float, float]]) -> set[int]:
    """Numbers of the recordings that are lost over these shares of them, as of `grown`; noise is 1.

    Args:
        shares: of each recording.
        left: what each leaves.
        before: what each left of shares that were followed.
    """
    lost = set[int]()
    for k, (share, leaves) in enumerate(zip(shares, left, strict=True)):
        half = [known for known in before[k] if known <= 0.501 * share]
        least = before[k][max(half)] if half else 1.0
        if not leaves < SEARCH.lost * max(least, 1.0):
            lost.add(k)
    return lost


def _followed(
    made: Problem,
    x: Array,
    given: Sequence[Experiment],
    shares: Sequence[float],
    only: Sequence[int] | None,
    steps: int,
) -> tuple[Array, list[float]]:
    """So many steps on a share of each recording: search vector, and what each of them leaves."""
    begun = [e.cut(share) for e, share in zip(given, shares, strict=True)]
    with Threads(1) as pool:
        x, *_ = descend(made, x, begun, pool, only=only, iterations=steps, noise="white")
    return x, [made.chi2(x, [e]) for e in begun]


def _shares() -> Iterator[float]:
    share = SEARCH.beginning
    while share < 1:
        yield share
        share *= 2


def _fitted(made: Problem, x: Array, share: float) -> tuple[Array, float]:
    """A few steps on the beginning of each recording: search vector and cost."""
    begun = [e.cut(share) for e in made.training]
    with Threads(1) as pool:
        x, cost, _ = descend(made, x, begun, pool, iterations=SEARCH.first_steps, noise="white")
    return x, cost
