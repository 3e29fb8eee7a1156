"""Windows that move along a decay, and their spectra."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import hann

from diagnosis.decay.record import DecayRecord
from diagnosis.decay.spectrum import VISIBLE, find_lines, noise_between_lines, padded_length, rest_value
from diagnosis.recordings.columns import RecordingError, Vector
from engine.errors import ParameterError

TAPERS = ("hann", "rectangular")

BAND = 0.15
"""Half the width of the band around a mode's frequency in which its amplitude is sought, as a fraction of it."""

LEAST_SAMPLES = 8
"""Smallest number of samples in a window."""

MOST_VALUES = 30_000_000
"""Largest number of windows times frequencies."""

SIDE_LOBE = 0.05
"""A line lower than this fraction of a neighbour may be a side lobe of it."""


class RecordTooShort(RecordingError):
    """The record is shorter than the windows together."""


@dataclass(frozen=True)
class Windows:
    """Transforms of windows that move along a record.

    Attributes:
        record: the whole decay.
        begins: first sample of each window, shape (windows,).
        taper: ``hann`` or ``rectangular``.
        shape: values of the taper, shape (samples of a window,).
        axis: frequencies (Hz), up to four times that of the highest mode, shape (bins,).
        transforms: FFT of each tapered window, padded with zeros, its time counted from its begin: (windows, bins).
        rest: value removed from the signal.
        noise: standard deviation of the record's noise.
    """

    record: DecayRecord
    begins: NDArray[np.int64]
    taper: str
    shape: Vector
    axis: Vector
    transforms: NDArray[np.complex128]
    rest: float
    noise: float

    @property
    def times(self) -> Vector:
        """Begin of each window (s)."""
        return np.asarray(self.begins * self.record.step, dtype=np.float64)

    @property
    def length(self) -> float:
        """Duration of a window (s)."""
        return len(self.shape) * self.record.step

    @property
    def level(self) -> float:
        """Root mean square |FFT| of a window of noise."""
        return self.noise * math.sqrt(float(self.shape @ self.shape))

    @property
    def scale(self) -> float:
        """Factor from |FFT| to the amplitude of a steady sine."""
        return 2 / float(self.shape.sum())

    def band(self, frequency: float) -> NDArray[np.int64]:
        """Bins within 15 % of a frequency (Hz); at least one."""
        found = np.flatnonzero(np.abs(self.axis - frequency) <= BAND * frequency)
        return found if len(found) else np.array([int(np.argmin(np.abs(self.axis - frequency)))])

    def covariance(self, used: int) -> Vector:
        """Covariance of the noise in |FFT| of the first ``used`` windows, shape (used, used).

        It is noise^2 / 2 times the overlap of their tapers.
        """
        n = len(self.shape)
        shifts = np.abs(np.subtract.outer(self.begins[:used], self.begins[:used]))
        different, where = np.unique(shifts, return_inverse=True)
        overlaps = [float(self.shape[shift:] @ self.shape[: max(n - shift, 0)]) for shift in different]
        return np.asarray(np.array(overlaps)[where].reshape(shifts.shape) * self.noise**2 / 2)


