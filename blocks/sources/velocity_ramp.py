"""Changes of velocity in the shortest time, without acceleration and jerk at their ends."""

from __future__ import annotations

import math
from collections.abc import Iterator

from blocks.sources.motion_profile import Limits


class Ramp:
    """Changes of velocity under limits on acceleration, jerk and snap.

    The acceleration rises to a, holds for t3 and falls. A rise is one pulse of jerk: a ramp of slope s for t1, a
    constant jerk for t2, a ramp back for t1.

        trapezoidal: j = s t1, a = j (t1 + t2), change = a (2 t1 + t2 + t3), duration 4 t1 + 2 t2 + t3
        triangular:  t2 = 0, and the slope may be less than the limit of snap, where the limit of jerk asks for it

    A growing change takes up t1 until the jerk's limit, t2 until the acceleration's, and then t3.

    Args:
        limits: what it may not exceed.
        triangular: no phases of constant jerk.

    Attributes:
        first, second: changes of velocity from which on the limit of jerk, and that of acceleration, is reached.
    """

    def __init__(self, limits: Limits, triangular: bool) -> None:
        self.triangular = triangular
        self.a, self.j, self.s = limits.acceleration, limits.jerk, limits.snap
        rise = self.j / self.s
        if triangular:
            self.top = max(math.sqrt(self.a / self.s), self.a / self.j), 0.0
            self.first = 2 * self.j * rise**2
        else:
            short = math.sqrt(self.a / self.s)
            self.top = (short, 0.0) if short <= rise else (rise, self.a / self.j - rise)
            self.first = 2 * self.s * self.top[0] ** 3
        self.second = self.a * (2 * self.top[0] + self.top[1])
        self.first = min(self.first, self.second)

    def phases(self, change: float) -> tuple[float, float, float, float]:
        """Slope of the jerk, t1, t2 and t3 for a change of velocity by ``change`` >= 0."""
        if change >= self.second:
            t1, t2 = self.top
            return self.a / (t1 * (t1 + t2)), t1, t2, change / self.a - 2 * t1 - t2
        if change <= self.first:
            t1 = math.cbrt(change / (2 * self.s))
            return self.s, t1, 0.0, 0.0
        if self.triangular:
            t1 = math.sqrt(change / (2 * self.j))
            return self.j / t1, t1, 0.0, 0.0
        t1 = self.j / self.s
        t2 = (math.sqrt(t1 * t1 + 4 * change / self.j) - 3 * t1) / 2
        return self.s, t1, max(t2, 0.0), 0.0

    def duration(self, change: float) -> float:
        """How long a change of velocity takes (s)."""
        _, t1, t2, t3 = self.phases(change)
        return 4 * t1 + 2 * t2 + t3

    def reach(self, duration: float) -> float:
        """The change of velocity that takes ``duration``; the inverse of the above."""
        if duration >= self.duration(self.second):
            return self.a * (duration - 2 * self.top[0] - self.top[1])
        if duration <= self.duration(self.first):
            return 2 * self.s * (duration / 4) ** 3
        if self.triangular:
            return 2 * self.j * (duration / 4) ** 2
        t1 = self.j / self.s
        return self.j * (duration / 2 - t1) * duration / 2

    def segments(self, change: float) -> Iterator[tuple[float, float]]:
        """Duration and snap of every segment of a change of velocity of either sign."""
        slope, t1, t2, t3 = self.phases(abs(change))
        slope = math.copysign(slope, change)
        yield from ((t1, slope), (t2, 0.0), (t1, -slope), (t3, 0.0), (t1, -slope), (t2, 0.0), (t1, slope))
