"""Decay records: free vibration on an even time axis, and straight lines through logarithms with their scatter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagnosis.recordings.by_header import header
from diagnosis.recordings.columns import Columns, RecordingError, Vector, read_columns
from diagnosis.recordings.mapping import Channel, Reader, Recording, checked
from engine.errors import ParameterError, Where, nearest
from engine.quantity import factor

LEAST_SAMPLES = 16
SMALLEST_FALL = 5e-3
"""A logarithm of amplitude that falls by less than this over the whole record counts as no decay."""


class DampingWarning(UserWarning):
    """The estimate was made, but something in the record or the settings speaks against it."""


@dataclass(frozen=True)
class DecayRecord:
    """A signal on an even time axis.

    Attributes:
        time: s, from 0, shape (samples,).
        values: shape (samples,).
        step: sampling interval (s).
        name, unit: of the signal; the unit is empty if the file does not say.
        notes: what was done to the data, in sentences.
    """

    time: Vector
    values: Vector
    step: float
    name: str = "signal"
    unit: str = ""
    notes: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Duration (s)."""
        return self.step * len(self.values)

    def first(self, start: float) -> int:
        """The sample at a time (s) from which an estimate begins.

        Raises:
            ParameterError: it does not lie in the record, or leaves too few samples.
            RecordingError: the signal is constant from there on.
        """
        if not (math.isfinite(start) and start >= 0 and len(self.values) - start / self.step >= LEAST_SAMPLES):
            raise ParameterError(
                f"start {start:g} s lies outside the record, which lasts {self.length:.4g} s",
                remedy=f"it must leave {LEAST_SAMPLES} samples",
            )
        found = round(start / self.step)
        if np.ptp(self.values[found:]) == 0:
            raise RecordingError(f"'{self.name}' is constant from {start:g} s on", remedy="begin earlier")
        return found


def decay_record(time: Vector, values: Vector, *, name: str = "signal", unit: str = "", file: str = "") -> DecayRecord:
    """A record from arrays: time counted from its first sample, an uneven axis interpolated.

    Args:
        time: s, rising, shape (samples,).
        values: shape (samples,).
        name: of the signal.
        unit: of the signal; empty if not known.
        file: where it came from, for messages.

    Raises:
        RecordingError: shapes that differ, too few samples, no finite numbers, a constant signal, or a gap.
    """
    from scipy.interpolate import CubicSpline

    time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    where = Where(file) if file else None
    if time.ndim != 1 or time.shape != values.shape:
        raise RecordingError(f"time has shape {time.shape} and '{name}' has shape {values.shape}", where)
    if len(time) < LEAST_SAMPLES:
        raise RecordingError(
            f"'{name}' has {len(time)} samples", where, f"a decay record needs at least {LEAST_SAMPLES} samples"
        )
    if not (np.isfinite(time).all() and np.isfinite(values).all()):
        raise RecordingError(f"'{name}' or its time holds values that are not finite", where)
    steps = np.diff(time)
    if (steps <= 0).any():
        i = int(np.flatnonzero(steps <= 0)[0])
        raise RecordingError(f"time does not rise after {time[i]:g} s", where, "sort the rows")
    if np.ptp(values) == 0:
        raise RecordingError(
            f"'{name}' is constant ({values[0]:g} in all {len(values)} samples)", where, "is it the right column?"
        )
    if not 1e-100 < np.ptp(values) < 1e100 or np.abs(values).max() > 1e100:
        raise RecordingError(
            f"'{name}' goes from {values.min():.3g} to {values.max():.3g}", where, "write it in a fitting unit"
        )
    step = float(np.median(steps))
    notes: tuple[str, ...] = ()
    if steps.max() > 2.5 * step:
        i = int(np.argmax(steps))
        raise RecordingError(
            f"'{name}' has a gap of {steps[i]:g} s at {time[i]:g} s, where samples are {step:g} s apart",
            where,
            "cut the record at the gap",
        )
    if np.ptp(steps) > 0.01 * step:
        even = np.arange(math.floor((time[-1] - time[0]) / step + 1e-9) + 1) * step
        values = np.asarray(CubicSpline(time - time[0], values)(even), dtype=float)
        notes = (f"samples are between {steps.min():g} and {steps.max():g} s apart; interpolated at {step:g} s",)
    else:
        step = float(time[-1] - time[0]) / (len(time) - 1)
    return DecayRecord(np.asarray(np.arange(len(values)) * step, dtype=np.float64), values, step, name, unit, notes)


