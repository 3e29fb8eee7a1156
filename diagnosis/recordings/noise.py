"""The noise of a recorded signal, from the signal alone: at rest, between repeated periods, or between its samples.

What a signal does between samples is not noise. A sample is held against the polynomial through its neighbours. Where
the signal moves fast, low orders leave its own curvature and high ones do not; for white noise all orders agree. The
order is raised until they do. So the estimate comes from the part of the spectrum above what the machine does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import Vector

NORMAL = 1.4826
"""Standard deviation over the median absolute deviation of a normal variable."""
ORDERS = (2, 4, 6, 8, 10, 12)
"""Numbers of neighbours that a sample is held against."""
SETTLED = 0.9
"""Orders agree if the next leaves at least this share of what the last left."""
FEWEST_AT_REST = 50
"""Samples of a stretch at rest; the standard deviation of fewer is more than a tenth off."""
WHITE = 0.35
"""Correlation of neighbouring samples of a stretch up to which nothing moves there."""
EVEN = 1e-3
"""Deviation from even intervals, as a share of one, up to which samples are even."""


@dataclass(frozen=True)
class Noise:
    """The noise of a signal.

    Attributes:
        sigma: standard deviation, in the signal's unit; 0 if it cannot be told.
        quantum: step in which the signal is logged; 0 if it has none.
        source: ``at rest``, ``repeated periods``, ``between samples`` or ``quantum``.
        logged: standard deviation of samples about their neighbours, whatever ``source`` says.
        at_rest: standard deviation at rest; NaN if it never rests.
    """

    sigma: float
    quantum: float
    source: str
    logged: float
    at_rest: float


def quantum(values: Vector) -> float:
    """Step of which all values are whole multiples apart; 0 if there is none."""
    clean = values[np.isfinite(values)]
    steps = np.abs(np.diff(np.unique(clean)))
    steps = steps[steps > 1e-12 * max(float(np.abs(clean).max(initial=0.0)), 1e-300)]
    least = float(steps.min()) if steps.size else 0.0
    if steps.size and np.median(np.abs(steps / least - np.round(steps / least))) > 1e-3:
        return 0.0
    return least


def noise(time: Vector, values: Vector, drives: Sequence[Vector] = ()) -> Noise:
    """The noise of a signal.

    Args:
        time: instants (s), increasing, shape (samples,).
        values: shape (samples,), NaN where nothing was recorded.
        drives: what drove the machine, each of shape (samples,): it rests where they do, and repeats where they do.
    """
    there = np.isfinite(values)
    step = quantum(values)
    logged = between_samples(time[there], values[there], quantised=step > 0)
    rest = _at_rest(values, drives, logged)
    repeated = _over_periods(values, drives)
    sigma, source = logged, "between samples"
    if math.isfinite(rest):
        sigma, source = rest, "at rest"
    elif math.isfinite(repeated):
        sigma, source = repeated, "repeated periods"
    if step / math.sqrt(12) >= sigma:
        sigma, source = step / math.sqrt(12), "quantum"
    return Noise(sigma, step, source, logged, rest)


def between_samples(time: Vector, values: Vector, *, quantised: bool = False) -> float:
    """Standard deviation of samples about the polynomial through their neighbours, of the order at which it settles.

    Args:
        time: instants (s), increasing, shape (samples,).
        values: finite, shape (samples,).
        quantised: whether samples may be equal to their neighbours by rounding; else such ones are a sensor at the end
            of its range, which shows no noise.
    """
    sigma = 0.0
    for number, order in enumerate(ORDERS):
        if len(values) < 4 * order:
            break
        found = _spread(about_neighbours(time, values, order), quantised)
        if number and found > SETTLED * sigma:
            return min(found, sigma)
        sigma = found
    return sigma


def about_neighbours(time: Vector, values: Vector, order: int) -> Vector:
    """Each sample less the polynomial through ``order`` neighbours, over what white noise of 1 leaves.

    Shape (samples - order,); the first and last ``order / 2`` samples have no neighbours on one side.
    """
    half = order // 2
    offsets = [k for k in range(-half, half + 1) if k]
    count = len(values) - order
    steps = np.diff(time)
    usual = float(np.median(steps)) if len(steps) else 1.0
    made = values[half : half + count].astype(float).copy()
    power = np.ones(count)
    if len(steps) and np.abs(steps - usual).max() <= EVEN * usual:
        places = {k: np.full(1, float(k)) for k in (0, *offsets)}
    else:
        at = {k: time[half + k : half + k + count] for k in (0, *offsets)}
        places = {k: (at[k] - at[0]) / usual for k in at}
    for k in offsets:
        weight = np.ones_like(places[k])
        for other in offsets:
            if other != k:
                weight = weight * places[other] / (places[other] - places[k])
        made -= weight * values[half + k : half + k + count]
        power = power + weight**2
    return np.asarray(made / np.sqrt(power))


def _spread(residual: Vector, quantised: bool) -> float:
    """Standard deviation by the median, which spikes and kinks do not move."""
    if not quantised:
        scale = np.abs(residual).max(initial=0.0)
        residual = residual[np.abs(residual) > 1e-12 * scale]
    return NORMAL * float(np.median(np.abs(residual - np.median(residual)))) if residual.size else 0.0


def rests(values: Vector, drives: Sequence[Vector], logged: float) -> list[slice]:
    """Stretches in which the drives hold still and the signal only shows noise.

    Args:
        values: shape (samples,).
        drives: each of shape (samples,); without any a stretch is one in which the signal holds still by itself.
        logged: standard deviation of samples about their neighbours.
    """
    still = np.isfinite(values)
    for drive in drives:
        moves = np.abs(np.diff(drive, prepend=drive[0])) > 1e-6 * max(float(np.ptp(drive)), 1e-300)
        still &= ~moves
    found = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        # What a step of the drive has set going dies down: the last part of a stretch is the quietest.
        for first in (begin, begin + (end - begin) // 2, begin + 3 * (end - begin) // 4):
            part = values[first:end]
            if len(part) >= FEWEST_AT_REST and _is_noise(part, logged):
                found.append(slice(int(first), int(end)))
                break
    return found


def _is_noise(part: Vector, logged: float) -> bool:
    part = _without_line(part)
    power = float(part @ part) / len(part)
    if power <= 0:
        return True
    neighbours = float(part[1:] @ part[:-1]) / len(part) / power
    return abs(neighbours) < WHITE or (logged > 0 and power < (1.5 * logged) ** 2)


def _without_line(part: Vector) -> Vector:
    place = np.linspace(-1, 1, len(part))
    return np.asarray(part - part.mean() - place * float(place @ part) / float(place @ place))


def _at_rest(values: Vector, drives: Sequence[Vector], logged: float) -> float:
    """Standard deviation over all stretches at rest; NaN if there is none."""
    parts = [_without_line(values[part]) for part in rests(values, drives, logged)] if drives else []
    if not parts:
        return math.nan
    joined = np.concatenate(parts)
    return NORMAL * float(np.median(np.abs(joined))) or float(joined.std())


def period(drives: Sequence[Vector]) -> int:
    """Samples after which every drive repeats itself to the end, at least twice in the recording; 0 if none does."""
    if not drives:
        return 0
    count = len(drives[0])
    scaled = [(d - d.mean()) / np.ptp(d) for d in drives if np.ptp(d) > 0]
    if not scaled:
        return 0
    size = 1 << (2 * count - 1).bit_length()
    alike = sum(np.fft.irfft(np.abs(np.fft.rfft(d, size)) ** 2, size)[:count] for d in scaled)
    overlap = np.asarray(alike) * count / np.maximum(count - np.arange(count), 1)
    half = count // 2
    if half < 8:
        return 0
    peaks = 1 + np.flatnonzero((overlap[1:half] >= overlap[: half - 1]) & (overlap[1:half] >= overlap[2 : half + 1]))
    for lag in peaks[overlap[peaks] > 0.99 * overlap[0]]:
        # The first repetition of all is the period: later peaks are its multiples.
        if all(np.abs(d[lag:] - d[:-lag]).max() < 1e-6 for d in scaled):
            return int(lag)
    return 0


def _over_periods(values: Vector, drives: Sequence[Vector]) -> float:
    """Standard deviation between the last two periods of a periodic drive; NaN if it has none."""
    lag = period(drives)
    if not lag or len(values) < 3 * lag:
        return math.nan  # the first period holds how the machine settles
    apart = values[-lag:] - values[-2 * lag : -lag]
    apart = apart[np.isfinite(apart)]
    return NORMAL * float(np.median(np.abs(apart - np.median(apart)))) / math.sqrt(2) if apart.size else math.nan


SPIKE = 12.0
"""Standard deviations from which a sample that both sides contradict is an outlier; noise reaches 5."""
AGREE = 3.0
"""How many times less than from the sample the two sides' predictions differ from each other."""
MOST_SPIKES = 0.1
"""Share of the samples from which they are no outliers, but what the signal does."""


