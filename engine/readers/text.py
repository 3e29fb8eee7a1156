"""Text tables, whatever their size: CSV with a header, and plain tables of numbers, line by line with line numbers.

Rows are turned into numbers as they are read, so that memory is eight bytes a cell. A cell that holds no number is
NaN in its column, and the first such text of a column is kept as what it looks like, not as what it says: columns of
texts do no harm until somebody asks for their numbers.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from engine.errors import nearest
from engine.readers.regular import FileProblem, opened, problem, shown

Vector = NDArray[np.float64]

EMPTY = frozenset({"", "na", "n/a", "nan", "null", "none", "-"})
"""Texts, in small letters, that stand for no number."""

LARGEST = 2_000_000_000
"""Bytes of a text file."""

LONGEST_LINE = 4_000_000
"""Characters of a line."""

AT_ONCE = 8192
"""Rows that are turned into numbers together."""


@dataclass(frozen=True)
class Oddity:
    """The first cell of a column that holds neither a number nor nothing.

    Attributes:
        row: the line or row that holds it, 1-based.
        what: what it looks like.
        remedy: what to do about it.
    """

    row: int
    what: str
    remedy: str


@dataclass(frozen=True)
class TextTable:
    """The columns of a text file.

    Attributes:
        path: the file.
        columns: name -> numbers, shape (rows,); NaN where a cell holds none.
        lines: the line on which each row begins, 1-based, shape (rows,).
        odd: the first text of each column that holds texts.
    """

    path: Path
    columns: dict[str, Vector]
    lines: NDArray[np.int64]
    odd: dict[str, Oddity]

    def numbers(self, name: str) -> Vector:
        """A column that holds numbers and empty cells alone.

        Raises:
            FileProblem: no such column, or it holds a text.
        """
        if name not in self.columns:
            raise FileProblem(
                f"'{self.path}' has no column '{name}'", remedy=nearest(name, [shown(n) for n in self.columns])
            )
        if name in self.odd:
            odd = self.odd[name]
            raise problem(
                self.path,
                f"column '{shown(name)}' holds {odd.what} in line {odd.row}, which is not a number",
                odd.remedy,
                odd.row,
            )
        return self.columns[name]


def read_table(path: Path, largest: int = LARGEST) -> TextTable:
    """Read a CSV file: a header, then rows of as many cells, separated by commas, semicolons or tabs.

    Empty lines, and lines between rows that begin with ``#``, are skipped. A cell in double quotes may hold separators
    and line ends.

    Raises:
        FileProblem: no regular UTF-8 file, no header, two columns of one name, a row of another length, an unfinished
            quote, or no number anywhere.
    """
    with opened(path, largest, "save it as .parquet, or a part of it") as file:
        lines = _Lines(path, file)
        first = lines.peek()
        delimiter = max((";", "\t", ","), key=first.count)
        records = _records(path, lines, delimiter)
        line, header = next(records)
        names = _names(path, [name.strip() for name in header], line)
        return _collected(path, names, records)


def read_plain(path: Path, largest: int = LARGEST) -> TextTable:
    """Read a table of numbers without a header, separated by blanks; its columns are called ``[1]``, ``[2]``, ...

    What follows a ``#`` is skipped.

    Raises:
        FileProblem: no regular UTF-8 file, a row of another length, or something that is no number.
    """
    with opened(path, largest, "save it as .parquet, or a part of it") as file:
        lines = _Lines(path, file)
        wide = len(lines.peek().partition("#")[0].split())
        names = [f"[{k + 1}]" for k in range(wide)]
        made = _collected(path, names, ((lines.number, line.partition("#")[0].split()) for line in lines))
    for name in names:
        made.numbers(name)
    return made


class _Lines:
    """The lines of a file, each checked to be UTF-8 and of bounded length; comments between records are skipped.

    Attributes:
        number: of the line given last, 1-based.
        between: whether the next line begins a record; the reader of records sets it.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        # Bytes that are no UTF-8 become lone surrogates, so that the line which holds them can be named.
        self._text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="surrogateescape", newline="")
        self._path = path
        self._waiting: str | None = None
        self.number = 0
        self.between = True

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        if self._waiting is not None:
            line, self._waiting = self._waiting, None
            self.between = False
            return line
        while line := self._text.readline(LONGEST_LINE):
            self.number += 1
            if len(line) >= LONGEST_LINE:
                raise problem(self._path, "the line is too long for a table", "is it a text table?", self.number)
            if not line.isascii():
                self._check(line)
            if self.between and (line.startswith("#") or not line.strip()):
                continue
            self.between = False
            return line
        raise StopIteration

    def _check(self, line: str) -> None:
        try:
            line.encode()
        except UnicodeEncodeError:
            raise problem(self._path, "the file is not UTF-8 text", "save it as UTF-8", self.number) from None

    def peek(self) -> str:
        """The first line that is no comment; it is given again."""
        try:
            self._waiting = next(self)
        except StopIteration:
            raise problem(self._path, "the file is empty", "it needs a header and rows") from None
        return self._waiting


