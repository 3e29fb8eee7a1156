"""The smallest size of an effect that would show: that at which the diagnosis would name it rather than nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from diagnosis.planning.reach import Bench, Course, TooFast, answer, likely
from diagnosis.planning.sizes import TURNS, Family
from diagnosis.search.posterior import price
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import FlexarmError

TRIALS = 14
"""Sizes that are simulated at most."""

CLOSE = 0.05
"""Logarithm of a factor between two sizes that are taken for the same."""

STRIDE = 30.0
"""Factor by which a size is changed at most from one trial to the next."""

DECISIVE = math.log(EVIDENCE.probability / (1 - EVIDENCE.probability))
"""Difference of evidence from which one model holds `EVIDENCE.probability` against another."""


@dataclass(frozen=True)
class Smallest:
    """How large an effect must be to show.

    Attributes:
        family: the effect, its wave in the phase that shows least.
        size: the smallest that shows; the largest that was tried if none does.
        shows: whether it shows at all.
        margin: evidence beyond what is needed there; for an effect without a size, how surely it shows.
        finest: whether smaller sizes would move faster than the samples can show, so that none was tried.
    """

    family: Family
    size: float
    shows: bool
    margin: float
    finest: bool = False


def margin(bench: Bench, course: Course, tried: int) -> tuple[float, float]:
    """How much more evidence an effect of that size would have than it needs; and the evidence that shows.

    It must hold `EVIDENCE.probability` against the refitted model, its price paid, and what the refitted model leaves
    must be worth a search.

    Args:
        bench: the planned experiment.
        course: with the effect.
        tried: number of effects at places.
    """
    nominal = bench.nominal
    without = answer(nominal, [course])
    lost = likely(bench.bands, nominal, without)[0]
    own = likely(bench.bands, course, answer(course, [course]))[0]
    room = float(bench.bands.unexplained(without.rest)[0] + without.cost[0])
    named = own - lost - price(tried) - DECISIVE
    return min(float(named), room - price(tried) - SEARCH.effort), float(nominal.volume * -1 - lost)


def smallest(bench: Bench, family: Family, tried: int) -> Smallest:
    """The smallest size that shows.

    Raises:
        FlexarmError: the effect cannot be simulated at any size.
    """
    if not family.sized:
        found, _ = margin(bench, bench.course(family, 1.0), tried)
        return Smallest(family, 1.0, found >= 0, found)
    if TURNS & {*family.base}:
        family = _least_phase(bench, family)
    size, low, high = min(family.first, family.largest), 0.0, math.inf
    best = math.nan
    stiff = 0.0
    problem: FlexarmError | None = None
    near: Course | None = None
    for _ in range(TRIALS):
        try:
            near = bench.course(family, size, near)
            beyond, shown = margin(bench, near, tried)
        except TooFast as error:
            problem = error
            low = stiff = max(low, size)
            beyond, shown = -math.inf, 0.0
        except FlexarmError as error:
            # Too much of it: the machine does something else altogether.
            problem = error
            high = min(high, size)
            beyond, shown = math.inf, 0.0
        else:
            if beyond >= 0:
                high, best = min(high, size), beyond
            else:
                low = max(low, size)
        if low >= family.largest * (1 - 1e-9):
            return Smallest(family, family.largest, False, beyond)
        wanted = shown - beyond
        if shown > 0 and math.isfinite(beyond) and wanted > 0:
            # A little too far, so that the sizes on both sides are known.
            over = 1 + CLOSE if beyond < 0 else 1 - CLOSE / 2
            following = size * min(max(over * math.sqrt(wanted / shown), 1 / STRIDE), STRIDE)
        else:
            following = size * (STRIDE if beyond < 0 else 1 / STRIDE)
        following = min(following, family.largest)
        if low > 0 and math.isfinite(high):
            if math.log(high / low) < CLOSE:
                break
            if not low * (1 + CLOSE / 3) < following < high * (1 - CLOSE / 3):
                following = math.sqrt(low * high)
        if math.isfinite(best) and 0 <= beyond < math.inf and math.log(size / following) < CLOSE:
            high = size
            break
        size = following
    if not math.isfinite(best):
        if problem is not None:
            raise problem
        return Smallest(family, low or size, False, -math.inf)
    return Smallest(family, high, True, best, finest=bool(stiff) and high / stiff < 1 + 10 * CLOSE)


def _least_phase(bench: Bench, family: Family) -> Family:
    """The wave turned to the phase in which it shows least beside what the model's own parameters do."""
    size = min(family.first, family.largest)
    courses = [bench.course(family.turned(phase), size) for phase in (0.0, math.pi / 2)]
    rest = answer(bench.nominal, courses).rest
    _, directions = np.linalg.eigh(rest.T @ rest)
    return family.turned(math.atan2(float(directions[1, 0]), float(directions[0, 0])))