def read_decay(path: Path, column: str | None = None, time: str | None = None) -> DecayRecord:
    """A decay record from a file of columns.

    Args:
        path: .csv, .mat or .parquet; a column may be headed ``name [unit]``.
        column: the signal; may be left out if the file holds one signal beside the time.
        time: the time; the column called ``time`` or ``t`` by default.

    Raises:
        RecordingError: no such file or column, or rows that cannot be used.
    """
    columns = read_columns(path)
    time_column = _time_column(columns, time)
    signal = _signal_column(columns, column, time_column)
    reader = Reader(columns)
    seconds, unit = 1.0, header(signal)[1] or columns.units.get(signal, "")
    stated = header(time_column)[1] or columns.units.get(time_column, "") or "s"
    try:
        seconds = factor(stated, "s")
    except ParameterError as error:
        raise error.at(Where(columns.file, path=time_column)) from None
    raw = {time_column: columns.number(time_column) * seconds, signal: columns.number(signal)}
    finite = np.isfinite(raw[signal])
    if not finite.any():
        raise RecordingError(f"column '{signal}' holds no number", Where(columns.file))
    if np.ptp(raw[signal][finite]) == 0:
        raise RecordingError(
            f"column '{signal}' is constant ({raw[signal][finite][0]:g})",
            Where(columns.file),
            "is it the right column?",
        )
    made = checked(
        Recording(path.stem, columns.file, raw[time_column], (), (Channel(signal, unit, raw[signal], signal),)),
        reader,
        True,
        raw,
        time_column,
    )
    record = decay_record(made.time, made.measurements[0].values, name=header(signal)[0], unit=unit, file=columns.file)
    return DecayRecord(record.time, record.values, record.step, record.name, record.unit, (*made.notes, *record.notes))


def _column(columns: Columns, wanted: str) -> str:
    """The column called so, with or without its unit."""
    found = [name for name in columns.names if wanted in (name, header(name)[0])]
    if not found:
        raise RecordingError(
            f"'{columns.file}' has no column '{wanted}'",
            None,
            nearest(wanted, [header(name)[0] for name in columns.names]),
        )
    return found[0]


def _time_column(columns: Columns, wanted: str | None) -> str:
    if wanted is not None:
        return _column(columns, wanted)
    for name in columns.names:
        if header(name)[0].lower() in ("time", "t"):
            return name
    raise RecordingError(
        f"'{columns.file}' has no column called 'time' or 't'",
        None,
        f"say which it is with --time; there are {', '.join(columns.names[:12])}",
    )


def _signal_column(columns: Columns, wanted: str | None, time_column: str) -> str:
    if wanted is not None:
        return _column(columns, wanted)
    others = [name for name in columns.names if name != time_column]
    if len(others) != 1:
        shown = ", ".join(others[:12]) or "no other column"
        raise RecordingError(
            f"'{columns.file}' holds {len(others)} signals", None, f"say which with --column; there are {shown}"
        )
    return others[0]


@dataclass(frozen=True)
class Line:
    """A straight line by least squares, y = intercept + slope x.

    Attributes:
        slope, intercept: of the line.
        standard_error: of the slope: from the residuals, or from known noise where that is larger.
        half_width: of the slope's 95 % interval: Student's t with n - 2 degrees of freedom on the residuals, or 1.96
            standard errors of known noise where that is larger.
    """

    slope: float
    intercept: float
    standard_error: float
    half_width: float


def line(x: Vector, y: Vector, covariance: Vector | None = None) -> Line:
    """The least-squares line through points.

    Args:
        x: shape (n,), n >= 2.
        y: shape (n,).
        covariance: of the noise in ``y``, shape (n, n), if known.
    """
    from scipy.stats import t as student

    n = len(x)
    centred = x - x.mean()
    weights = centred / (centred @ centred)
    slope = float(weights @ y)
    intercept = float(y.mean() - slope * x.mean())
    residual = y - intercept - slope * x
    from_residuals = math.sqrt(float(residual @ residual) / (n - 2) / float(centred @ centred)) if n > 2 else 0.0
    from_noise = math.sqrt(max(float(weights @ covariance @ weights), 0.0)) if covariance is not None else 0.0
    quantile = float(student.ppf(0.975, n - 2)) if n > 2 else 0.0
    return Line(
        slope,
        intercept,
        max(from_residuals, from_noise),
        max(quantile * from_residuals, 1.96 * from_noise),
    )


def sine_noise(values: Vector, step: float, frequencies: tuple[float, ...]) -> float:
    """Standard deviation of the white noise that would explain what lies between the lines of a spectrum.

    The median of |FFT|^2 over the second half of the record (Hann taper), up to four times the highest frequency and
    over at least 64 bins, divided by ln 2 (median of an exponential variable). Noise that is not white counts
    with its level there.

    Args:
        values: the record, its rest value removed.
        step: sampling interval (s).
        frequencies: of the lines (Hz).
    """
    tail = values[len(values) // 2 :]
    window = hann(len(tail))
    power = np.abs(np.fft.rfft(tail * window)) ** 2 / float(window @ window)
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


def hann(n: int) -> Vector:
    """The periodic Hann taper, shape (n,)."""
    return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n))


def dominant_frequency(values: Vector, step: float) -> float:
    """Frequency (Hz) of the strongest line; the record's beginning counts most (half a Hann taper)."""
    n = len(values)
    window = 0.5 + 0.5 * np.cos(np.pi * np.arange(n) / n)
    centred = values - float(window @ values) / float(window.sum())
    size = 1 << math.ceil(math.log2(8 * n))
    spectrum = np.abs(np.fft.rfft(centred * window, size))
    axis = np.fft.rfftfreq(size, step)
    allowed = axis >= 1 / (n * step)
    return float(axis[allowed][int(np.argmax(spectrum[allowed]))])
