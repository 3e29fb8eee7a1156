"""A motion of piecewise constant snap, and where it begins and ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Magnitudes that a motion may not exceed, all above zero, per s, s2, s3 and s4."""

    velocity: float
    acceleration: float
    jerk: float
    snap: float


@dataclass(frozen=True)
class State:
    """Where a motion begins or ends."""

    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0


@dataclass(frozen=True)
class Profile:
    """A planned motion: ``snap[k]`` acts from ``instants[k]`` to ``instants[k + 1]``.

    Attributes:
        instants: ends of the segments, from 0, shape (n + 1,), s.
        snap: shape (n,).
        states: position, velocity, acceleration and jerk at the instants, shape (n + 1, 4).
    """

    instants: Vector
    snap: Vector
    states: Vector

    @property
    def duration(self) -> float:
        """Time from start to end (s)."""
        return float(self.instants[-1])

    def at(self, time: ArrayLike) -> Vector:
        """Position, velocity, acceleration, jerk and snap, shape (..., 5).

        Before the start and after the end the velocity goes on unchanged, without acceleration, jerk and snap.
        """
        time = np.asarray(time, dtype=float)
        k = np.searchsorted(self.instants, time, side="right") - 1
        outside = (time < 0) | (time > self.duration)
        k = np.clip(k, 0, len(self.instants) - 1)
        t = time - self.instants[k]
        p, v, a, j = np.moveaxis(self.states[k], -1, 0)
        s = np.append(self.snap, 0.0)[k]
        a, j, s = (np.where(outside, 0.0, value) for value in (a, j, s))
        return np.stack(
            [
                p + t * (v + t * (a / 2 + t * (j / 6 + t * s / 24))),
                v + t * (a + t * (j / 2 + t * s / 6)),
                a + t * (j + t * s / 2),
                j + t * s,
                s,
            ],
            axis=-1,
        )

    def peaks(self) -> Vector:
        """Largest magnitudes of velocity, acceleration, jerk and snap, shape (4,)."""
        found = np.abs(np.vstack([self.states[:, 1:], self._extremes()])).max(axis=0)
        return np.append(found, np.abs(self.snap).max(initial=0.0))

    def _extremes(self) -> Vector:
        """Velocity, acceleration and jerk where acceleration or jerk pass zero inside a segment."""
        instants = []
        for begin, length, (_, _, a, j), s in zip(
            self.instants, np.diff(self.instants), self.states, self.snap, strict=False
        ):
            roots = [-j / s] if s else []
            if s and j * j >= 2 * s * a:
                roots += [(-j + sign * math.sqrt(j * j - 2 * s * a)) / s for sign in (1, -1)]
            elif not s and j:
                roots.append(-a / j)
            instants += [begin + root for root in roots if 0 < root < length]
        return self.at(instants)[:, 1:4] if instants else np.zeros((0, 3))


@dataclass(frozen=True)
class Phase:
    """A part of a motion.

    Attributes:
        segments: (duration, snap) of each.
        velocity: at its end, if it is known.
        rests: whether acceleration and jerk are zero at its end.
    """

    segments: list[tuple[float, float]]
    velocity: float | None = None
    rests: bool = True


def join(start: State, phases: Sequence[Phase]) -> Profile:
    """The motion made of phases, without segments too short to count.

    What is known at the end of a phase is set there, so that rounding does not grow with the time that follows.
    """
    shortest = 1e-15 * sum(t for phase in phases for t, _ in phase.segments)
    p, v, a, j = start.position, start.velocity, start.acceleration, start.jerk
    states, lengths, snaps = [(p, v, a, j)], [0.0], []
    for phase in phases:
        for t, s in phase.segments:
            if t <= shortest:
                continue
            p += t * (v + t * (a / 2 + t * (j / 6 + t * s / 24)))
            v += t * (a + t * (j / 2 + t * s / 6))
            a += t * (j + t * s / 2)
            j += t * s
            states.append((p, v, a, j))
            lengths.append(t)
            snaps.append(s)
        if phase.rests:
            v, a, j = v if phase.velocity is None else phase.velocity, 0.0, 0.0
            states[-1] = (p, v, a, j)
    return Profile(np.cumsum(lengths), np.array(snaps), np.array(states))
