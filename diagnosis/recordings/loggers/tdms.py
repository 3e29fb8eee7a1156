"""TDMS of National Instruments, by npTDMS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from diagnosis.recordings.loggers.found import Found


def read(path: Path) -> Found:
    """Columns are called ``group.channel``; the time of a waveform is ``group.time``, or ``group.channel.time``."""
    found = Found()
    file = TdmsFile.read(str(path))
    starts = [
        channel.properties["wf_start_time"]
        for group in file.groups()
        for channel in group.channels()
        if _is_instant(channel.properties.get("wf_start_time"))
    ]
    first = min(starts, default=None)
    for group in file.groups():
        axes: dict[tuple[int, float, float], str] = {}
        for channel in group.channels():
            name = f"{group.name}.{channel.name}"
            values = np.asarray(channel[:])
            if values.dtype.kind == "M":
                values = (values - values[0]) / np.timedelta64(1, "s") if len(values) else values.astype(float)
                found.notes.append(f"'{name[:60]}' holds instants: seconds from the first")
            if values.dtype.kind not in "fiub" or not len(values):
                continue
            unit = channel.properties.get("unit_string", "")
            found.add(name, values, _clock(found, channel, group.name, first, axes), unit if _short(unit) else "")
    return found


def _clock(found: Found, channel: Any, group: str, first: Any, axes: dict[tuple[int, float, float], str]) -> str:
    """The column with the time of a waveform, which is made here; empty for a channel that is none."""
    try:
        step = float(channel.properties.get("wf_increment", 0.0))
        begin = float(channel.properties.get("wf_start_offset", 0.0))
    except (TypeError, ValueError):
        return ""
    if not step > 0 or not np.isfinite(step + begin):
        return ""
    start = channel.properties.get("wf_start_time")
    if first is not None and _is_instant(start):
        begin += float((start - first) / np.timedelta64(1, "s"))
    axis = (len(channel), begin, step)
    if axis not in axes:
        axes[axis] = name = f"{group}.time" if not axes else f"{group}.{channel.name}.time"
        found.add(name, begin + step * np.arange(len(channel)), name, "s")
        found.notes.append(f"'{name[:60]}' is made of the start and the increment of the waveform")
    return axes[axis]


def _is_instant(value: Any) -> bool:
    return isinstance(value, np.datetime64) and not np.isnat(value)


def _short(unit: Any) -> bool:
    return isinstance(unit, str) and len(unit) < 40
