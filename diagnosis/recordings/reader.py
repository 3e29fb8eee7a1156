"""A file of columns read as the scenario describes it: numbers in SI units, and errors with their place."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import Columns, RecordingError, Vector
from diagnosis.recordings.joining import Clock
from engine.errors import ParameterError, Where, nearest
from engine.quantity import coherent, convert, split

if TYPE_CHECKING:
    from scenarios.load import Scenario


@dataclass
class Reader:
    """A file, and the place of its description in the scenario.

    Attributes:
        columns: of the file.
        scenario: describes the file; None if nothing does.
        path: keys of the description in the scenario.
        notes: sentences that say how the data were changed.
        wraps: sentences on columns that seem to begin anew at the end of a range -> whether anything is fitted to them.
        further: columns of further files by the names that they are called by, each with its file and its clock.
        unsure: names that several files have.
        axis: time of the rows (s), shape (rows,); needed to join further columns.
        seconds: to one unit of the file's time.
    """

    columns: Columns
    scenario: Scenario | None = None
    path: tuple[str | int, ...] = ()
    notes: list[str] = field(default_factory=list)
    wraps: dict[str, bool] = field(default_factory=dict)
    further: dict[str, tuple[Columns, str, Clock]] = field(default_factory=dict)
    unsure: dict[str, str] = field(default_factory=dict)
    axis: Vector | None = None
    seconds: float = 1.0

    def where(self, *keys: str) -> Where | None:
        """The place of a key of the description; None without a scenario."""
        return self.scenario.where(*self.path, *keys) if self.scenario is not None else None

    def column(self, name: str, *keys: str) -> Vector:
        """A column as numbers, in the rows of its own file; ``keys`` lead to the part of the description that names it.

        Raises:
            RecordingError: no such column, one that several files have, or a cell that is no number.
        """
        where = self.where(*keys, "column")
        if name in self.unsure:
            raise RecordingError(f"'{name}' is a column of several files", where, self.unsure[name])
        if name in self.further:
            columns, own, _ = self.further[name]
            return columns.number(own, where)
        if name in self.columns.others and self.axis is not None and self.columns.others[name].time is not None:
            return self.columns.others[name].values
        if name not in self.columns.raw and self.further and name not in self.columns.others:
            known = nearest(name, [*self.columns.names, *self.further])
            raise RecordingError(f"no file of the recording has a column '{name}'", where, known)
        return self.columns.number(name, where)

    def clock(self, name: str) -> Clock | None:
        """The clock of a column; None if its rows are those of the recording."""
        if name in self.further:
            return self.further[name][2]
        other = self.columns.others.get(name)
        if other is None or other.time is None or self.axis is None:
            return None
        if f"'{other.clock}'" not in " ".join(self.notes):
            self.notes.append(f"columns of the clock '{other.clock}' are joined on time")
        return Clock(other.time * self.seconds)

    def factor(self, unit: str, scale: Any, *keys: str) -> tuple[float, str]:
        """Factor to SI, and the SI unit, of a column in ``unit`` that is multiplied by ``scale``.

        Raises:
            ParameterError: an unknown unit.
        """
        try:
            number, scale_unit = split(scale) if isinstance(scale, str) else (float(scale), "")
            combined = f"({scale_unit})*({unit})" if scale_unit else unit
            conversion, si_unit = coherent(combined) if combined else (1.0, "")
        except ParameterError as error:
            raise error.at(self._place(*keys)) from None
        return number * conversion, si_unit

    def convert(self, value: object, unit: str, *keys: str) -> float:
        """A value of the description as a number in ``unit``.

        Raises:
            ParameterError: the value does not convert to ``unit``.
        """
        try:
            return convert(value, unit)
        except ParameterError as error:
            raise error.at(self._place(*keys)) from None

    def positive(self, value: object, unit: str, *keys: str) -> float:
        """As `convert`, of what must be above zero.

        Raises:
            ParameterError: the value does not convert to ``unit``.
            RecordingError: it is zero or below.
        """
        number = self.convert(value, unit, *keys)
        if not number > 0:
            raise RecordingError(f"{value} is not above zero", self._place(*keys), "give a value above zero")
        return number

    def rows(self, marked: NDArray[np.bool_]) -> str:
        """The numbers of the marked rows as text, the first eight at most."""
        numbers = self.columns.rows[marked]
        shown = ", ".join(str(number) for number in numbers[:8])
        more = f" and {len(numbers) - 8} more" if len(numbers) > 8 else ""
        return f"{self.columns.row}{'s' if len(numbers) > 1 else ''} {shown}{more}"

    def first(self, marked: NDArray[np.bool_]) -> Where:
        """The place of the first marked row."""
        return Where(self.columns.file, int(self.columns.rows[marked][0]))

    def _place(self, *keys: str) -> Where:
        return self.where(*keys) or Where(self.columns.file)
