"""The spectrum of a decay: its lines, and the noise between them."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import find_peaks
from scipy.signal.windows import blackmanharris, hann

from diagnosis.decay.record import DecayRecord
from diagnosis.recordings.columns import RecordingError, Vector

PADDING = 8
"""A transform is at least this many times as long as its samples."""

VISIBLE = 4.0
"""A line lower than this many times the noise is not seen."""

SMALLEST_LINE = 0.02
"""Lines lower than this fraction of the largest are left out."""

PROMINENCE = 6.0
"""Height of a line above the dips beside it (dB)."""


def find_lines(record: DecayRecord, count: int = 4, start: float = 0.0) -> tuple[float, ...]:
    """Frequencies (Hz) of the strongest lines of a decay, in ascending order.

    The spectrum is that of the whole record, tapered so that the beginning counts most.

    Args:
        record: the decay.
        count: largest number of lines.
        start: time (s) at which the decay begins.

    Raises:
        RecordingError: there is no line.
    """
    y = record.values[record.first(start) :]
    n = len(y)
    size = padded_length(n)
    spectrum = np.abs(np.fft.rfft((y - rest_value(y[n // 2 :])) * half_hann(n), size))
    axis = np.fft.rfftfreq(size, record.step)
    logarithm = 20 * np.log10(np.maximum(spectrum, 1e-9 * spectrum.max()))
    floor = float(np.median(spectrum[axis > 0]))
    height = 20 * math.log10(max(SMALLEST_LINE * float(spectrum.max()), VISIBLE * floor))
    lines = find_peaks(logarithm, height=height, prominence=PROMINENCE)[0]
    lines = lines[axis[lines] >= 1.5 / (n * record.step)]
    if not len(lines):
        raise RecordingError(
            f"'{record.name}' shows no vibration: its spectrum has no line",
            remedy="give the frequency of its vibration, if you know it",
        )
    strongest = sorted(lines, key=lambda k: -float(spectrum[k]))[:count]
    return tuple(sorted(float(axis[k]) for k in strongest))


def dominant_frequency(values: Vector, step: float) -> float:
    """Frequency (Hz) of the strongest line; the beginning counts most.

    Args:
        values: the signal, shape (samples,).
        step: sampling interval (s).
    """
    n = len(values)
    taper = half_hann(n)
    centred = values - float(taper @ values) / float(taper.sum())
    size = padded_length(n)
    spectrum = np.abs(np.fft.rfft(centred * taper, size))
    axis = np.fft.rfftfreq(size, step)
    allowed = axis >= 1 / (n * step)
    return float(axis[allowed][int(np.argmax(spectrum[allowed]))])


def noise_between_lines(values: Vector, step: float, frequencies: tuple[float, ...]) -> float:
    """Standard deviation of white noise with the level of the spectrum between its lines.

    The median of |FFT|^2 over the second half of the record (Hann window), up to four times the highest frequency and
    over at least 64 bins, divided by ln 2 (median of an exponential variable). Coloured noise counts with its level
    there.

    Args:
        values: the record less its rest value, shape (samples,).
        step: sampling interval (s).
        frequencies: of the lines (Hz).
    """
    tail = values[len(values) // 2 :]
    taper = hann(len(tail), sym=False)
    power = np.abs(np.fft.rfft(tail * taper)) ** 2 / float(taper @ taper)
    resolution = 1 / (len(tail) * step)
    axis = np.arange(len(power)) * resolution
    away = axis > 1.5 * resolution
    for frequency in frequencies:
        away &= np.abs(axis - frequency) > max(6 * resolution, 0.15 * frequency)
    highest = max(4 * max(frequencies), 64 * resolution)
    chosen = power[away & (axis <= highest)]
    if len(chosen) < 4:
        chosen = power[1:]
    return math.sqrt(float(np.median(chosen)) / math.log(2))


def rest_value(values: Vector) -> float:
    """Mean under a Blackman-Harris window, in which vibrations of more than four periods leave nothing."""
    weights = blackmanharris(len(values), sym=False)
    return float(weights @ values) / float(weights.sum())


def half_hann(n: int) -> Vector:
    """The falling half of a Hann window, shape (n,)."""
    return np.asarray(hann(2 * n, sym=False)[n:], dtype=np.float64)


def padded_length(n: int) -> int:
    """Length of the transform of n samples: a power of two, at least `PADDING` times as long."""
    return 1 << math.ceil(math.log2(PADDING * n))
