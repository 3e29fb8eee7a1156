"""MDF, versions 2 to 4, by asammdf."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from diagnosis.recordings.loggers.found import Found
from diagnosis.recordings.loggers.structure import collect


def read(path: Path) -> Found:
    """Columns are called as their channels; ``group.channel`` where two groups have one of that name.

    The time of a group is ``time`` if it is the only one, else ``group.time``; groups are called by their
    acquisition, or ``group1``, ``group2``.
    """
    found = Found()
    with MDF(str(path)) as file:
        groups: list[Any] = list(file.groups)
        channels = [
            [(i, channel.name) for i, channel in enumerate(group.channels) if i != file.masters_db.get(k)]
            for k, group in enumerate(groups)
        ]
        times = Counter(name for group in channels for _, name in group)
        titles = [
            str(getattr(group.channel_group, "acq_name", "") or f"group{k + 1}") for k, group in enumerate(groups)
        ]
        titles = [title if titles.count(title) == 1 else f"group{k + 1}" for k, title in enumerate(titles)]
        for k, group in enumerate(channels):
            clock = ""
            for i, name in group:
                signal = file.get(group=k, index=i, ignore_invalidation_bits=True)
                values = np.asarray(signal.samples)
                if values.dtype.kind not in "fiub" or not len(values) or values.ndim > 2:
                    continue
                if signal.invalidation_bits is not None and values.dtype.kind in "fiub":
                    values = values.astype(float)
                    values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
                if not clock and len(signal.timestamps) == len(values):
                    clock = "time" if len(channels) == 1 else f"{titles[k]}.time"
                    found.add(clock, np.asarray(signal.timestamps), clock, "s")
                called = name if times[name] == 1 else f"{titles[k]}.{name}"
                collect(found, called, values, clock=clock, unit=str(signal.unit or "")[:40])
    return found
