"""Which effects of a given size could be told apart: those whose odds against each other are decisive.

Each effect in turn is the truth, a multiple of the smallest size that shows. All others are fitted to it, with the
model's own parameters. It ties with another one that fits so well that the diagnosis would not decide. What counts is
what the experiment says: that one law has narrower sizes beforehand than another is no measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.parameters import Array
from diagnosis.planning.reach import Bench, Course, answer, background, fitted, together
from diagnosis.planning.sizes import TURNS, Family
from diagnosis.planning.smallest import DECISIVE, Smallest
from diagnosis.search.equivalent_effects import KNOWN
from diagnosis.search.posterior import is_in
from engine.errors import FlexarmError
from engine.spread import Spread

NEAR = 60.0
"""Difference of the logarithm of odds within which a rival is fitted again, where the linear fit ends."""

STEPS = 3
"""Times that it is."""

SETTLED = 0.5
"""Difference that a further step would make."""


@dataclass(frozen=True)
class Truths:
    """Effects at sizes that show, as courses.

    Attributes:
        found: the effects.
        multiple: how many times the smallest size that shows they have; less where they cannot become so large.
        sizes: that they have.
        forms: courses of each, its own first: what it can do as a rival is looked for around each of them. A wave has
            a form for each quarter of a turn.
    """

    found: tuple[Smallest, ...]
    multiple: float
    sizes: tuple[float, ...]
    forms: tuple[tuple[Course, ...], ...]

    @property
    def courses(self) -> list[Course]:
        """Each effect as the truth."""
        return [forms[0] for forms in self.forms]


def turns(family: Family) -> list[Family]:
    """The forms of an effect: a wave turned by quarters."""
    if not TURNS & {*family.base}:
        return [family]
    return [family.turned(k * math.pi / 2) for k in range(4)]


def truths(
    bench: Bench,
    found: Sequence[Smallest],
    multiple: float,
    workers: int,
    done: Callable[[], None],
    *,
    further: bool = False,
) -> Truths:
    """The effects that show, at a multiple of their smallest size; what cannot be simulated there is left out.

    Args:
        bench: the planned experiment.
        found: effects that show.
        multiple: of the smallest size.
        workers: threads.
        done: told after each.
        further: whether further sensors are looked at too.
    """

    def size_of(each: Smallest) -> float:
        family = each.family
        return min(multiple * each.size, max(family.largest, each.size)) if family.sized else 1.0

    def one(each: Smallest) -> tuple[Course, ...]:
        family, size = each.family, size_of(each)
        try:
            near = bench.course(family, each.size) if family.sized and family.candidate.freed is None else None
            return tuple(bench.course(form, size, near, further=further) for form in turns(family))
        except FlexarmError:
            return ()

    rows = []
    with Spread(workers, threads=True) as pool:
        for each, courses in zip(found, pool.map(one, found), strict=True):
            done()
            if courses:
                rows.append((each, courses))
    return Truths(tuple(e for e, _ in rows), multiple, tuple(size_of(e) for e, _ in rows), tuple(c for _, c in rows))


@dataclass(frozen=True)
class Odds:
    """How well each effect fits where another is the truth.

    Attributes:
        values: logarithm of the odds, shape (truths, rivals).
        background: of each truth, shape (bands, truths); see `reach.background`.
        close: courses of rivals that were fitted again where they came close, by (truth, rival).
    """

    values: Array
    background: Array
    close: dict[tuple[int, int], Course]


def odds(bench: Bench, told: Truths, workers: int = 1, *, only: Sequence[int] | None = None) -> Odds:
    """How well each effect fits where each is the truth.

    The fit is linear; of those that come close it is done again where it ends, for no law is linear.

    Args:
        bench: the planned experiment.
        told: the effects.
        workers: threads.
        only: truths whose rivals are fitted again; all if None.
    """
    courses, count = told.courses, len(told.found)
    if not count:
        return Odds(np.zeros((0, 0)), np.zeros((0, 0)), {})
    behind = background(bench.bands, bench.nominal, courses)
    columns = []
    best: list[NDArray[np.int64]] = []
    for forms in told.forms:
        each = np.array([fitted(bench.bands, answer(form, courses), behind) for form in forms])
        best.append(each.argmax(axis=0))
        columns.append(each.max(axis=0))
    values = np.column_stack(columns)
    candidates = [each.family.candidate for each in told.found]
    near = [
        (i, j)
        for i in (range(count) if only is None else only)
        for j in np.argsort(-values[i])
        if i != j and values[i, j] > values[i, i] - NEAR and may_tie(candidates[i], candidates[j])
    ]

    def again(pair: tuple[int, int]) -> tuple[float, Course] | None:
        i, j = pair
        return _again(bench, told.forms[j][best[j][i]], courses[i], behind[:, [i]])

    close = {}
    with Spread(workers, threads=True) as pool:
        for (i, j), found in zip(near, pool.map(again, near), strict=True):
            if found is not None:
                values[i, j], close[i, j] = found
    return Odds(values, behind, close)


def _again(bench: Bench, form: Course, truth: Course, behind: Array) -> tuple[float, Course] | None:
    """A rival fitted to a truth in steps: how well it does, and its course where it ends."""
    found: tuple[float, Course] | None = None
    course = form
    for _ in range(STEPS):
        following = bench.again(course, answer(course, [truth]).change[:, 0])
        if following is None:
            break
        course = following
        done = answer(course, [truth])
        stays = replace(done, rest=(truth.values - course.values)[:, None], cost=_cost(course, truth))
        there = float(fitted(bench.bands, stays, behind)[0])
        value = max(there, float(fitted(bench.bands, done, behind)[0]))
        found = (value, course)
        if value - there < SETTLED:
            break
    return found


def _cost(course: Course, truth: Course) -> Array:
    """What a rival's parameters cost where it is, half the sum of squares, shape (1,)."""
    own = course.prior - course.weights @ course.given_by(truth)
    return np.array([0.5 * float(own @ own)])


