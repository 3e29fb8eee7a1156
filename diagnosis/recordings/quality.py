"""What is wrong with a recorded signal by itself, without a model: wraps, freezes, late inputs, lines, clocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from diagnosis.recordings.columns import Vector

JUMP = 8.0
"""How many times larger than the largest other step a jump is that may be a wrap."""
ALIKE = 0.1
"""Share by which jumps of one counter differ: the machine moves on meanwhile."""
FROZEN = 8
"""Equal samples in a row, entered and left at speed, that are a frozen sensor."""
CATCH_UP = 0.5
"""Share of the usual speed times the frozen time by which a signal must have moved on when it comes back."""
LATE = 8
"""Samples by which an input column may be late."""
MEMORY = 12
"""Past samples of signal and input that predict the next."""
BETTER = 1.3
"""How many times smaller an error gets if later inputs are known, from which the input's column is late."""
LINE = 60.0
"""Power of a line over that around it."""
JITTERS = 0.02
"""Deviation of a sample's instant from an even clock, as a share of an interval, that is worth a word."""
DRIFTS = 1e-4
"""Change of a clock's rate over a recording that is worth a word; crystals keep 1e-4."""
ROUNDING = 1e-6
"""Share of an interval below which an instant is even but for its digits."""
COUNTERS = {2.0**n: f"2^{n}" for n in (8, 10, 12, 13, 14, 15, 16, 17, 18, 19, 20, 24, 32)} | {
    360.0: "360",
    2 * math.pi: "2 pi",
    1.0: "1",
}
"""Ranges after which counters and angles begin anew, in the numbers as they were logged."""


@dataclass(frozen=True)
class Clock:
    """The instants of a recording's samples.

    Attributes:
        interval: usual time between samples (s).
        jitter: largest deviation of an instant from an even clock (s).
        drift: change of the clock's rate from begin to end, as a share.
        dropped: samples that are missing between those that were kept.
    """

    interval: float
    jitter: float
    drift: float
    dropped: int

    @property
    def remarks(self) -> list[str]:
        """What is worth a word, in sentences."""
        made = []
        if self.dropped:
            made.append(f"{self.dropped} sample{'s' if self.dropped > 1 else ''} missing by the clock")
        if self.jitter > JITTERS * self.interval:
            made.append(f"samples come up to {self.jitter:.2g} s off an even clock of {self.interval:.4g} s")
        if abs(self.drift) > DRIFTS:
            made.append(f"the clock's rate changes by {100 * self.drift:.2g} % from begin to end")
        return made


