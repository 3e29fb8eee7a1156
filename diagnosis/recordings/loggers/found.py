"""What a reader of a foreign format found in a file: columns of numbers, each with the clock it belongs to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MOST_CELLS = 200_000_000
"""Numbers that are taken from one file."""
MOST_COLUMNS = 20_000
WIDEST = 64
"""Entries of an array at one instant that become columns; more are a picture or a point cloud, and left out."""


class Unreadable(Exception):
    """A file cannot be read; its text repeats nothing of the file but names of columns.

    Attributes:
        message, remedy: for the user.
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.message, self.remedy = message, remedy


@dataclass
class Found:
    """The columns of a file, of any lengths.

    Attributes:
        columns: name -> numbers, shape (rows,).
        clocks: name -> the column that holds its time, where the format says so.
        units: name -> unit, where the format says so.
        odd: name -> first row (1-based), what it holds instead of a number, and what to do about it.
        notes: what was assumed or left out, in sentences.
        rows: number of the first row in the file.
    """

    columns: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    clocks: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    odd: dict[str, tuple[int, str, str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    rows: int = 1

    def add(self, name: str, values: NDArray[np.generic], clock: str = "", unit: str = "") -> None:
        """Add a column.

        Raises:
            Unreadable: its name is there already, or the file holds too much.
        """
        if name in self.columns:
            raise Unreadable(f"it holds two columns called '{name[:60]}'", "rename one of them")
        if len(self.columns) >= MOST_COLUMNS or sum(map(len, self.columns.values())) + len(values) > MOST_CELLS:
            raise Unreadable("it holds more numbers than are read", "save a part of it")
        self.columns[name] = np.asarray(values, dtype=np.float64)
        if clock:
            self.clocks[name] = clock
        if unit:
            self.units[name] = unit
