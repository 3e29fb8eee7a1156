"""Planning a motion of fourth order: piecewise constant snap under limits on velocity, acceleration, jerk and snap.

A motion is a change of velocity from the start's to a cruising velocity, a cruise, and a change of velocity to the
end's. Every change begins and ends without acceleration and jerk (see `Ramp`) and is symmetric in time, so it covers
(v + w) / 2 times its duration, v and w being the velocities at its ends. The cruising velocity is the one of the
shortest motion; it lies at its limit when there is a cruise.

This is the shortest motion whose acceleration and jerk are zero wherever its velocity peaks [Lambrechts 2005;
Gao J. n.d., sec. 3.2]. At a start or end with acceleration or jerk both are first brought to zero, and the whole is no
longer the shortest motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from blocks.sources.calming import calming
from blocks.sources.motion_profile import Limits, Phase, Profile, State, Vector, join
from blocks.sources.velocity_ramp import Ramp
from engine.errors import ParameterError

_GRID = 64


def plan(start: State, end: State, limits: Limits, *, triangular: bool = False) -> Profile:
    """Plan a motion.

    Args:
        start: where it begins.
        end: where it ends; the duration follows.
        limits: what it may not exceed.
        triangular: no phases of constant jerk.

    Raises:
        ParameterError: a limit that is not positive, or a start or end that lies beyond a limit or must pass one.
    """
    for name in ("velocity", "acceleration", "jerk", "snap"):
        value = getattr(limits, name)
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"the limit of {name} is {value:g}", remedy="give a limit above zero")
    before = Phase(calming(start, limits, "start"))
    backwards = Phase(calming(_mirrored(end), limits, "end"))
    calm = State(*join(start, [before]).states[-1].tolist()) if before.segments else start
    final = _mirrored(State(*join(_mirrored(end), [backwards]).states[-1].tolist())) if backwards.segments else end
    after = [Phase(backwards.segments[::-1], rests=False)] if backwards.segments else []
    made = join(start, [*([before] if before.segments else []), *_between(calm, final, limits, triangular), *after])
    for k, state in ((0, start), (-1, end)):
        made.states[k] = state.position, state.velocity, state.acceleration, state.jerk
    return made


def _mirrored(state: State) -> State:
    """The state as seen with time running backwards."""
    return State(state.position, -state.velocity, state.acceleration, -state.jerk)


def _between(start: State, end: State, limits: Limits, triangular: bool) -> list[Phase]:
    """The shortest motion between states without acceleration and jerk."""
    ramp, top = Ramp(limits, triangular), limits.velocity
    distance = end.position - start.position
    v, w = (0.0 if abs(u) < 1e-14 * top else u for u in (start.velocity, end.velocity))

    def covered(up: float, down: float) -> float:
        """Distance by way of the velocity v + up = w + down; both are given so that small ones keep their digits."""
        first, last = ramp.duration(abs(up)), ramp.duration(abs(down))
        return (v + up / 2) * first + (w + down / 2) * last

    best: tuple[float, float, float, float] | None = None

    def offer(up: float, down: float, cruise: float) -> None:
        nonlocal best
        total = ramp.duration(abs(up)) + ramp.duration(abs(down)) + cruise
        if best is None or total < best[0]:
            best = total, up, cruise, down

    for side in (top, -top):
        left = distance - covered(side - v, side - w)
        if left * side >= 0:
            offer(side - v, side - w, left / side)
    gap = w - v
    for near_start in (True, False):
        for sign in (1.0, -1.0):
            origin = v if near_start else w
            reach = min(abs(gap) / 2, top) if sign * (gap if near_start else -gap) > 0 else top - sign * origin
            if reach <= 0:
                continue

            def ways(t: float, sign: float = sign, near_start: bool = near_start) -> tuple[float, float]:
                change = sign * ramp.reach(t)
                return (change, change - gap) if near_start else (change + gap, change)

            def missed(t: float, ways: Callable[[float], tuple[float, float]] = ways) -> float:
                return covered(*ways(t)) - distance

            for root in _roots(missed, _grid(ramp, reach)):
                up, down = ways(root)
                offer(up, down, 0.0)
    if best is None:
        raise ParameterError(
            f"no motion over {distance:g} within these limits was found", remedy="check that the limits are of a kind"
        )
    _, up, cruise, down = best
    return [Phase([*ramp.segments(up)], v + up), Phase([(cruise, 0.0)]), Phase([*ramp.segments(-down)], w)]


def _grid(ramp: Ramp, reach: float) -> Vector:
    """Durations of changes of velocity up to ``reach``, dense towards 0 and with those at which the phases change."""
    longest = ramp.duration(reach)
    corners = [ramp.duration(change) for change in (ramp.first, ramp.second) if change < reach]
    even = np.linspace(0.0, longest, _GRID)
    small = longest * np.geomspace(1e-9, 1.0, _GRID)
    return np.unique(np.concatenate([even, small, corners]))


def _roots(f: Callable[[float], float], grid: Vector) -> Iterator[float]:
    """Zeros of a function, also where it only just crosses and comes back between two points of the grid."""
    x = [float(point) for point in grid]
    y = [f(point) for point in x]
    signs = [(value > 0) - (value < 0) for value in y]
    for k in range(1, len(x) - 1):
        same = signs[k - 1] == signs[k] == signs[k + 1] != 0
        # Close to 0 no change of velocity counts beside the distance, and what is nearest to a zero there is rounding.
        flat = max(abs(y[k - 1] - y[k]), abs(y[k + 1] - y[k])) <= 1e-9 * abs(y[k])
        if same and not flat and abs(y[k]) <= min(abs(y[k - 1]), abs(y[k + 1])):
            from scipy.optimize import minimize_scalar

            near = minimize_scalar(lambda t, sign=signs[k]: sign * f(t), bounds=(x[k - 1], x[k + 1]), method="bounded")
            if near.fun < 0:
                yield from (_root(f, x[k - 1], float(near.x)), _root(f, float(near.x), x[k + 1]))
    for k, sign in enumerate(signs):
        if sign == 0:
            yield x[k]
        elif k + 1 < len(x) and sign == -signs[k + 1]:
            yield _root(f, x[k], x[k + 1])


def _root(f: Callable[[float], float], a: float, b: float) -> float:
    from scipy.optimize import brentq  # on first use: importing it takes longer than loading a scenario

    return float(brentq(f, a, b, xtol=1e-300, maxiter=5000))