def clock(stamps: Vector) -> Clock:
    """The clock of a recording.

    Args:
        stamps: instants as they were logged (s), increasing, shape (samples,).
    """
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    ticks = np.concatenate([[0], np.cumsum(np.maximum(np.round(steps / usual), 1))])
    dropped = int(ticks[-1]) - len(steps)
    uneven = np.sort(np.abs(steps / usual - np.round(steps / usual)))
    if len(steps) > 8 and uneven[len(uneven) // 2] > 0.25:  # no clock: nothing is missing
        dropped, ticks = 0, np.arange(len(stamps), dtype=float)
    if len(stamps) < 4:
        return Clock(usual, 0.0, 0.0, dropped)
    place = 2 * ticks / ticks[-1] - 1
    bent = np.polyfit(place, stamps, 2)
    rate = 4 * bent[0] / bent[1]
    jitter = float(np.abs(stamps - np.polyval(bent, place)).max())
    # A curvature that the jitter itself makes is none.
    noise = float(np.std(stamps - np.polyval(bent, place))) * math.sqrt(180 / len(stamps))
    if jitter < ROUNDING * usual:
        jitter = 0.0
    drifts = abs(bent[0]) > 4 * max(noise, ROUNDING * usual)
    return Clock(usual, jitter, float(rate) if drifts else 0.0, dropped)


def wraps(values: Vector, scale: float) -> tuple[float, int, str] | None:
    """Jumps of one size that take a signal away and leave it smooth once they are undone.

    Where samples are missing the signal has moved on meanwhile, and nothing is told.

    Args:
        values: shape (samples,).
        scale: unit of the values over a number as it was logged.

    Returns:
        Size of the jumps, their number, and what range of the logged numbers that is; None if there are none.
    """
    there = np.flatnonzero(np.isfinite(values))
    apart = np.diff(there)
    steps = np.abs(np.diff(values[there]))[apart <= (np.median(apart) if len(apart) else 0)]
    if len(steps) < 16:
        return None
    order = np.sort(steps)
    gaps = order[1:] / np.maximum(order[:-1], 1e-300)
    last = len(order) - max(2, len(order) // 10)
    candidates = last + np.flatnonzero(gaps[last:] > JUMP)
    for k in candidates:
        jumps, rest = order[k + 1 :], order[k]
        size = float(np.median(jumps))
        if not len(jumps) or rest <= 0 or np.ptp(jumps) > 2 * max(ALIKE * size, 2 * rest):
            continue
        logged = size / abs(scale)
        # A jump is the range less what the machine moved meanwhile.
        room = max(0.01 * logged, 2 * rest / abs(scale))
        known = [(abs(logged - n), name) for n, name in COUNTERS.items() if abs(logged - n) <= room]
        if known and (min(known)[1] != "1" or rest < 0.05 * size):
            return size, len(jumps), min(known)[1]
    return None


def frozen(values: Vector) -> list[slice]:
    """Stretches in which a signal that moves keeps one value, and then is where it would have been.

    A joint that sticks stays where it was; a sensor that freezes comes back with a jump.
    """
    same = np.concatenate([[False], np.diff(values) == 0, [False]])
    runs = np.flatnonzero(np.diff(same.astype(int))).reshape(-1, 2)
    moves = np.abs(np.diff(values))
    moves = moves[np.isfinite(moves) & (moves > 0)]
    if not len(moves):
        return []
    found = []
    for begin, end in runs:
        first, last = begin, end  # samples first ... last are equal
        if last - first < FROZEN or first < 3 or last + 1 >= len(values):
            continue
        length = int(last - first)
        around = np.abs(np.diff(np.concatenate([values[max(0, first - length) : first + 1]])))
        speed = float(np.median(around)) if len(around) else 0.0
        jump = abs(float(values[last + 1] - values[last]))
        if speed > 0 and jump > max(3 * speed, CATCH_UP * speed * length):
            found.append(slice(int(first), int(last) + 1))
    return found


def every(values: Vector) -> int:
    """After how many samples a signal takes a new value, if it does so regularly; 1 for each."""
    changes = np.flatnonzero(np.diff(values) != 0)
    if len(changes) < 20:
        return 1
    apart = np.diff(changes)
    usual = int(np.median(apart))
    return usual if usual > 1 and np.mean(apart % usual == 0) > 0.9 else 1


def early(values: Vector, drives: Sequence[Vector]) -> int:
    """By how many samples a signal answers inputs before they come; 0 if it does not.

    The next sample is predicted from those before and from the inputs up to it; if inputs that come later make the
    error clearly smaller, the input's column is late. Not for a loop, in which the input answers the signal.

    Args:
        values: shape (samples,).
        drives: each of shape (samples,).
    """
    if not drives or not np.isfinite(values).all() or len(values) < 20 * (MEMORY + LATE):
        return 0
    y = (values - values.mean()) / max(float(values.std()), 1e-300)
    u = [(d - d.mean()) / d.std() for d in drives if d.std() > 0]
    if not u:
        return 0
    rows = np.arange(MEMORY, len(y) - LATE)
    past = [y[rows - k] for k in range(1, MEMORY + 1)]
    known = [d[rows - k] for d in u for k in range(MEMORY)]
    later = [d[rows + k] for k in range(1, LATE + 1) for d in u]
    base = np.column_stack([np.ones(len(rows)), *past, *known, *later])
    # What each column takes away of the target, those before it given; one that these make up takes nothing.
    upper = np.asarray(np.linalg.qr(np.column_stack([base, y[rows]]), mode="r"))
    taken, steps = upper[:, -1] ** 2, np.abs(np.diag(upper)[:-1])
    made_up = np.append(steps < 1e-10 * steps.max(), False)
    left = np.cumsum(np.where(made_up, 0.0, taken)[::-1])[::-1] + float(taken[made_up].sum())
    errors = left[base.shape[1] - len(later) :: len(u)].tolist()
    free = len(rows) - base.shape[1]
    if errors[-1] <= 0 or errors[0] < BETTER**2 * errors[-1]:
        return 0
    f = (errors[0] - errors[-1]) / (LATE * len(u)) / (errors[-1] / free)
    if fdtrc(LATE * len(u), free, f) > 1e-6:
        return 0
    gained = [(errors[0] - e) / (errors[0] - errors[-1]) for e in errors]
    return next(k for k, share in enumerate(gained) if share > 0.9)


def lines(values: Vector, drives: Sequence[Vector], interval: float) -> list[float]:
    """Frequencies (Hz) of narrow lines in the upper half of a spectrum that no input holds: hum, or aliases of it.

    Args:
        values: shape (samples,).
        drives: each of shape (samples,).
        interval: time between samples (s).
    """
    there = np.isfinite(values)
    if there.mean() < 0.95 or len(values) < 256:
        return []
    y = np.where(there, values, np.interp(np.arange(len(values)), np.flatnonzero(there), values[there]))

    def spectrum(signal: Vector) -> Vector:
        bent = np.diff(signal, 2)
        return np.asarray(np.abs(np.fft.rfft(bent * np.blackman(len(bent)))) ** 2)

    power = spectrum(y)
    half = len(power) // 2
    around = np.array([np.median(power[max(0, k - 40) : k + 41]) for k in range(half, len(power))])
    strong = half + np.flatnonzero(power[half:] > LINE * np.maximum(around, 1e-300))
    for drive in drives:
        if np.ptp(drive) == 0:
            continue
        own = spectrum(drive)
        strong = strong[own[strong] < LINE * np.median(own[half:])]
    found: list[float] = []
    for k in strong:
        if power[k] == power[max(0, k - 4) : k + 5].max():
            found.append(float(k / (len(y) - 2) / interval))
    return found if len(found) <= 5 else []
