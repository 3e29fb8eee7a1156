"""Test signals: what a laboratory would play. Each kind comes with random levels, times and phases."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.concealed.plants.base import Excitation

Array = NDArray[np.float64]

PAIRS = (("multi_step", "prbs"), ("chirp", "reversal"), ("ramp", "coast"))
"""One of each pair is for training, the other is held out."""

REST = 0.05
"""Time (s) before anything happens."""


def multi_step(rng: Generator, t: Array, e: Excitation) -> Array:
    """Levels of random size, sign and duration; nothing during the last 15 %."""
    u, at = np.zeros_like(t), REST
    sign = rng.choice([-1.0, 1.0])
    while at < 0.85 * t[-1]:
        hold = rng.uniform(*e.dwell)
        u[(t >= at) & (t < min(at + hold, 0.85 * t[-1]))] = sign * rng.uniform(0.25, 1.0)
        sign = -sign if rng.random() < 0.7 else sign
        at += hold
    return u


def prbs(rng: Generator, t: Array, e: Excitation) -> Array:
    """Random binary sequence."""
    u, at, sign = np.zeros_like(t), REST, rng.choice([-1.0, 1.0])
    while at < 0.92 * t[-1]:
        hold = e.clock * rng.integers(1, 9)
        u[(t >= at) & (t < min(at + hold, 0.92 * t[-1]))] = 0.6 * sign
        sign, at = -sign, at + hold
    return u


def chirp(rng: Generator, t: Array, e: Excitation) -> Array:
    """Sine whose frequency rises exponentially; silence at the end."""
    length = 0.9 * t[-1]
    rate = np.log(e.high / e.low)
    phase = 2 * np.pi * e.low * length / rate * (np.exp(rate * t / length) - 1)
    u = rng.uniform(0.6, 0.9) * np.sin(phase) * rng.choice([-1.0, 1.0])
    return np.where(t < length, u, 0.0)


def reversal(rng: Generator, t: Array, e: Excitation) -> Array:
    """Two slow sines: both directions, every speed, smooth reversals."""
    slow, fast = rng.uniform(0.4, 0.7), rng.uniform(1.0, 2.0)
    u = 0.65 * np.sin(2 * np.pi * slow * t) + 0.35 * np.sin(2 * np.pi * fast * t + rng.uniform(0, 2 * np.pi))
    return np.asarray(u * np.clip(t / 0.2, 0, 1) * rng.choice([-1.0, 1.0]))


def ramp(rng: Generator, t: Array, e: Excitation) -> Array:
    """Straight lines between random levels of changing sign."""
    times, levels, sign = [0.0, REST], [0.0, 0.0], rng.choice([-1.0, 1.0])
    while times[-1] < t[-1]:
        times.append(times[-1] + rng.uniform(0.35, 0.9))
        levels.append(sign * rng.uniform(0.4, 1.0))
        sign = -sign
    return np.interp(t, times, levels)


def coast(rng: Generator, t: Array, e: Excitation) -> Array:
    """Pulses, each followed by a long time without drive."""
    u, at, sign = np.zeros_like(t), REST, rng.choice([-1.0, 1.0])
    while at < t[-1]:
        hold = rng.uniform(0.25, 0.55)
        u[(t >= at) & (t < at + hold)] = sign * rng.uniform(0.6, 1.0)
        sign, at = -sign, at + hold + rng.uniform(0.9, 1.4)
    return u


def steps_up(rng: Generator, t: Array, e: Excitation) -> Array:
    """Positive levels one after the other, never back to zero: driven in one direction."""
    u, at = np.zeros_like(t), REST
    while at < t[-1]:
        u[t >= at] = rng.uniform(0.35, 1.0)
        at += rng.uniform(*e.dwell)
    return u


def chirp_up(rng: Generator, t: Array, e: Excitation) -> Array:
    """A chirp about a positive level that it never undoes."""
    phase = 2 * np.pi * e.low * t[-1] / np.log(e.high / e.low) * ((e.high / e.low) ** (t / t[-1]) - 1)
    u = rng.uniform(0.6, 0.7) + rng.uniform(0.15, 0.25) * np.sin(phase)
    return np.where(t >= REST, u, 0.0)


def decay(rng: Generator, t: Array, e: Excitation) -> Array:
    """No drive at all: what was turned away is let go."""
    return np.zeros_like(t)


KINDS: dict[str, Callable[[Generator, Array, Excitation], Array]] = {
    f.__name__: f for f in (multi_step, prbs, chirp, reversal, ramp, coast, steps_up, chirp_up, decay)
}


def make(
    kind: str, rng: Generator, samples: int, interval: float, e: Excitation, size: float, one_way: bool = False
) -> Array:
    """A command of one kind, in steps of its resolution.

    Args:
        kind: one of `KINDS`.
        rng: levels, times, phases.
        samples, interval: of the recording.
        e: of the plant.
        size: factor on the amplitude.
        one_way: only positive values.
    """
    u = KINDS[kind](rng, interval * np.arange(samples, dtype=float), e)
    if one_way:
        u = np.abs(u)
    return np.round(size * e.amplitude * u / e.resolution) * e.resolution


def kinds(rng: Generator) -> tuple[list[str], list[str]]:
    """Three kinds to train on and three others to hold out."""
    train, hold_out = [], []
    for pair in PAIRS:
        first = int(rng.integers(2))
        train.append(pair[first])
        hold_out.append(pair[1 - first])
    return train, hold_out