def cut_windows(
    record: DecayRecord,
    modes: tuple[float, ...],
    window: float,
    hop: float,
    count: int | None,
    start: float,
    taper: str,
    rest: float | None,
) -> Windows:
    """Cut a record into windows and transform them.

    Args:
        record: the decay.
        modes: frequencies of its lines (Hz), between which its noise is measured.
        window: length of a window (s).
        hop: from one window to the next (s).
        count: number of windows; None for as many as the record holds.
        start: begin of the first window (s).
        taper: ``hann`` or ``rectangular``.
        rest: value about which the signal swings; found if None.

    Raises:
        RecordTooShort: the record does not hold them.
        ParameterError: settings that mean nothing.
    """
    if taper not in TAPERS:
        raise ParameterError(f"unknown taper '{taper}'", remedy=f"allowed: {', '.join(TAPERS)}")
    begins, n = _positions(record, window, hop, count, start)
    whole = record.values[begins[0] :]
    if rest is not None and not math.isfinite(rest):
        raise ParameterError(f"rest {rest:g} is not a finite number")
    rest = rest_value(whole) if rest is None else rest
    shape = hann(n, sym=False) if taper == "hann" else np.ones(n)
    size = padded_length(n)
    axis = np.fft.rfftfreq(size, record.step)
    axis = axis[axis <= max(4 * max(modes), 10 / window)]
    if len(begins) * len(axis) > MOST_VALUES:
        raise ParameterError(
            f"{len(begins)} windows of {len(axis)} frequencies do not fit into memory", remedy="take longer hops"
        )
    transforms = np.array([np.fft.rfft((record.values[b : b + n] - rest) * shape, size)[: len(axis)] for b in begins])
    noise = noise_between_lines(whole - rest, record.step, modes)
    return Windows(record, begins, taper, shape, np.asarray(axis, dtype=np.float64), transforms, rest, noise)


def _positions(
    record: DecayRecord, window: float, hop: float, count: int | None, start: float
) -> tuple[NDArray[np.int64], int]:
    """First samples of the windows, and the number of samples in a window."""
    for name, value in (("window", window), ("hop", hop)):
        if not (math.isfinite(value) and value >= record.step):
            raise ParameterError(f"{name} {value:g} s is shorter than the sampling interval, {record.step:g} s")
    if count is not None and count < 2:
        raise ParameterError(f"windows = {count}", remedy="a slope needs at least two windows")
    n = round(min(window / record.step, 2.0**53))  # a window may be absurdly long
    if n < LEAST_SAMPLES:
        raise ParameterError(f"window {window:g} s holds {n} samples", remedy=f"at least {LEAST_SAMPLES} are needed")
    room = len(record.values) - record.first(start) - n
    fits = math.floor((room * record.step + 1e-9) / hop) + 1 if room >= 0 else 0
    wanted = max(fits if count is None else count, 2)
    if wanted > fits:
        begun = f" from {start:g} s" if start else ""
        raise RecordTooShort(
            f"the record lasts {record.length:.4g} s, but {wanted} windows of {window:.4g} s at hops of {hop:.4g} s"
            f"{begun} need {start + window + (wanted - 1) * hop:.4g} s",
            remedy=f"take shorter, closer or fewer windows (it holds {fits} of these)",
        )
    return np.array([round((start + k * hop) / record.step) for k in range(wanted)], dtype=np.int64), n


def require_line(windows: Windows, frequency: float) -> None:
    """Check that the first window shows a line at a frequency (Hz).

    Raises:
        RecordingError: there is only noise, or the flank or a side lobe of another line.
    """
    band = windows.band(frequency)
    n, axis = len(windows.shape), windows.axis
    first = np.abs(windows.transforms[0])
    if windows.taper != "hann":
        begin = int(windows.begins[0])
        values = windows.record.values[begin : begin + n] - windows.rest
        first = np.abs(np.fft.rfft(values * hann(n, sym=False), padded_length(n)))[: len(axis)]
    here = int(band[int(np.argmax(first[band]))])
    inside = band[0] < here < band[-1] or len(band) < 3
    near = np.abs(axis - axis[here]) <= 5 / windows.length
    side_lobe = first[here] < SIDE_LOBE * float(first[near].max())
    if inside and not side_lobe and first[here] >= VISIBLE * windows.level:
        return
    try:
        lines = ", ".join(f"{found:.4g}" for found in find_lines(windows.record, start=float(windows.times[0])))
        remedy = f"its spectrum shows lines at {lines} Hz"
    except RecordingError:
        remedy = "its spectrum shows no lines"
    raise RecordingError(
        f"there is no vibration within {100 * BAND:g} % of {frequency:g} Hz in the record", remedy=remedy
    )
