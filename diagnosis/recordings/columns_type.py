"""Columns of numbers as every reader gives them, and the error of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, Where, nearest
from engine.readers.regular import shown
from engine.readers.text import Oddity

Vector = NDArray[np.float64]


class RecordingError(FlexarmError):
    """A recording cannot be used."""


@dataclass(frozen=True)
class Elsewhere:
    """A column of a file that does not belong to the rows of the others.

    Attributes:
        values: shape (other rows,).
        clock: the column that holds its time; empty if the file does not say.
        time: that column, shape (other rows,), in the file's time; None if the file does not say.
    """

    values: Vector
    clock: str
    time: Vector | None


@dataclass
class Columns:
    """The columns of a file.

    Attributes:
        file: the file's name, for messages.
        raw: column name -> numbers, shape (rows,); NaN where a cell holds none.
        rows: for each value the row (line) of the file that holds it, 1-based.
        row: what a row is called: ``line`` or ``row``.
        units: units that the file itself states, by column.
        odd: the first text of each column that holds texts; its numbers cannot be asked for.
        words: the first text of each column in which a few texts count as empty cells.
        notes: what was assumed in reading them, in sentences.
        others: columns of other lengths or clocks.
    """

    file: str
    raw: Mapping[str, Vector]
    rows: NDArray[np.int64]
    row: str = "row"
    units: dict[str, str] = field(default_factory=dict)
    odd: Mapping[str, Oddity] = field(default_factory=dict)
    words: Mapping[str, Oddity] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    others: Mapping[str, Elsewhere] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Column names in order."""
        return list(self.raw)

    def __len__(self) -> int:
        return len(self.rows)

    def number(self, name: str, where: Where | None = None) -> Vector:
        """A column as numbers; cells that hold none are NaN.

        Args:
            name: the column.
            where: the place in the scenario that asks for it.

        Raises:
            RecordingError: no such column, or a cell that is neither a number nor empty.
        """
        if name in self.others:
            other = self.others[name]
            its = f"belongs to the time '{shown(other.clock)}'" if other.clock else f"has {len(other.values)} rows"
            raise RecordingError(
                f"column '{shown(name)}' {its}, and the time of the recording has {len(self)} rows",
                where,
                "list the file under 'files:' once more, with the time of this column",
            )
        if name not in self.raw:
            raise RecordingError(
                f"'{self.file}' has no column '{shown(name)}'", where, nearest(name, map(shown, self.names))
            )
        if name in self.odd:
            raise self.no_number(name, self.odd[name])
        return self.raw[name]

    def no_number(self, name: str, odd: Oddity, further: str = "") -> RecordingError:
        """That a column holds a text, and what to do about it, with a further way out."""
        return RecordingError(
            f"column '{shown(name)}' holds {odd.what} in {self.row} {odd.row}, which is not a number",
            Where(self.file, odd.row),
            f"{odd.remedy}{further}",
        )
