"""The further files that a recording names: read, and their clocks set by that of the leading file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diagnosis.recordings.alignment import Alignment, align
from diagnosis.recordings.columns import RecordingError, Vector, read_columns
from diagnosis.recordings.joining import Clock
from diagnosis.recordings.paths import named_path
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.time_axis import time_axis
from engine.errors import nearest

if TYPE_CHECKING:
    from scenarios.load import Scenario
    from scenarios.schema import FurtherFile, TimeRecording

LIKE = 0.6
"""Correlation from which two columns show the same motion."""
AMBIGUOUS = 0.97
"""Share of the highest correlation that another offset may reach."""


def join_files(reader: Reader, name: str, described: TimeRecording, scenario: Scenario, time: Vector) -> None:
    """Give the reader the columns of further files, each with its clock.

    Args:
        reader: of the leading file.
        name: of the recording.
        described: the recording.
        scenario: describes it.
        time: of the leading file (s), shape (rows,).

    Raises:
        FlexarmError: a file that cannot be read, or an offset that cannot be found.
    """
    for number, further in enumerate(described.files):
        path = ("recordings", name, "files", number)
        where = scenario.where(*path, "file")
        columns = read_columns(
            named_path(scenario, name, further.file, where), where, further.time.column or "", further.format or ""
        )
        own = Reader(columns, scenario, path, list(columns.notes))
        clock = _clock(reader, own, further, time)
        reader.notes += [f"{further.file}: {note}" for note in own.notes]
        for column in columns.names:
            called = f"{further.name}.{column}" if further.name else column
            if called in reader.columns.raw or called in reader.further:
                reader.unsure[called] = (
                    "give the further file a name, such as 'name: camera', and write 'camera.column'"
                )
            reader.further[called] = (columns, column, clock)


def _clock(reader: Reader, own: Reader, further: FurtherFile, time: Vector) -> Clock:
    """The instants of a further file on the leading file's clock; what was found is noted."""
    axis, _ = time_axis(own, further.time)
    _check_increasing(own, axis)
    search = further.offset == "auto", further.rate == "auto"
    rate = 1.0 if search[1] else own.convert(further.rate, "1", "rate")
    if not rate > 0:
        raise RecordingError(f"a rate of {rate:g}", own.where("rate"), "give a number near 1")
    if not any(search):
        return Clock(own.convert(further.offset, "s", "offset") + rate * axis)
    if further.alike is None:
        raise RecordingError(
            f"what is to be found of the clock of '{further.file}' needs two columns that show the same motion",
            own.where("offset" if search[0] else "rate"),
            "add for example 'alike: {column: x, to: position}'",
        )
    signal = own.column(further.alike.column, "alike")
    if further.alike.to not in reader.columns.raw:
        raise RecordingError(
            f"the leading file has no column '{further.alike.to}'",
            own.where("alike", "to"),
            nearest(further.alike.to, reader.columns.names),
        )
    values = reader.columns.number(further.alike.to, own.where("alike", "to"))
    found = align(time, values, axis, signal, rate=None if search[1] else rate)
    pair = f"'{further.alike.column}' with '{further.alike.to}'"
    if found is None or abs(found.correlation) < LIKE:
        like = "not at all" if found is None else f"by {abs(found.correlation):.2f} at best"
        raise RecordingError(
            f"the clock of '{further.file}' cannot be found: {pair} agrees {like}",
            own.where("alike"),
            "name columns that show the same motion, or state the offset",
        )
    if not search[0]:
        found = Alignment(own.convert(further.offset, "s", "offset"), found.rate, found.correlation, found.rival)
    elif found.rival > AMBIGUOUS * abs(found.correlation):
        own.notes.append(
            f"another offset would do nearly as well ({found.rival:.4f} against {abs(found.correlation):.4f}): the "
            "motion repeats itself"
        )
    said = [f"its clock begins {found.offset:.6g} s after that of the leading file"] if search[0] else []
    said += [f"it runs at {found.rate:.7g} of the leading file's rate"] if search[1] else []
    own.notes.append(f"{' and '.join(said)}, found by {pair} (correlation {found.correlation:.3f})")
    return Clock(found.offset + found.rate * axis)


def _check_increasing(own: Reader, axis: Vector) -> None:
    there = np.isfinite(axis)
    wrong = np.flatnonzero(np.diff(axis[there]) < 0)
    if len(wrong):
        marked = np.zeros(len(axis), dtype=bool)
        marked[np.flatnonzero(there)[wrong[0] + 1]] = True
        raise RecordingError(
            f"time runs backwards in {own.rows(marked)}", own.first(marked), "sort the rows, or give each its own time"
        )