def _cubic(t: Sequence[Vector], y: Sequence[Vector], at: Vector) -> Vector:
    """The cubic through four points, each of shape (n,), at one instant of each row (Lagrange)."""
    made = np.zeros(len(at))
    for i, value in enumerate(y):
        weight = np.ones(len(at))
        for j, other in enumerate(t):
            if j != i:
                weight = weight * (at - other) / (t[i] - other)
        made = made + weight * value
    return made


def spikes(time: Vector, values: Vector, sigma: float) -> NDArray[np.bool_]:
    """Single samples, or two in a row, that jump away and back while the samples on both sides go on as before.

    The straight lines through the two samples before and after predict it; at an edge they contradict each other, at
    a kink they meet it. At a peak that few samples make up, the lines meet above it: it lies between them and its
    neighbours, as no spike does.

    Args:
        time: instants (s), shape (samples,).
        values: of a position or a speed, which inertia keeps from jumping there and back; shape (samples,).
        sigma: standard deviation of the noise.

    Returns:
        Marked samples, shape (samples,).
    """
    marked = np.zeros(len(values), dtype=bool)
    for width in (1, 2, 1):
        there = np.flatnonzero(np.isfinite(values) & ~marked)
        if len(there) < 16:
            break
        y, t = values[there], time[there]
        n = len(y) - 3 - width
        before = y[1 : 1 + n] - y[:n], t[1 : 1 + n] - t[:n]
        after = y[3 + width :][:n] - y[2 + width :][:n], t[3 + width :][:n] - t[2 + width :][:n]
        away = np.full(n, np.inf)
        sign = np.zeros((width, n))
        apart = np.zeros(n)
        for k in range(width):
            at = slice(2 + k, 2 + k + n)
            left = y[1 : 1 + n] + before[0] / before[1] * (t[at] - t[1 : 1 + n])
            right = y[2 + width :][:n] + after[0] / after[1] * (t[at] - t[2 + width :][:n])
            low, high = y[at] - left, y[at] - right
            # Straight from the sample before to the one after.
            share = (t[at] - t[1 : 1 + n]) / (t[2 + width :][:n] - t[1 : 1 + n])
            chord = y[at] - (1 - share) * y[1 : 1 + n] - share * y[2 + width :][:n]
            # At the sample in which a swing turns, the lines bend a little, and the chord is far off.
            out = (low * high > 0) & (np.minimum(low * chord, high * chord) > 0.5 * chord**2)
            # What swings fast is met by the cubic through the four, and a spike is not.
            nodes = [slice(0, n), slice(1, 1 + n), slice(2 + width, 2 + width + n), slice(3 + width, 3 + width + n)]
            bend = y[at] - _cubic([t[node] for node in nodes], [y[node] for node in nodes], t[at])
            out &= (bend * low > 0.8 * low**2) & (bend * low < 1.25 * low**2)
            sign[k] = np.where(out, np.sign(low), 0)
            away = np.minimum(away, np.minimum(np.abs(low), np.abs(high)))
            apart = np.maximum(apart, np.abs(left - right))
        alike = (sign == sign[0]).all(axis=0) & (sign[0] != 0)
        found = np.flatnonzero(alike & (away > SPIKE * sigma) & (away > AGREE * apart))
        for k in range(width):
            marked[there[found + 2 + k]] = True
    return marked if marked.sum() <= MOST_SPIKES * len(values) else np.zeros(len(values), dtype=bool)
