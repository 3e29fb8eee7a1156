"""MATLAB files of version 7.3, and tables and timetables of every version, by mat-io."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas
from matio import load_from_mat

from diagnosis.recordings.loggers.found import Found
from diagnosis.recordings.loggers.structure import collect, seconds


def read(path: Path) -> Found:
    """Columns are called as those of older MATLAB files are; of a timetable ``run.Time``, ``run.torque``."""
    found = Found()
    for name, value in load_from_mat(str(path)).items():
        if not name.startswith("__"):
            collect(found, name, _plain(found, name, value, 0))
    return found


def _plain(found: Found, name: str, value: Any, depth: int) -> Any:
    """A value without tables: those are added at once, since their time is a clock."""
    if depth > 40:
        return {}
    if isinstance(value, pandas.DataFrame):
        _table(found, name, value)
        return {}
    if isinstance(value, np.ndarray) and value.dtype.names is not None and value.size == 1:
        cell = value.ravel()[0]
        return {key: _plain(found, f"{name}.{key}", cell[key], depth + 1) for key in value.dtype.names}
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        made = np.empty(value.size, dtype=object)
        for k, cell in enumerate(value.ravel()):
            made[k] = _plain(found, name if value.size == 1 else f"{name}{{{k + 1}}}", cell, depth + 1)
        return made
    return value if isinstance(value, np.ndarray | float | int) else {}


def _table(found: Found, name: str, table: pandas.DataFrame) -> None:
    clock = ""
    if isinstance(table.index, pandas.TimedeltaIndex | pandas.DatetimeIndex):
        clock = f"{name}.{table.index.name or 'Time'}"
        found.add(clock, seconds(table.index.to_numpy()), clock, "s")
        if isinstance(table.index, pandas.DatetimeIndex):
            found.notes.append(f"'{clock[:60]}' holds instants: seconds from the first")
    for key in table.columns:
        values = table[key].to_numpy()
        if values.dtype.kind == "O" and len(values) and all(np.size(v) == np.size(values[0]) for v in values):
            try:
                values = np.array([np.ravel(v).astype(float) for v in values])
            except (TypeError, ValueError):
                continue
        collect(found, f"{name}.{key}", values, clock=clock)
