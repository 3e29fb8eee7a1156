"""Recordings without a mapping: columns are matched by name and unit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from diagnosis.recordings.columns import RecordingError, read_columns
from diagnosis.recordings.mapping import Channel, Reader, Recording, checked
from engine.errors import ParameterError, Where
from engine.quantity import factor

_HEADER = re.compile(r"^(.*?)\s*\[([^\]]*)\]\s*$")


def header(text: str) -> tuple[str, str]:
    """Name and unit of a column headed ``name [unit]``; the unit is empty if there is none."""
    match = _HEADER.match(text)
    return (match.group(1).strip(), match.group(2).strip()) if match else (text.strip(), "")


def from_file(path: Path, inputs: dict[str, str], signals: dict[str, str]) -> Recording:
    """A file without a mapping, matched by column names (``link.hub.angle [rad]``) and units.

    Args:
        path: the file.
        inputs: what the model's inputs are called -> the input's name; several names may lead to one input.
        signals: the model's signals -> unit.

    Raises:
        RecordingError: no time column, or no column is called like a signal.
    """
    columns = read_columns(path)
    reader = Reader(columns)
    heads = {column: header(column) for column in columns.names}
    times = [column for column, (name, _) in heads.items() if name.lower() in ("time", "t")]
    if not times:
        raise RecordingError(
            f"'{path}' has no column called 'time' or 't'; it has {', '.join(columns.names[:12])}",
            Where(str(path)),
            "rename the column, or describe the file under 'recordings:' in the scenario",
        )
    seconds = factor(heads[times[0]][1] or columns.units.get(times[0]) or "s", "s")
    plain = {name.replace(".", "_"): name for name in signals}
    drives: list[Channel] = []
    measured: list[Channel] = []
    raw = {times[0]: columns.number(times[0]) * seconds}
    notes = [f"{times[0]} is the time"]
    for column, (head, stated) in heads.items():
        name = head if head in signals or head in inputs else plain.get(head, head)
        end = inputs.get(name)
        if column == times[0] or (end is None and name not in signals):
            if column != times[0]:
                notes.append(f"{column} is not used")
            continue
        stated = stated or columns.units.get(column, "")
        target = signals.get(name, stated or "1")
        if stated and target != "*":
            try:
                scale, unit = factor(stated, target), target
            except ParameterError as error:
                raise error.at(Where(str(path), 1, column)) from None
        else:
            scale, unit = 1.0, stated or target
        values = columns.number(column) * scale
        if end is not None and end not in [channel.name for channel in drives]:
            raw[column] = values
            drives.append(Channel(end, unit, values, column))
            notes.append(f"{column} drives {end}")
        elif end is None and len(np.unique(values[np.isfinite(values)])) > 1:
            measured.append(Channel(name, unit, values, column))
            notes.append(f"{column} is compared with {name}")
        else:
            notes.append(f"{column} is constant and not compared")
    if not measured:
        raise RecordingError(
            f"no column of '{path}' is called like a signal of the model; it has {', '.join(columns.names[:12])}",
            Where(str(path)),
            "name columns as 'link.hub.angle [rad]', or describe the file under 'recordings:' in the scenario",
        )
    recording = Recording(path.name, str(path), raw[times[0]], tuple(drives), tuple(measured), notes=tuple(notes))
    return checked(recording, reader, False, raw, times[0])
