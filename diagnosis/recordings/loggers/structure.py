"""Columns out of nested structures of arrays: time runs along the longer side, and names are paths."""

from __future__ import annotations

from typing import Any

import numpy as np

from diagnosis.recordings.loggers.found import WIDEST, Found, Unreadable

DEEPEST = 40
"""Levels of structures that are searched for columns."""


def collect(found: Found, name: str, value: Any, *, clock: str = "", unit: str = "", depth: int = 0) -> None:
    """Add every column of numbers in a value under its path.

    Args:
        found: takes the columns.
        name: path of the value.
        value: dictionaries, arrays, structured arrays and arrays of objects.
        clock: column that holds the time of what is found.
        unit: of the numbers.
        depth: levels above.

    Raises:
        Unreadable: nested too deeply, or two columns of one name.
    """
    if depth > DEEPEST:
        raise Unreadable(f"structures are nested more than {DEEPEST} levels deep")
    if isinstance(value, dict):
        for key, inner in value.items():
            path = f"{name}.{key}" if name else str(key)
            collect(found, path, inner, clock=clock, unit=unit, depth=depth + 1)
        return
    array = np.asarray(value)
    if array.dtype.names is not None:
        for field in array.dtype.names:
            inner = array[field]
            if inner.dtype.kind == "O" and inner.size == 1:
                inner = inner.ravel()[0]
            collect(found, f"{name}.{field}", inner, clock=clock, unit=unit, depth=depth + 1)
        return
    if array.dtype.kind == "O":
        cells = array.ravel()
        for k, cell in enumerate(cells[: 10 * WIDEST]):
            inner_name = name if len(cells) == 1 else f"{name}{{{k + 1}}}"
            if isinstance(cell, np.ndarray | dict):
                collect(found, inner_name, cell, clock=clock, unit=unit, depth=depth + 1)
        return
    if array.dtype.kind in "mM":
        array = seconds(array)
    if array.dtype.kind not in "fiub" or not array.size:
        return
    array = np.squeeze(array) if array.ndim > 1 else array
    if array.ndim <= 1:
        found.add(name, np.atleast_1d(array), clock, unit)
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        for k in range(array.shape[1]):
            found.add(f"{name}[{k + 1}]", array[:, k], clock, unit)


def seconds(times: Any) -> np.ndarray[Any, Any]:
    """Instants or durations as seconds: a duration's own, an instant's from the first."""
    array = np.asarray(times)
    if array.dtype.kind == "M":
        valid = array[~np.isnat(array)]
        array = array - (valid[0] if len(valid) else np.datetime64(0, "s"))
    made = array / np.timedelta64(1, "s")
    return np.asarray(made, dtype=float)
