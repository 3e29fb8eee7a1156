"""The time axis of a recording: from a column or an interval, cut to a window, and even if only jitter disturbs it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import RecordingError, Vector
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.types import Recording
from engine.errors import ParameterError, Where
from engine.quantity import factor

if TYPE_CHECKING:
    from scenarios.schema import TimeColumn, TimeRecording

JITTER = 1e-3
"""Deviation of a sampling instant from an even axis, as a fraction of the interval, up to which the axis is even."""

STRAYS = 0.5
"""The same, from which stamps are not taken for those of an even clock: one could be its neighbour's."""

ROUNDING = 1e-6
"""The same, up to which the recorded instants are kept as they are."""

USUAL_STEPS = {"s": (2e-5, 0.5), "ms": (0.5, 200.0), "us": (200.0, 2e6), "ns": (2e6, 2e9)}
"""Usual sampling intervals of a log, as numbers in each unit; the first that fits is taken."""


def time_axis(reader: Reader, given: TimeColumn) -> tuple[Vector, str]:
    """Time in seconds, shape (rows,), and the name of its column.

    Args:
        reader: of the file.
        given: how the file tells the time.

    Raises:
        FlexarmError: neither a column nor an interval, both, or one that cannot be used.
    """
    if (given.column is None) == (given.interval is None):
        raise RecordingError(
            "the time needs either a column or an interval", reader.where("time"), "give one of them, such as column: t"
        )
    if given.column is None:
        interval = reader.convert(given.interval, "s", "time", "interval")
        if not interval > 0:
            raise RecordingError(f"the interval is {interval:g} s", reader.where("time"), "give a time above zero")
        reader.notes.append(f"samples are taken to be {interval:g} s apart; the file does not say")
        return np.asarray(interval * np.arange(len(reader.columns)), dtype=float), "time"
    try:
        seconds = factor(given.unit, "s")
    except ParameterError as error:
        raise error.at(reader.where("time", "unit") or Where(reader.columns.file)) from None
    reader.seconds = seconds
    time = reader.column(given.column, "time") * seconds
    if "unit" not in given.model_fields_set and (meant := _unit_of_steps(time)) not in ("", "s"):
        reader.notes.append(
            f"the time is taken to be in s, for no unit is stated: samples are {_step(time):g} s apart, a step that is "
            f"usual in {meant}; if it is in {meant}, write unit: {meant} under time:"
        )
    return time, given.column


def _step(time: Vector) -> float:
    steps = np.diff(time[np.isfinite(time)])
    return float(np.median(steps)) if len(steps) else 0.0


def _unit_of_steps(time: Vector) -> str:
    """The unit in which a log usually has such steps; empty if there is none."""
    return next((unit for unit, (low, high) in USUAL_STEPS.items() if low <= _step(time) <= high), "")


def window(reader: Reader, described: TimeRecording, time: Vector) -> NDArray[np.bool_]:
    """Rows within the window of the description, shape (rows,).

    Raises:
        RecordingError: there is none.
    """
    if described.window is None:
        return np.ones(len(time), dtype=bool)
    first, last = (reader.convert(value, "s", "window") for value in described.window)
    keep = np.asarray((time >= first) & (time <= last))
    if not keep.any():
        finite = time[np.isfinite(time)]
        span = f"{finite.min():g} s to {finite.max():g} s" if finite.size else "no time at all"
        raise RecordingError(
            f"no row lies within the window from {first:g} s to {last:g} s",
            reader.where("window"),
            f"the recording holds {span}",
        )
    reader.notes.append(f"{int(keep.sum())} of {len(time)} rows lie within the window from {first:g} s to {last:g} s")
    return keep


def even_instants(time: Vector) -> Vector | None:
    """Instants of the even clock about which stamps stray, shape (samples,), or None if they follow none.

    Stamps that stray by half an interval or more could be those of neighbours.

    Args:
        time: stamps in seconds from the first, strictly increasing, shape (samples,).
    """
    interval, ticks, strays = _clock(time)
    return np.asarray(interval * ticks) if JITTER * interval < strays < STRAYS * interval else None


