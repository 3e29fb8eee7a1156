"""Recordings without a description: columns are matched to signals by their header, ``name [unit]``."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from diagnosis.recordings.checks import checked
from diagnosis.recordings.columns import Columns, RecordingError, Vector, read_columns
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.types import Channel, Recording
from engine.errors import ParameterError, Where
from engine.quantity import factor

_HEADER = re.compile(r"^(.*?)\s*\[([^\]]*)\]\s*$")


def header(text: str) -> tuple[str, str]:
    """Name and unit of a column headed ``name [unit]``; the unit is empty if there is none."""
    match = _HEADER.match(text)
    return (match.group(1).strip(), match.group(2).strip()) if match else (text.strip(), "")


def from_file(path: Path, inputs: dict[str, str], signals: dict[str, str]) -> Recording:
    """A file without a description, matched by column names (``link.hub.angle [rad]``) and units.

    Args:
        path: the file.
        inputs: name of a column -> the model's input that it drives; several names may lead to one input.
        signals: the model's signals -> unit.

    Raises:
        RecordingError: no time column, or no column that has a signal's name.
    """
    columns = read_columns(path)
    heads = {column: header(column) for column in columns.names}
    time_column = _time_column(columns, heads)
    seconds = factor(heads[time_column][1] or columns.units.get(time_column) or "s", "s")
    required = {time_column: columns.number(time_column) * seconds}
    # A MATLAB variable holds no dots: 'link_hub_angle' stands for 'link.hub.angle'.
    without_dots = {name.replace(".", "_"): name for name in signals}
    drive: list[Channel] = []
    measurements: list[Channel] = []
    notes = [f"{time_column} is the time"]
    for column, (head, stated) in heads.items():
        if column == time_column:
            continue
        name = head if head in signals or head in inputs else without_dots.get(head, head)
        end = inputs.get(name)
        if end is None and name not in signals:
            notes.append(f"{column} is not used")
            continue
        values, unit = _in_unit(columns, column, stated or columns.units.get(column, ""), signals.get(name, ""))
        if end is not None and end not in [channel.name for channel in drive]:
            required[column] = values
            drive.append(Channel(end, unit, values, column))
            notes.append(f"{column} drives {end}")
        elif end is None and len(np.unique(values[np.isfinite(values)])) > 1:
            measurements.append(Channel(name, unit, values, column))
            notes.append(f"{column} is compared with {name}")
        else:
            notes.append(f"{column} is constant and not compared")
    if not measurements:
        raise RecordingError(
            f"no column of '{path}' has the name of a signal of the model; it has {', '.join(columns.names[:12])}",
            Where(str(path)),
            "name columns as 'link.hub.angle [rad]', or describe the file under 'recordings:' in the scenario",
        )
    recording = Recording(
        path.name, str(path), required[time_column], tuple(drive), tuple(measurements), notes=tuple(notes)
    )
    return checked(recording, Reader(columns, notes=list(columns.notes)), required, time_column)


def _time_column(columns: Columns, heads: dict[str, tuple[str, str]]) -> str:
    found = next((column for column, (name, _) in heads.items() if name.lower() in ("time", "t")), None)
    if found is None:
        raise RecordingError(
            f"'{columns.file}' has no column called 'time' or 't'; it has {', '.join(columns.names[:12])}",
            Where(columns.file),
            "rename the column, or describe the file under 'recordings:' in the scenario",
        )
    return found


def _in_unit(columns: Columns, column: str, stated: str, expected: str) -> tuple[Vector, str]:
    """A column in the unit of its signal; in its own if the signal has none, or takes any (``*``)."""
    target = expected or stated or "1"
    if not stated or target == "*":
        return columns.number(column), stated or target
    try:
        return columns.number(column) * factor(stated, target), target
    except ParameterError as error:
        raise error.at(Where(columns.file, 1, column)) from None
