"""How far one clock is behind another: two signals that show the same motion, slid over each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.recordings.columns_type import Vector

MOST_POINTS = 1 << 20
"""Points of the grid on which signals are compared."""
OVERLAP = 0.3
"""Share of the shorter signal that must meet the other."""
PIECES = 12
"""Stretches in which the rate of a clock is looked for."""


@dataclass(frozen=True)
class Alignment:
    """A clock against another: instant = offset + rate * its own instant.

    Attributes:
        offset: s.
        rate: seconds of the other clock to one of its own.
        correlation: of the two signals there; negative where they move against each other.
        rival: magnitude of the next highest correlation at another offset; near the highest, the offset is a guess.
    """

    offset: float
    rate: float
    correlation: float
    rival: float


def align(time: Vector, values: Vector, own: Vector, signal: Vector, *, rate: float | None = 1.0) -> Alignment | None:
    """The offset of a clock at which two signals are most alike; None if they cannot be compared.

    The highest magnitude of the correlation over the stretch in which both are there; between the points of the grid a
    parabola, and the rate by a straight line through the offsets of stretches, weighted with their likeness.

    Args:
        time: instants of the first signal (s), shape (n,).
        values: shape (n,).
        own: instants of the second signal on its own clock (s), shape (m,).
        signal: shape (m,).
        rate: of the clock; None if it is to be found.
    """
    time, values = _finite(time, values)
    own, signal = _finite(own, signal)
    if min(len(time), len(own)) < 16 or np.ptp(values) == 0 or np.ptp(signal) == 0:
        return None
    fixed = 1.0 if rate is None else rate
    step = max(
        min(float(np.median(np.diff(time))), fixed * float(np.median(np.diff(own)))),
        (np.ptp(time) + np.ptp(own)) / MOST_POINTS,
    )
    a = _even(time, values, step)
    for _ in range(3 if rate is None else 1):
        scaled = fixed * own
        b = _even(scaled, signal, step)
        found = _slide(a, b, step)
        if found is None:
            return None
        lag, correlation, rival = found
        offset = float(time[0]) + lag - float(scaled[0])
        if rate is not None:
            break
        slope = _slope(a, b, step, lag)
        if slope is None:
            break
        # The stretches' own lags are counted from the first sample of either signal.
        fixed *= 1 + slope
    scaled = fixed * own
    found = _slide(a, _even(scaled, signal, step), step)
    if found is None:
        return None
    lag, correlation, rival = found
    offset = float(time[0]) + lag - float(scaled[0])
    return Alignment(offset, fixed, correlation, rival)


def _finite(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    there = np.isfinite(time) & np.isfinite(values)
    return time[there], values[there]


def _even(time: Vector, values: Vector, step: float) -> Vector:
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    made = np.interp(grid, time, values)
    return np.asarray((made - made.mean()) / (made.std() or 1.0), dtype=float)


def _correlations(a: Vector, b: Vector) -> tuple[Vector, Vector]:
    """Lags of ``b`` in points, and the correlation over what then overlaps; 0 where too little does."""
    from scipy.signal import fftconvolve  # on first use, as it is large and seldom needed

    one_a, one_b = np.ones_like(a), np.ones_like(b)

    def slid(x: Vector, y: Vector) -> Vector:
        return np.asarray(fftconvolve(x, y[::-1]), dtype=float)

    count = np.maximum(slid(one_a, one_b), 1.0)
    mean_a, mean_b = slid(a, one_b) / count, slid(one_a, b) / count
    var_a = slid(a * a, one_b) / count - mean_a**2
    var_b = slid(one_a, b * b) / count - mean_b**2
    whole = np.sqrt(np.maximum(var_a, 0) * np.maximum(var_b, 0))
    made = np.zeros(len(count))
    # A stretch at rest is like every other one at rest.
    good = (count >= OVERLAP * min(len(a), len(b))) & (np.minimum(var_a, var_b) > 0.05)
    made[good] = (slid(a, b)[good] / count[good] - mean_a[good] * mean_b[good]) / whole[good]
    lags = np.arange(len(made), dtype=np.float64) - np.float64(len(b) - 1)
    return lags, np.clip(made, -1, 1)


def _slide(a: Vector, b: Vector, step: float) -> tuple[float, float, float] | None:
    """Lag (s), correlation there, and the next highest one outside of the peak."""
    lags, found = _correlations(a, b)
    size = np.abs(found)
    best = int(np.argmax(size))
    if not size[best] > 0:
        return None
    lag = float(lags[best])
    if 0 < best < len(size) - 1:
        left, peak, right = size[best - 1 : best + 2]
        curve = left - 2 * peak + right
        lag += float(np.clip(0.5 * (left - right) / curve, -0.5, 0.5)) if curve < 0 else 0.0
    first, last = best, best
    while first > 0 and size[first - 1] <= size[first]:
        first -= 1
    while last < len(size) - 1 and size[last + 1] <= size[last]:
        last += 1
    rest = np.concatenate([size[:first], size[last + 1 :]])
    return lag * step, float(found[best]), float(rest.max(initial=0.0))


def _slope(a: Vector, b: Vector, step: float, lag: float) -> float | None:
    """By how much, per second of ``b``, its lag grows; None where stretches do not say."""
    length = len(b) // PIECES
    if length < 32:
        return None
    places, lags, weights = [], [], []
    reach = max(8, length // 2)
    for k in range(PIECES):
        piece = b[k * length : (k + 1) * length]
        begin = round(k * length + lag / step)
        window = a[max(begin - reach, 0) : begin + length + reach]
        if len(window) < length or piece.std() < 0.05:
            continue
        moved, found = _correlations(window, piece)
        inside = (moved >= 0) & (moved <= len(window) - length)
        size = np.where(inside, np.abs(found), 0.0)
        best = int(np.argmax(size))
        if size[best] < 0.5 or not 0 < best < len(size) - 1:
            continue
        left, peak, right = np.abs(found[best - 1 : best + 2])
        curve = left - 2 * peak + right
        fine = float(moved[best]) + (0.5 * (left - right) / curve if curve < 0 else 0.0)
        places.append((k + 0.5) * length)
        lags.append(max(begin - reach, 0) + fine - k * length)
        weights.append(size[best])
    if len(places) < 4:
        return None
    x, y, w = np.array(places), np.array(lags), np.array(weights)
    # A stretch that found another period is no witness.
    for _ in range(3):
        slope, level = np.polyfit(x, y, 1, w=w)
        off = np.abs(y - slope * x - level)
        kept = off <= max(3 * float(np.median(off)), 0.5)
        if kept.all() or kept.sum() < 4:
            break
        x, y, w = x[kept], y[kept], w[kept]
    return float(slope)