def _records(path: Path, lines: _Lines, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Each record with the line on which it begins."""
    begun = 0

    def watched() -> Iterator[str]:
        nonlocal begun
        for line in lines:
            begun = begun or lines.number
            yield line

    reader = csv.reader(watched(), delimiter=delimiter, strict=True)
    while True:
        lines.between, begun = True, 0
        try:
            record = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            said = str(error)
            if "limit" in said:
                what, remedy = f"a cell of more than {csv.field_size_limit()} characters", "is a closing quote missing?"
            elif "unexpected end" in said:
                what, remedy = "a quote that is never closed", "close it, or leave the quote out"
            else:
                what, remedy = "a quote in the middle of a cell", 'write "" for a quote inside of a quoted cell'
            raise problem(path, f"the row holds {what}", remedy, begun or lines.number) from None
        yield begun, record


def _names(path: Path, names: list[str], line: int) -> list[str]:
    if all(_number(name) is not None for name in names):
        raise problem(path, "the first line holds numbers, not names", "give every column a name", line)
    check_names(path, names, line)
    return names


def check_names(path: Path, names: list[str], line: int = 0) -> None:
    """Refuse two columns of one name: which of them is meant could not be told.

    Raises:
        FileProblem: so.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            said = f"two columns are called '{shown(name)}'" if name else "two columns have no name"
            raise problem(path, said, "rename one of them, and name every column", line)
        seen.add(name)


def _collected(path: Path, names: list[str], records: Iterator[tuple[int, list[str]]]) -> TextTable:
    """Rows as columns of numbers."""
    pieces: list[NDArray[np.float64]] = []
    lines: list[NDArray[np.int64]] = []
    odd: dict[str, Oddity] = {}
    wide, begun = len(names), True
    while True:
        numbers: list[int] = []
        rows: list[list[str]] = []
        for number, record in records:
            if len(record) != wide:
                trailing = len(record) == wide + 1 and not record[-1].strip()
                raise problem(
                    path,
                    f"{_counted(len(record), 'value')} where the header names {_counted(wide, 'column')}",
                    "the row ends in a separator: remove it, or end the header in it too"
                    if trailing
                    else "numbers are written with a decimal point; put '#' before lines that describe the file",
                    number,
                )
            numbers.append(number)
            rows.append(record)
            if len(rows) == AT_ONCE:
                break
        if not rows:
            break
        piece = np.empty((wide, len(rows)))
        for k, cells in enumerate(zip(*rows, strict=True)):
            piece[k], found = as_numbers(cells, numbers, begun)
            if found is not None:
                odd.setdefault(names[k], found)
        pieces.append(piece)
        lines.append(np.array(numbers, dtype=np.int64))
        begun = False
    if not pieces:
        raise problem(path, "the file is empty but for its header", "it needs a header and rows")
    columns = {name: np.concatenate([piece[k] for piece in pieces]) for k, name in enumerate(names)}
    if all(np.isnan(values).all() for values in columns.values()):
        # What stands in the file is not repeated: it may be no table, but somebody's file of secrets.
        raise problem(path, "no column of the file holds a number", "is it a table, and the right one?")
    return TextTable(path, columns, np.concatenate(lines), odd)


def _counted(count: int, word: str) -> str:
    return f"{count} {word if count == 1 else word + 's'}"


def as_numbers(cells: Sequence[str], rows: Sequence[int], first: bool = True) -> tuple[Vector, Oddity | None]:
    """Texts as numbers, NaN where there is none, and the first that is neither a number nor empty.

    Args:
        cells: of one column.
        rows: the line or row of each.
        first: whether the first cell is the column's first.
    """
    # Python and NumPy take '1_000' for a number, which no measuring instrument writes: it is more likely a name.
    try:
        if not any("_" in cell for cell in cells):
            return np.array(cells, dtype=np.float64), None
    except ValueError:
        pass
    values = np.full(len(cells), np.nan)
    odd: Oddity | None = None
    for i, cell in enumerate(cells):
        value = _number(cell)
        if value is not None:
            values[i] = value
        elif odd is None and cell.strip().lower() not in EMPTY:
            odd = Oddity(rows[i], *_looks(cell.strip(), first and i == 0))
    return values, odd


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


_LOOKS: tuple[tuple[Callable[[str], object], str, str], ...] = (
    (
        re.compile(r"[^:]*\d:\d|\d+-\d+-\d+|\d+/\d+/\d+").match,
        "a date or a time of day",
        "give the time as a number of seconds",
    ),
    (
        re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?$").match,
        "a decimal comma",
        "numbers are written with a decimal point",
    ),
    (
        re.compile(r"[-+]?[\d.]+([eE][-+]?\d+)?\s*[^\d\s.,]+$").match,
        "a number with a text behind it",
        "leave units out of the cells; they belong into the scenario or the header",
    ),
)


def _looks(text: str, first: bool) -> tuple[str, str]:
    """What a text is like, and what to do about it; not what it says, for the file may not be meant to be read."""
    for matches, what, remedy in _LOOKS:
        if matches(text):
            return what, remedy
    if first:
        return "a text", "if this row holds units, put '#' before it"
    if any(c.isdigit() for c in text):
        return "a text", "numbers are written with a decimal point"
    return "a text", "leave the cell empty, or write 'nan', where nothing was recorded"
