"""Where to begin with a torque that is a wave of the angle or of time: its amplitude and phase are solved for.

A sin(n angle + phase) is linear in A cos(phase) and A sin(phase), and the model's own parameters always take up part of
what it does: they have moved in the parent's fit, and with them left there a wave looks poor at every size, or good at
the wrong order. So both are solved for at once, by the tangents from a wave that is hardly there.

A wave of a high order in an angle is out of step as soon as the model's angle is off by a fraction of it, as it is soon
after the start. So both are also solved for over the beginning of each recording as it was taken, and fitted to ever
more of it, in ever fewer of the orders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.growing import beginning, raced
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.whitened import WhitenedResiduals
from diagnosis.problems import followed, resolved
from diagnosis.search.partial_fit import Builder, StartingPoint
from diagnosis.thresholds import SEARCH
from engine.errors import SimulationError
from engine.threads import Threads


def solved(builder: Builder, effects: Sequence[Candidate], k: int, parent: dict[str, float]) -> list[StartingPoint]:
    """A start at each order of a wave, the best first, by what it leaves of the recordings as they were taken.

    Args:
        builder: builds models.
        effects: what is put in, the others at the first of their sizes.
        k: which of them is the wave.
        parent: parameters to begin from.
    """
    wave = effects[k].wave
    assert wave is not None
    orders: list[tuple[Problem, Array, tuple[Sizes, ...], tuple[Sizes, ...]]] = []
    for group in replace(effects[k], starts=wave.starts).structures():
        together = [tuple(sizes if i == k else c.starts[0] for i, c in enumerate(effects)) for sizes in group]
        orders += [(*made, together[0]) for made in builder.placed(tuple(effects), together, parent)]

    rows = [_solution(made, x, effects[k]) for made, x, *_ in orders]
    whole = [_as_recorded(builder, effects, built, x) for _, x, _, built in orders]
    begun = [
        _solution(beginning(w, SEARCH.beginning), x, effects[k]) for w, (_, x, *_) in zip(whole, orders, strict=True)
    ]
    able = [number for number, x in enumerate(begun) if x is not None]
    racing = raced([(whole[number], x) for number in able if (x := begun[number]) is not None])
    ends = [*enumerate(rows), *((able[k], x) for k, x in racing)]

    found: dict[int, StartingPoint] = {}
    for number, x in ends:
        made, _, sizes, built = orders[number]
        if x is not None:
            cost = whole[number].cost(x, whole[number].training, noise="white")
            point = StartingPoint(cost, made, x, sizes, built)
            if number not in found or point.cost < found[number].cost:
                found[number] = point
    return sorted(found.values(), key=lambda point: point.cost)


def _as_recorded(builder: Builder, effects: Sequence[Candidate], built: tuple[Sizes, ...], x: Array) -> Problem:
    """A model with its recordings as they are: those that were made coarse are right near another one only."""
    made = builder.build(effects, built, whole=True)
    return followed(resolved(made, x) or made, x)


def _solution(made: Problem, x: Array, effect: Candidate) -> Array | None:
    """The search vector that solves the linear problem around ``x``; None where there is none.

    With s the amplitude at ``x``, a wave (1 + c) s at the phase there and d s a quarter of a turn on.
    """
    assert effect.wave is not None
    names = [f.name for f in made.free]
    a, p = (names.index(f"{effect.name}.{key}") for key in (effect.wave.amplitude, effect.wave.phase))
    with Threads(1) as pool:
        stack = WhitenedResiduals(made, made.training, pool, range(len(x)), noise="white")
        try:
            rows, slopes = stack.held(x)
        except SimulationError:
            return None
    weights = stack.weights(rows)
    r, J = stack.whitened(x, rows, weights), stack.whitened_slopes(x, slopes, weights)
    amplitude, phase = made.free[a], made.free[p]
    J[:, a] *= amplitude.value(x[a]) / amplitude.slope(x[a])
    J[:, p] /= phase.slope(x[p])
    own = {f"{effect.name}.{k.name}" for k in effect.parameters}
    mine = [i for i, name in enumerate(names) if name in own and i not in (a, p)]
    here = {"", *(e.name for e in made.training)}
    mine += [i for i, f in enumerate(made.free) if f.recording not in here]
    J[:, mine] = 0.0  # a frequency has no slope where the amplitude is nothing, nor has where others start
    J[len(r) - len(made.prior(x)[0]) :, [a, p]] = 0.0  # nor has the amplitude's logarithm a prior there
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    step = -np.linalg.lstsq(J / size, r, rcond=1e-9)[0] / size
    step[mine] = 0.0
    there = x + np.clip(step, -SEARCH.farthest, SEARCH.farthest)
    there[a] = amplitude.position(amplitude.value(x[a]) * math.hypot(1 + step[a], step[p]))
    there[p] = phase.position(phase.value(x[p]) + math.atan2(step[p], 1 + step[a]))
    return np.asarray(there)
