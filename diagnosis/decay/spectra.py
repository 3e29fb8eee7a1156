"""Lines in the spectrum of a decay, and spectra of windows that move along it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.decay.record import DecayRecord, hann, sine_noise
from diagnosis.recordings.columns import RecordingError, Vector
from engine.errors import ParameterError

TAPERS = ("hann", "rectangular")
BAND = 0.15
"""Half width of the band around a mode's frequency in which its amplitude is sought, relative."""
PADDING = 8
MOST_VALUES = 30_000_000
DEAD = 4.0
"""A window in which a mode is lower than this many times the noise no longer shows it."""


class RecordTooShort(RecordingError):
    """The record does not hold the windows."""


@dataclass(frozen=True)
class Windows:
    """Transforms of windows that move along a record.

    Attributes:
        record: what they are cut from.
        begins: first sample of each, shape (windows,).
        taper: ``hann`` or ``rectangular``.
        shape: the taper, shape (samples of a window,).
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
        """Of a window (s)."""
        return len(self.shape) * self.record.step

    @property
    def level(self) -> float:
        """Root mean square |FFT| of a window of noise."""
        return self.noise * math.sqrt(float(self.shape @ self.shape))

    @property
    def scale(self) -> float:
        """From |FFT| to the amplitude of a steady sine."""
        return 2 / float(self.shape.sum())

    def band(self, frequency: float) -> NDArray[np.int64]:
        """Bins within 15 % of a frequency (Hz); at least one."""
        found = np.flatnonzero(np.abs(self.axis - frequency) <= BAND * frequency)
        return found if len(found) else np.array([int(np.argmin(np.abs(self.axis - frequency)))])

    def covariance(self, used: int) -> Vector:
        """Of the noise in |FFT| of the first ``used`` windows: noise^2 / 2 times the overlap of their tapers."""
        n = len(self.shape)
        overlap: dict[int, float] = {}
        made = np.empty((used, used))
        for i, a in enumerate(self.begins[:used]):
            for j, b in enumerate(self.begins[:used]):
                shift = abs(int(a) - int(b))
                if shift not in overlap:
                    overlap[shift] = float(self.shape[shift:] @ self.shape[: n - shift]) if shift < n else 0.0
                made[i, j] = overlap[shift]
        return made * self.noise**2 / 2


def cut(
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
        count: how many; None for as many as the record holds.
        start: begin of the first window (s).
        taper: ``hann`` or ``rectangular``.
        rest: value to remove; None to find it.

    Raises:
        RecordTooShort: for the windows.
        ParameterError: settings that mean nothing.
    """
    if taper not in TAPERS:
        raise ParameterError(f"unknown taper '{taper}'", remedy=f"allowed: {', '.join(TAPERS)}")
    begins, n = _positions(record, window, hop, count, start)
    whole = record.values[begins[0] :]
    if rest is not None and not math.isfinite(rest):
        raise ParameterError(f"rest {rest:g} is not a finite number")
    rest = _rest(whole) if rest is None else rest
    shape = hann(n) if taper == "hann" else np.ones(n)
    size = padded(n)
    axis = np.fft.rfftfreq(size, record.step)
    axis = axis[axis <= max(4 * max(modes), 10 / window)]
    if len(begins) * len(axis) > MOST_VALUES:
        raise ParameterError(
            f"{len(begins)} windows of {len(axis)} frequencies do not fit into memory", remedy="take longer hops"
        )
    transforms = np.array([np.fft.rfft((record.values[b : b + n] - rest) * shape, size)[: len(axis)] for b in begins])
    noise = sine_noise(whole - rest, record.step, modes)
    return Windows(record, begins, taper, shape, np.asarray(axis, dtype=np.float64), transforms, rest, noise)


def padded(n: int) -> int:
    """Length of the transform of n samples: at least eight times as long, a power of two."""
    return 1 << math.ceil(math.log2(PADDING * n))


