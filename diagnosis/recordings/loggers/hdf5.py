"""HDF5: every dataset of numbers, by its path; nothing outside the file is followed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from diagnosis.recordings.loggers.found import MOST_CELLS, MOST_COLUMNS, Found, Unreadable
from diagnosis.recordings.loggers.structure import DEEPEST, collect

_UNITS = ("units", "unit", "Unit", "Units")
_TIMES = ("time", "t", "timestamp", "timestamps")


def read(path: Path) -> Found:
    """Columns are called by the path of their dataset, with dots: ``run1.encoder``, ``run1.force[2]``.

    A dataset called time or t is the clock of the others in its group that are as long.

    Raises:
        Unreadable: it cannot be read.
    """
    if not h5py.is_hdf5(path):
        raise Unreadable("it is no HDF5 file", "save it anew")
    found = Found()
    with h5py.File(path, "r") as file:
        _group(found, file, "", 0)
    return found


def _group(found: Found, group: Any, prefix: str, depth: int) -> None:
    if depth > DEEPEST:
        raise Unreadable(f"groups are nested more than {DEEPEST} levels deep")
    if len(group) > MOST_COLUMNS:
        raise Unreadable("a group holds more members than are read", "save a part of it")
    sizes: dict[str, int] = {}
    for key in group:
        name = f"{prefix}.{key}" if prefix else key
        # A soft or external link could lead to another place or file.
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            found.notes.append(f"'{name[:60]}' is a link, and left out")
            continue
        member = group[key]
        if isinstance(member, h5py.Group):
            _group(found, member, name, depth + 1)
        elif isinstance(member, h5py.Dataset) and member.shape is not None and len(member.shape) <= 3:
            before = set(found.columns)
            _dataset(found, member, name)
            sizes |= {column: len(found.columns[column]) for column in set(found.columns) - before}
    times = [column for column in sizes if column.rpartition(".")[2].lower() in _TIMES]
    if len(times) == 1:
        same = [c for c, n in sizes.items() if n == sizes[times[0]]]
        found.clocks |= dict.fromkeys(same, times[0])


def _dataset(found: Found, member: Any, name: str) -> None:
    if member.external or member.is_virtual:
        found.notes.append(f"'{name[:60]}' lies in another file, and is left out")
        return
    if member.size > MOST_CELLS:
        raise Unreadable(f"'{name[:60]}' holds more numbers than are read", "save a part of it")
    kinds = member.dtype.fields.values() if member.dtype.names else [(member.dtype,)]
    if any(kind[0].base.kind not in "fiub" for kind in kinds):
        return
    unit = ""
    for key in _UNITS:
        if key in member.attrs:
            stated = member.attrs[key]
            unit = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else stated
    collect(found, name, np.asarray(member[()]), unit=unit if isinstance(unit, str) and len(unit) < 40 else "")