def may_tie(truth: Candidate, rival: Candidate) -> bool:
    """Whether two effects are rivals: not two forms of one, and none that the diagnosis would drop for the simpler."""
    return truth.key != rival.key and not is_in(truth, rival)


def ties(told: Truths, found: Odds) -> list[tuple[int, int]]:
    """The pairs (truth, rival) whose odds are not decisive."""
    candidates = [each.family.candidate for each in told.found]
    evidence = found.values
    own = np.diag(evidence)
    return [
        (i, j)
        for i in range(len(candidates))
        for j in range(len(candidates))
        if i != j and evidence[i, j] > own[i] - DECISIVE and may_tie(candidates[i], candidates[j])
    ]


def pairs_of_effects(bench: Bench, told: Truths, found: Odds) -> Iterator[tuple[int, int, int]]:
    """Effects that two others together may be taken for, of the pairs that are known to: (truth, one, other)."""
    names, evidence = [each.family.candidate.effect for each in told.found], found.values
    for i, name in enumerate(names):
        wanted = KNOWN.get(name)
        if wanted is None:
            continue
        best = [
            max((j for j, other in enumerate(names) if other == one), key=lambda j: evidence[i, j], default=None)
            for one in wanted
        ]
        if any(j is None for j in best):
            continue
        a, b = (j for j in best if j is not None)
        pair = together(told.courses[a], told.courses[b])
        if (
            fitted(bench.bands, answer(pair, [told.courses[i]]), found.background[:, [i]])[0]
            > evidence[i, i] - DECISIVE
        ):
            yield i, a, b


def unordered(rows: Sequence[tuple[int, int]]) -> set[tuple[int, int]]:
    """Pairs, whichever is the truth."""
    return {(min(i, j), max(i, j)) for i, j in rows}


def rivals(told: Truths) -> int:
    """How many pairs of effects there are to be told apart."""
    candidates = [each.family.candidate for each in told.found]
    return sum(may_tie(a, b) or may_tie(b, a) for k, a in enumerate(candidates) for b in candidates[:k])