def _clock(time: Vector) -> tuple[float, Vector, float]:
    """Interval (s) of the even clock that suits stamps best, its ticks at the samples, and how far (s) a stamp strays.

    A sample that is missing leaves a gap. Of the intervals that the stamps allow, the one with the fewest digits is
    taken: clocks are set to such, and samples then share their instants with rows of a simulation.
    """
    usual = float(np.median(np.diff(time)))
    ticks = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(time) / usual), 1.0))])
    interval, first = np.polyfit(ticks, time, 1)
    strays = float(np.abs(time - first - interval * ticks).max())
    close = 12 * strays / len(time) ** 1.5  # three standard deviations of the slope, or more
    round_ones = (round(interval, digits) for digits in range(12) if abs(round(interval, digits) - interval) < close)
    return next(round_ones, float(interval)), ticks, strays


def even_time(time: Vector, *, evenly: bool = False) -> tuple[Vector, tuple[str, ...]]:
    """The time axis, made even if only jitter disturbs it, and a note on jitter, gaps or an uneven axis.

    Args:
        time: seconds from the first sample, strictly increasing, shape (samples,).
        evenly: take stamps that stray about an even clock for late readings of it.
    """
    instants = even_instants(time) if evenly else None
    if instants is not None:
        return instants, (f"samples are taken to be {instants[1]:g} s apart; the stamps stray about that",)
    intervals = len(time) - 1
    mean = float(time[-1]) / intervals
    jitter = float(np.abs(time - mean * np.arange(intervals + 1)).max())
    if jitter <= ROUNDING * mean:
        return time, ()
    interval, ticks, strays = _clock(time)
    if strays <= JITTER * interval and ticks[-1] == intervals:
        note = f"samples jitter by up to {strays:.2g} s and are taken to be {interval:g} s apart"
        return np.asarray(interval * ticks), (note,)
    steps = np.diff(time)
    usual = float(np.median(steps))
    wide = np.flatnonzero(steps > 1.5 * usual)
    if len(wide) and np.ptp(np.delete(steps, wide)) < 0.01 * usual:
        return time, (
            f"{len(wide)} gap{'s' if len(wide) > 1 else ''} in time, the longest of {steps.max():g} s at "
            f"{time[int(np.argmax(steps))]:g} s; the model is simulated through {'them' if len(wide) > 1 else 'it'}",
        )
    return time, (
        f"the time axis is uneven, with intervals from {steps.min():g} s to {steps.max():g} s; the model is simulated "
        "at the recorded instants",
    )


def with_lead_in(recording: Recording, periods: int) -> Recording:
    """The recording after ``periods`` repetitions of its drive, during which nothing is measured.

    Args:
        recording: one whole period of a periodic signal.
        periods: number of repetitions.

    Raises:
        RecordingError: the recording has no drive, or its samples are not evenly spaced.
    """
    if not periods:
        return recording
    time = recording.time
    interval = float(time[-1]) / (len(time) - 1)
    if not recording.drive or np.abs(time - interval * np.arange(len(time))).max() > JITTER * interval:
        raise RecordingError(
            f"recording '{recording.name}' cannot have a lead-in, which needs a drive and evenly spaced samples",
            remedy="leave 'lead_in' out, and let the starting values be free",
        )
    silent = np.full(periods * len(time), np.nan)
    return replace(
        recording,
        time=np.asarray(interval * np.arange((periods + 1) * len(time)), dtype=float),
        drive=tuple(replace(c, values=np.tile(c.values, periods + 1)) for c in recording.drive),
        measurements=tuple(replace(c, values=np.concatenate([silent, c.values])) for c in recording.measurements),
        spare=tuple(replace(c, values=np.concatenate([silent, c.values])) for c in recording.spare),
        notes=(*recording.notes, f"{periods} period{'s' if periods > 1 else ''} of the drive lead in"),
    )
