"""Bringing acceleration and jerk to zero in the shortest time, before a motion or, backwards, after it."""

from __future__ import annotations

import math

from blocks.sources.motion_profile import Limits, Phase, State, join
from engine.errors import ParameterError

_NAMES = ("velocity", "acceleration", "jerk")
_SLACK = 1e-12


def calming(state: State, limits: Limits, which: str) -> list[tuple[float, float]]:
    """The shortest motion to zero acceleration and zero jerk, as segments (duration, snap).

    Raises:
        ParameterError: the state lies beyond a limit, or the motion passes one.
    """
    given = (state.velocity, state.acceleration, state.jerk)
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    for name, value, bound in zip(_NAMES, given, bounds, strict=True):
        if not abs(value) <= bound * (1 + _SLACK):
            raise ParameterError(
                f"the {which}'s {name} of {abs(value):g} exceeds the limit of {bound:g}", remedy="raise the limit"
            )
    if state.acceleration == 0 and state.jerk == 0:
        return []
    s, jmax = limits.snap, limits.jerk
    # With full snap against the jerk the acceleration comes to a + j |j| / (2 s); its sign says which way to turn.
    side = -math.copysign(1.0, state.acceleration + state.jerk * abs(state.jerk) / (2 * s))
    a, j = -side * state.acceleration, -side * state.jerk
    peak = min(jmax, math.sqrt(max(s * a + j * j / 2, 0.0)))
    hold = max((a + j * j / (2 * s)) / peak - peak / s, 0.0) if peak else 0.0
    segments = [((peak + j) / s, side * s), (hold, 0.0), (peak / s, -side * s)]
    passed = join(state, [Phase(segments)]).peaks()
    for name, value, bound in zip(_NAMES, passed, bounds, strict=False):
        if not value <= bound * (1 + 1e-9):
            raise ParameterError(
                f"the {which} cannot be met: its acceleration and jerk carry the {name} to {value:g}, beyond the limit "
                f"of {bound:g}",
                remedy="raise the limit, or begin and end with less acceleration",
            )
    return segments
