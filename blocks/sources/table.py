"""A recorded signal from a CSV, MATLAB or JSON file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from engine.block import Block, option, parameter, signal_out
from engine.errors import ParameterError, nearest
from engine.readers.regular import FileProblem, shown
from engine.readers.text import read_table

if TYPE_CHECKING:
    from engine.net import Net

LARGEST_TEXT = 200_000_000
"""Bytes of a CSV file; its rows become part of the model."""


class Table(Block):
    """Recorded signal: out = scale * column(t), held or interpolated between the rows; beyond the ends the end value.

    The file is CSV with a header (lines starting with ``#`` are skipped), or .mat or .json with a vector for each
    name. Times must increase strictly. The output has the unit ``scale`` is given in: ``scale: 1 mm`` for a column
    in millimetres. With ``zero_order`` a row's value holds from its instant until the next one.
    """

    files: ClassVar[tuple[str, ...]] = ("file",)
    """Options that name files; a scenario resolves them from where it stands."""

    file = option(str, ..., "path of the CSV, .mat or .json file")
    column = option(str, ..., "name of the column that holds the signal")
    time = option(str, "time", "name of the column that holds the time")
    hold = option(str, "zero_order", "what happens between rows", choices=("zero_order", "linear"))
    scale = parameter("*", 1.0, "value of one unit of the column, with its unit")
    time_unit = parameter("s", 1.0, "duration of one unit of the time column", gt=0, structural=True)

    out = signal_out("*", "the recorded signal")

    def check(self) -> None:
        """Read the file, so that an error in it is reported where the block is declared."""
        reads = read_vectors if Path(self.file).suffix.lower() in (".mat", ".json") else read_columns
        times, self.samples = reads(self.file, self.time, self.column)
        self.times = [self.time_unit * t for t in times]

    def stamp(self, net: Net) -> None:
        value = net.table("samples", "1", self.times, self.samples, self.hold)
        net.output("out", self.scale * value, self.unit_of("scale"), type(self).ports["out"].doc)


def read_vectors(file: str, time: str, column: str) -> tuple[list[float], list[float]]:
    """Times and values from the vectors of a .mat or .json file.

    Raises:
        ParameterError: no such file or name, vectors of unequal length, a number that is not finite, or times that do
            not increase.
    """
    from blocks.controllers.matrices import read

    found = read(file)
    for name in (time, column):
        if name not in found:
            raise ParameterError(f"'{file}' has no vector '{name}'", remedy=nearest(name, map(shown, found)))
    times, values = (found[name].ravel() for name in (time, column))
    if len(times) != len(values):
        raise ParameterError(
            f"'{file}' has {len(times)} times but {len(values)} values in '{column}'", remedy="give one value per time"
        )
    return _checked(file, "entry", range(1, len(times) + 1), {time: times, column: values})


def read_columns(file: str, time: str, column: str) -> tuple[list[float], list[float]]:
    """Times and values of one column of a CSV file.

    Raises:
        ParameterError: no such file or column, no rows, a cell that is not a finite number, or times that do not
            increase; it names the line.
    """
    try:
        table = read_table(Path(file), LARGEST_TEXT)
        read = {name: table.numbers(name) for name in (time, column)}
    except FileProblem as error:
        place = f"'{file}' line {error.where.line}: " if error.where and error.where.line else f"'{file}': "
        raise ParameterError(f"{place if error.where else ''}{error.message}", remedy=error.remedy) from None
    return _checked(file, "line", table.lines, read)


def _checked(
    file: str, row: str, rows: Sequence[int] | NDArray[np.int64], read: dict[str, NDArray[np.float64]]
) -> tuple[list[float], list[float]]:
    """Times and values, finite and in order; ``read`` holds the times first."""
    for name, numbers in read.items():
        holes = np.flatnonzero(~np.isfinite(numbers))
        if len(holes):
            raise ParameterError(
                f"'{file}' {row} {rows[int(holes[0])]}: column '{name}' is not a finite number",
                remedy="remove the row, or fill the cell",
            )
    times, values = next(iter(read.values())), list(read.values())[-1]
    if not len(times):
        raise ParameterError(f"'{file}' holds no rows", remedy="give at least one")
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise ParameterError(
            f"'{file}' {row} {rows[k]}: time {times[k]:g} does not come after {times[k - 1]:g}",
            remedy="sort the rows by time and drop repeated ones",
        )
    return times.tolist(), values.tolist()