def _positions(
    record: DecayRecord, window: float, hop: float, count: int | None, start: float
) -> tuple[NDArray[np.int64], int]:
    """First samples of the windows, and samples in a window."""
    for name, value in (("window", window), ("hop", hop)):
        if not (math.isfinite(value) and value >= record.step):
            raise ParameterError(f"{name} {value:g} s is shorter than the sampling interval, {record.step:g} s")
    if count is not None and count < 2:
        raise ParameterError(f"windows = {count}", remedy="a slope needs at least two windows")
    n = round(min(window / record.step, 2.0**53))  # a window may be beyond all proportion
    if n < 8:
        raise ParameterError(f"window {window:g} s holds {n} samples", remedy="at least 8 are needed")
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


def _rest(values: Vector) -> float:
    """Mean weighted so that vibrations of more than four periods leave nothing (Blackman-Harris)."""
    from scipy.signal.windows import blackmanharris

    weights = blackmanharris(len(values), sym=False)
    return float(weights @ values) / float(weights.sum())


def find_lines(record: DecayRecord, count: int = 4, start: float = 0.0) -> tuple[float, ...]:
    """Frequencies (Hz) of the strongest lines of a decay, rising; those below 2 % of the largest are left out.

    The spectrum is that of the whole record, tapered so that the beginning counts most; a line must stand at least
    6 dB above the dips beside it.

    Args:
        record: the decay.
        count: how many at most.
        start: time (s) from which the record is looked at.

    Raises:
        RecordingError: there is none.
    """
    from scipy.signal import find_peaks

    y = record.values[record.first(start) :]
    n = len(y)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n)
    size = padded(n)
    spectrum = np.abs(np.fft.rfft((y - _rest(y[n // 2 :])) * taper, size))
    axis = np.fft.rfftfreq(size, record.step)
    logarithm = 20 * np.log10(np.maximum(spectrum, 1e-9 * spectrum.max()))
    floor = float(np.median(spectrum[axis > 0]))
    height = 20 * math.log10(max(0.02 * float(spectrum.max()), DEAD * floor))
    marks = find_peaks(logarithm, height=height, prominence=6.0)[0]
    marks = marks[axis[marks] >= 1.5 / (n * record.step)]
    if not len(marks):
        raise RecordingError(
            f"'{record.name}' shows no vibration: its spectrum has no line",
            remedy="say at which frequency it vibrates if you know it",
        )
    strongest = sorted(marks, key=lambda mark: -float(spectrum[mark]))[:count]
    return tuple(sorted(float(axis[mark]) for mark in strongest))


def require_line(windows: Windows, frequency: float) -> None:
    """Refuse a frequency (Hz) at which the first window shows no line of its own.

    Raises:
        RecordingError: there is only noise, the skirt of another line, or a side lobe of it.
    """
    band = windows.band(frequency)
    n, axis = len(windows.shape), windows.axis
    first = np.abs(windows.transforms[0])
    if windows.taper != "hann":
        begin = int(windows.begins[0])
        values = windows.record.values[begin : begin + n] - windows.rest
        first = np.abs(np.fft.rfft(values * hann(n), padded(n)))[: len(axis)]
    here = int(band[int(np.argmax(first[band]))])
    inside = band[0] < here < band[-1] or len(band) < 3
    near = np.abs(axis - axis[here]) <= 5 / windows.length
    side_lobe = first[here] < 0.05 * float(first[near].max())
    if inside and not side_lobe and first[here] >= DEAD * windows.level:
        return
    try:
        lines = ", ".join(f"{found:.4g}" for found in find_lines(windows.record, start=float(windows.times[0])))
        remedy = f"its spectrum shows lines at {lines} Hz"
    except RecordingError:
        remedy = "its spectrum shows no lines"
    raise RecordingError(
        f"there is no vibration within {100 * BAND:g} % of {frequency:g} Hz in the record", remedy=remedy
    )
