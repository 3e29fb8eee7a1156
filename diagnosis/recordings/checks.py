"""Checks of a recording: finite numbers, increasing time, plausible sizes, and no constant measurement."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import RecordingError, Vector
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.time_axis import even_time
from diagnosis.recordings.types import Channel, Recorded, Recording
from engine.errors import Where
from engine.simulate import SHORTEST

LARGEST = 1e100
"""Largest accepted value, whose square can still be summed; a range below its inverse counts as constant."""


def checked(
    recording: Recording,
    reader: Reader,
    required: Mapping[str, Vector],
    time_column: str,
    *,
    skip_gaps: bool = False,
    within: NDArray[np.bool_] | None = None,
) -> Recording:
    """The recording with usable rows only, and time counted from its first row.

    Args:
        recording: as read, one value per row of the file.
        reader: of the file.
        required: columns that must hold a number in every row; other measurements may hold gaps, which stay as NaN.
        time_column: name of the time, for messages.
        skip_gaps: leave out rows with gaps in ``required``, instead of refusing them.
        within: rows to use, shape (rows,); all if None.

    Raises:
        RecordingError: gaps, fewer than two rows, time that does not increase, values beyond `LARGEST`, or a
            measurement without a change.
    """
    within = np.ones(len(reader.columns), dtype=bool) if within is None else within
    keep = within & ~_gaps(reader, required, skip_gaps, within)
    time = recording.time[keep]
    _check_time(time, reader, time_column, reader.columns.rows[keep])
    for channel in (*recording.drive, *recording.measurements, *recording.spare):
        large = (np.abs(channel.values) > LARGEST) & np.isfinite(channel.values) & keep
        if large.any():
            raise RecordingError(
                f"column '{channel.column}' holds more than {LARGEST:g} {channel.unit} in {reader.rows(large)}",
                reader.first(large),
                "is the unit right?",
            )
    measurements = tuple(_measurement(channel, reader, keep) for channel in recording.measurements)
    spare = tuple(_measurement(channel, reader, keep) for channel in recording.spare)
    if time[0] != 0:
        reader.notes.append(f"time begins at {time[0]:g} s in the file and is counted from there")
    stamps = time - time[0]
    time, time_notes = even_time(stamps, evenly=recording.clock == "even")
    return replace(
        recording,
        time=time,
        stamps=stamps,
        drive=tuple(_from_first(replace(channel, values=channel.values[keep])) for channel in recording.drive),
        measurements=tuple(_from_first(channel) for channel in measurements),
        spare=tuple(_from_first(channel) for channel in spare),
        notes=(*recording.notes, *reader.notes, *reader.wraps, *time_notes),
        wraps=dict(reader.wraps),
    )


def _gaps(reader: Reader, required: Mapping[str, Vector], skip: bool, within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows in which a required column holds no number, shape (rows,)."""
    bad = np.zeros(len(reader.columns), dtype=bool)
    for column, values in required.items():
        gaps = ~np.isfinite(values) & within
        if gaps.any() and not skip:
            word = reader.columns.words.get(column)
            if word is not None and word.row in reader.columns.rows[gaps]:
                raise reader.columns.no_number(column, word, "; 'gaps: skip' in the recording leaves such rows out")
            raise RecordingError(
                f"column '{column}' holds no finite number in {reader.rows(gaps)}",
                reader.first(gaps),
                "repair the rows, or write 'gaps: skip' in the recording to leave them out",
            )
        bad |= gaps
    if bad.any():
        reader.notes.append(f"{int(bad.sum())} of {len(bad)} rows hold no number and are left out: {reader.rows(bad)}")
    return bad


def _check_time(time: Vector, reader: Reader, column: str, rows: NDArray[np.int64]) -> None:
    """Refuse a time that is too short, does not increase, or has intervals that cannot be simulated."""
    if len(time) < 2:
        raise RecordingError(
            f"{len(time)} usable row{'s' if len(time) != 1 else ''}; a recording needs at least two",
            Where(reader.columns.file),
            "is the file cut off, or are all other rows gaps?",
        )
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if len(wrong):
        i = int(wrong[0]) + 1
        what = "runs backwards" if time[i] < time[i - 1] else "stands still"
        raise RecordingError(
            f"time {what} in column '{column}', {reader.columns.row} {rows[i]}: {time[i]:g} s after {time[i - 1]:g} s",
            Where(reader.columns.file, int(rows[i])),
            "sort the rows, or give each sample its own time",
        )
    interval = (time[-1] - time[0]) / (len(time) - 1)
    if not SHORTEST <= interval < math.inf:
        raise RecordingError(
            f"samples are {interval:.3g} s apart in column '{column}'",
            Where(reader.columns.file),
            f"intervals of at least {SHORTEST:g} s can be simulated; is the unit of the time right?",
        )


def check_moving(rows: Sequence[Recorded]) -> None:
    """Refuse measurements that are constant in every recording; in some, friction or a brake may hold the machine.

    Raises:
        RecordingError: there is such a measurement.
    """
    moving, still = set[str](), dict[str, tuple[Recording, Channel]]()
    for recording in [r for r in rows if isinstance(r, Recording)]:
        for channel in recording.measurements:
            if np.nanmax(channel.values) - np.nanmin(channel.values) > 1 / LARGEST:
                moving.add(channel.name)
            else:
                still.setdefault(channel.name, (recording, channel))
    for name, (recording, channel) in still.items():
        if name not in moving:
            known = channel.values[np.isfinite(channel.values)]
            raise RecordingError(
                f"column '{channel.column}' is constant ({known[0]:g} {channel.unit} in all {len(known)} rows), "
                "so there is nothing to compare",
                Where(recording.file),
                f"leave '{name}' out of the measurements, or add a recording in which it moves",
            )


def _measurement(channel: Channel, reader: Reader, keep: NDArray[np.bool_]) -> Channel:
    """The kept rows of a measurement, NaN where it holds no number; gaps are noted."""
    values = channel.values[keep]
    gaps = ~np.isfinite(values)
    finite = values[~gaps]
    if not finite.size:
        raise RecordingError(
            f"column '{channel.column}' holds no number",
            Where(reader.columns.file),
            f"leave '{channel.name}' out of the measurements",
        )
    if np.ptp(finite) <= 1 / LARGEST:
        reader.notes.append(
            f"column '{channel.column}' is constant ({finite[0]:g} {channel.unit} in all {len(finite)} rows): "
            "was the machine held still, or is it another column?"
        )
    if gaps.any():
        marked = np.zeros(len(keep), dtype=bool)
        marked[np.flatnonzero(keep)[gaps]] = True
        reader.notes.append(
            f"column '{channel.column}' holds no number in {int(gaps.sum())} of {len(gaps)} rows, "
            f"where it is not compared: {reader.rows(marked)}"
        )
        values = np.where(gaps, np.nan, values)
        if channel.from_first and gaps[0]:
            raise RecordingError(
                f"column '{channel.column}' counts from its first sample, which holds no number",
                reader.first(marked),
                "leave the first rows out with 'window:', or write 'zero: none'",
            )
    return replace(channel, values=values)


def _from_first(channel: Channel) -> Channel:
    """The channel less its first sample, if it counts from there."""
    return replace(channel, values=channel.values - channel.values[0]) if channel.from_first else channel
