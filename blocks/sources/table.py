"""A recorded signal from a CSV, MATLAB or JSON file."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from engine.block import Block, option, parameter, signal_out
from engine.errors import ParameterError, nearest

if TYPE_CHECKING:
    from engine.net import Net


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
            raise ParameterError(f"'{file}' has no vector '{name}'", remedy=nearest(name, found))
    times, values = (found[name].ravel().tolist() for name in (time, column))
    if len(times) != len(values):
        raise ParameterError(
            f"'{file}' has {len(times)} times but {len(values)} values in '{column}'", remedy="give one value per time"
        )
    for k, (t, value) in enumerate(zip(times, values, strict=True)):
        if not (math.isfinite(t) and math.isfinite(value)):
            raise ParameterError(f"'{file}' entry {k + 1} is not finite", remedy="remove it")
        if k and t <= times[k - 1]:
            raise ParameterError(
                f"'{file}' entry {k + 1}: time {t:g} does not come after {times[k - 1]:g}", remedy="sort by time"
            )
    if not times:
        raise ParameterError(f"'{file}' holds no rows", remedy="give at least one")
    return times, values


def read_columns(file: str, time: str, column: str) -> tuple[list[float], list[float]]:
    """Times and values of one column of a CSV file.

    Raises:
        ParameterError: no such file or column, no rows, a cell that is not a finite number, or times that do not
            increase; it names the line.
    """
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else error.strerror
        raise ParameterError(f"cannot read '{file}': {reason}", remedy="check the path, and that it is CSV") from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise ParameterError(f"'{file}' is empty", remedy="give a CSV file with a header and rows")
    header = [name.strip() for name in next(csv.reader([lines[0][1]]))]
    for name in (time, column):
        if name not in header:
            raise ParameterError(f"'{file}' has no column '{name}'", remedy=nearest(name, header))
        if header.count(name) > 1:
            raise ParameterError(f"'{file}' has {header.count(name)} columns '{name}'", remedy="rename one of them")
    places = header.index(time), header.index(column)
    times: list[float] = []
    values: list[float] = []
    for number, line in lines[1:]:
        cells = next(csv.reader([line]))
        t, value = (_number(file, number, header[place], cells, place) for place in places)
        if times and t <= times[-1]:
            raise ParameterError(
                f"'{file}' line {number}: time {t:g} does not come after {times[-1]:g}",
                remedy="sort the rows by time and drop repeated ones",
            )
        times.append(t)
        values.append(value)
    if not times:
        raise ParameterError(f"'{file}' has a header but no rows", remedy="give at least one row")
    return times, values


def _number(file: str, line: int, name: str, cells: list[str], place: int) -> float:
    """One cell as a finite number."""
    cell = cells[place].strip() if place < len(cells) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(
            f"'{file}' line {line}: '{cell}' in column '{name}' is not a finite number",
            remedy="remove the row, or fill the cell",
        )
    return value
