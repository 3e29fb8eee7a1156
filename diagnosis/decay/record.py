"""Decay records: free vibration on an even time axis, from arrays or files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagnosis.recordings.by_header import header
from diagnosis.recordings.checks import checked
from diagnosis.recordings.columns import Columns, RecordingError, Vector, read_columns
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.types import Channel, Recording
from engine.errors import ParameterError, Where, nearest
from engine.quantity import factor

LEAST_SAMPLES = 16
"""Smallest number of samples in a record."""

SMALLEST_FALL = 5e-3
"""Fall of the logarithm of the amplitude over the whole record, below which there is no decay."""

LONGEST_GAP = 2.5
"""Longest interval between samples, in units of the median one."""

UNEVEN = 0.01
"""Range of the intervals, relative to the median one, above which the record is interpolated."""


class DampingWarning(UserWarning):
    """An estimate that the record or the settings make doubtful."""


@dataclass(frozen=True)
class DecayRecord:
    """A signal on an even time axis.

    Attributes:
        time: s, from 0, shape (samples,).
        values: shape (samples,).
        step: sampling interval (s).
        name, unit: of the signal; the unit is empty if the file does not say.
        notes: sentences that say how the data were changed.
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
        """The sample at a time (s) at which an estimate begins.

        Raises:
            ParameterError: the time lies outside the record, or leaves too few samples.
            RecordingError: the signal is constant from there on.
        """
        if not (math.isfinite(start) and start >= 0 and len(self.values) - start / self.step >= LEAST_SAMPLES):
            raise ParameterError(
                f"start {start:g} s lies outside the record, which lasts {self.length:.4g} s",
                remedy=f"begin at 0 s or later, and at least {LEAST_SAMPLES} samples before its end",
            )
        found = round(start / self.step)
        if np.ptp(self.values[found:]) == 0:
            raise RecordingError(f"'{self.name}' is constant from {start:g} s on", remedy="begin earlier")
        return found


def decay_record(time: Vector, values: Vector, *, name: str = "signal", unit: str = "", file: str = "") -> DecayRecord:
    """A record from arrays; time is counted from the first sample, and an uneven axis is interpolated.

    Args:
        time: s, strictly increasing, shape (samples,).
        values: shape (samples,).
        name: of the signal.
        unit: of the signal; empty if not known.
        file: where the arrays came from, for messages.

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
        raise RecordingError(f"time does not increase after {time[i]:g} s", where, "sort the rows")
    if np.ptp(values) == 0:
        raise RecordingError(
            f"'{name}' is constant ({values[0]:g} in all {len(values)} samples)", where, "is it the right column?"
        )
    if not 1e-100 < np.ptp(values) < 1e100 or np.abs(values).max() > 1e100:
        raise RecordingError(
            f"'{name}' goes from {values.min():.3g} to {values.max():.3g}",
            where,
            "choose another unit",
        )
    step = float(np.median(steps))
    notes: tuple[str, ...] = ()
    if steps.max() > LONGEST_GAP * step:
        i = int(np.argmax(steps))
        raise RecordingError(
            f"'{name}' has a gap of {steps[i]:g} s at {time[i]:g} s, where samples are {step:g} s apart",
            where,
            "cut the record at the gap",
        )
    if np.ptp(steps) > UNEVEN * step:
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
        column: name of the signal; None if the file holds only one.
        time: name of the time; None for ``time`` or ``t``.

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
        raw,
        time_column,
        skip_gaps=True,
    )
    record = decay_record(made.time, made.measurements[0].values, name=header(signal)[0], unit=unit, file=columns.file)
    return DecayRecord(record.time, record.values, record.step, record.name, record.unit, (*made.notes, *record.notes))


def _column(columns: Columns, wanted: str) -> str:
    """The column of that name, with or without its unit."""
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
        f"name it with --time; there are {', '.join(columns.names[:12])}",
    )


def _signal_column(columns: Columns, wanted: str | None, time_column: str) -> str:
    if wanted is not None:
        return _column(columns, wanted)
    others = [name for name in columns.names if name != time_column]
    if len(others) != 1:
        shown = ", ".join(others[:12]) or "no other column"
        raise RecordingError(
            f"'{columns.file}' holds {len(others)} signals", None, f"name one with --column; there are {shown}"
        )
    return others[0]
