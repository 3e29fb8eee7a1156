"""CSV as loggers and spreadsheets write it: preambles, unit rows, decimal commas, encodings, dates, ragged headers.

`engine.readers.text` reads tidy tables and says what is wrong with others. What is read here is guessed from the first
rows, and every guess is told in a note.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns_type import Columns, Vector
from engine.errors import ParameterError
from engine.quantity import coherent
from engine.readers.regular import opened
from engine.readers.text import EMPTY, LARGEST, Oddity, check_names

LOOKED_AT = 65536
"""Bytes from which the layout is guessed."""
FEWEST = 3
"""Rows of numbers in a row that are a table."""
_NUMBER = re.compile(r"^[+-]?(\d+([.]\d*)?|[.]\d+)([eE][+-]?\d+)?$|^[+-]?(inf|nan)$", re.IGNORECASE)
_COMMA = re.compile(r"^[+-]?(\d+([,]\d*)?|[,]\d+)([eE][+-]?\d+)?$")
_DAY, _TIME = r"(\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{2,4})", r"\d{1,2}:\d\d(:\d\d([.,:]\d+)?)?"
_DATE = re.compile(rf"^{_DAY}([ T]{_TIME}( ?[AP]M)?(Z|[+-]\d\d:?\d\d)?)?$|^\d{{1,2}}:\d\d:\d\d([.,:]\d+)?$")
_BRACKETS = re.compile(r"^[\[(](.*)[\])]$")
_WORDS = {
    "sec": "s",
    "secs": "s",
    "second": "s",
    "seconds": "s",
    "msec": "ms",
    "degrees": "deg",
    "°": "deg",
    "-": "",
    "": "",
}


@dataclass(frozen=True)
class Layout:
    """How a text file is laid out.

    Attributes:
        encoding: of the file.
        delimiter: between cells; a blank stands for any number of blanks.
        decimal: ``.`` or ``,``.
        first: line of the first row of numbers, counted from 0.
        names: of the columns.
        units: of the columns, by name, where a row states them.
        notes: what was assumed, in sentences.
    """

    encoding: str
    delimiter: str
    decimal: str
    first: int
    names: list[str]
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def layout(path: Path) -> Layout | None:
    """The layout of a text file; None if it holds no table.

    Raises:
        FileProblem: no regular file.
    """
    with opened(path, LARGEST, "save a part of it") as file:
        data = file.read(LOOKED_AT)
    encoding = _encoding(data)
    if encoding is None:
        return None
    text = data.decode(encoding, errors="replace")
    lines = text.splitlines()
    if len(data) == LOOKED_AT:
        lines = lines[:-1]
    best: tuple[int, str, str, int, int] | None = None
    for delimiter in (";", "\t", ",", "|", " "):
        for decimal in (".", ",") if delimiter != "," else (".",):
            found = _table(lines, delimiter, decimal)
            if found is not None and (best is None or found[0] > best[0]):
                best = (found[0], delimiter, decimal, found[1], found[2])
    if best is None:
        return None
    _, delimiter, decimal, first, wide = best
    notes = []
    if encoding not in ("utf-8", "utf-8-sig"):
        notes.append(f"the file is taken to be in {encoding}")
    if decimal == ",":
        notes.append("commas are taken for decimal points")
    if delimiter in (" ", "|"):
        notes.append(f"{'blanks' if delimiter == ' ' else 'bars'} are taken to separate the columns")
    names, units, header = _header(lines, delimiter, first, wide, notes)
    if header > 0:
        notes.append(
            f"{header} line{'s' if header > 1 else ''} before the header {'are' if header > 1 else 'is'} left out"
        )
    return Layout(encoding, delimiter, decimal, first, names, units, tuple(notes))


def read_dialect(path: Path) -> Columns | None:
    """The columns of a text file, as its layout is guessed; None if it holds no table, or rows of other lengths.

    Raises:
        FileProblem: no regular file, or two columns of one name.
    """
    import pandas

    found = layout(path)
    if found is None:
        return None
    check_names(path, found.names)
    wide = len(found.names)
    try:
        table = pandas.read_csv(
            path,
            sep=r"\s+" if found.delimiter == " " else found.delimiter,
            skiprows=found.first,
            header=None,
            names=list(range(wide + 1)),
            index_col=False,
            encoding=found.encoding,
            encoding_errors="replace",
            dtype=str,
            keep_default_na=False,
            na_filter=False,
            skip_blank_lines=True,
            skipinitialspace=True,
        )
    except (pandas.errors.ParserError, ValueError):
        return None
    # A row of another length is no matter of layout: what the tidy reader says of it stands.
    if table[list(range(wide))].isna().to_numpy().any() or table[wide].fillna("").astype(str).str.strip().any():
        return None
    columns: dict[str, Vector] = {}
    odd: dict[str, Oddity] = {}
    words: dict[str, Oddity] = {}
    notes = list(found.notes)
    rows = np.arange(found.first + 1, found.first + 1 + len(table), dtype=np.int64)
    for k, name in enumerate(found.names):
        texts = table[k].fillna("").astype(str).str.strip()
        values, wrong, note = _numbers(texts, found.decimal)
        columns[name] = values
        if note:
            notes.append(f"column '{name}' {note}")
        if wrong.any():
            share = int(wrong.sum())
            text = Oddity(int(rows[int(np.argmax(wrong))]), "a text", "leave the cell empty where there is no value")
            if share > max(1, len(values) // 20):
                odd[name] = text
                continue
            words[name] = text
            notes.append(f"words in column '{name}' count as empty cells: {share} of {len(values)}")
    return Columns(str(path), columns, rows, "line", found.units, odd, words, tuple(notes))


def _numbers(texts: object, decimal: str) -> tuple[Vector, NDArray[np.bool_], str]:
    """Cells as numbers, which of them are words, and what was assumed; dates become seconds from the first."""
    import pandas

    cells = pandas.Series(texts)
    empty = cells.str.lower().isin(EMPTY).to_numpy()
    plain = cells.str.replace(",", ".", regex=False) if decimal == "," else cells
    values = np.asarray(pandas.to_numeric(plain, errors="coerce").to_numpy(), dtype=float)
    wrong = ~np.isfinite(values) & ~empty
    if wrong.sum() > len(values) // 2 and cells[wrong].iloc[0] and _DATE.match(cells[wrong].iloc[0]):
        text = cells.str.replace(r"(\d),(\d)", r"\1.\2", regex=True)
        clock_only = bool(re.match(r"^\d{1,2}:", cells[wrong].iloc[0]))
        if clock_only:
            text = text.str.replace(r"^(\d+:\d\d:\d\d):(\d+)$", r"\1.\2", regex=True)
            seconds = pandas.to_timedelta(text.where(~empty), errors="coerce").dt.total_seconds().to_numpy(dtype=float)
            jumps = np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -43200)])
            seconds = seconds + 86400.0 * jumps
        else:
            first = bool(re.match(r"^\d{1,2}\.", cells[wrong].iloc[0]))
            stamps = pandas.to_datetime(text.where(~empty), errors="coerce", dayfirst=first, utc=True, format="mixed")
            seconds = (stamps - stamps[stamps.first_valid_index()]).dt.total_seconds().to_numpy(dtype=float)
        good = np.isfinite(seconds)
        if good.sum() > len(values) // 2:
            begin = float(seconds[good][0])
            return (
                np.asarray(seconds - begin, dtype=float),
                ~good & ~empty,
                "holds dates or times of day: seconds from the first",
            )
    return values, wrong, ""


def _encoding(data: bytes) -> str | None:
    """The encoding of a text; None for what is none."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if data.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    if b"\x00" in data:
        return None
    try:
        data[: -3 if len(data) == LOOKED_AT else None].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _table(lines: list[str], delimiter: str, decimal: str) -> tuple[int, int, int] | None:
    """Score, first line and cells of the table that a reading of the lines gives; None if it gives none."""
    number = _COMMA if decimal == "," else _NUMBER
    kinds: list[tuple[int, int]] = []
    for line in lines:
        cells = _cells(line, delimiter)
        numbers = sum(bool(number.match(cell)) for cell in cells)
        dates = sum(bool(_DATE.match(cell)) for cell in cells)
        fits = numbers >= 1 and 2 * (numbers + dates + sum(c.lower() in EMPTY for c in cells)) > len(cells)
        kinds.append((len(cells) if fits and len(cells) > 1 else 0, numbers))
    last = len(kinds)
    while last and not kinds[last - 1][0]:
        last -= 1
    if not last:
        return None
    wide = kinds[last - 1][0]
    first = last
    # Rows of numbers belong to the table whatever their length: one of another length is told, not taken for a header.
    while first and (kinds[first - 1][0] or not lines[first - 1].strip()):
        first -= 1
    while first < last and not lines[first].strip():
        first += 1
    if last - first < FEWEST:
        return None
    # Numbers beyond doubt: a decimal comma that splits a number in two gives as many cells, but fewer with points.
    points = sum(("." if decimal == "." else ",") in line for line in lines[first:last])
    return sum(numbers for _, numbers in kinds[first:last]) * 2 + points, first, wide


def _header(
    lines: list[str], delimiter: str, first: int, wide: int, notes: list[str]
) -> tuple[list[str], dict[str, str], int]:
    """Names and units of columns, and how many lines stand before the header."""
    above = [i for i in range(first) if lines[i].strip()]
    cells = [_cells(lines[i].lstrip("#%") if i else lines[i].lstrip("#%\ufeff"), delimiter) for i in above]
    numbered = [f"[{k + 1}]" for k in range(wide)]
    if not cells:
        notes.append("there is no header: columns are called [1], [2], ...")
        return numbered, {}, 0
    units: list[str] = []
    head = len(cells) - 1
    if head and len(cells[head - 1]) >= wide - 1 and _are_units(cells[head]):
        units = [_unit(cell) or "" for cell in cells[head]]
        notes.append("the row under the header is taken for units")
        head -= 1
    names = cells[head]
    while len(names) > wide and not names[-1]:
        names = names[:-1]
    if len(names) == wide - 1 and wide > 1:
        last = [_cells(line, delimiter)[-1:] for line in lines[first : first + 20] if line.strip()]
        if all(cell == [""] for cell in last):
            names = [*names, ""]
        else:
            names = ["[1]", *names]
            notes.append("the header has one name too few: the first column is called [1]")
    if len(names) != wide or not any(names):
        notes.append("no line above has a name for each column: they are called [1], [2], ...")
        return numbered, {}, 0
    names = [name or f"[{k + 1}]" for k, name in enumerate(names)]
    stated = dict(zip(names[-len(units) :], units, strict=False)) if units else {}
    return names, {name: unit for name, unit in stated.items() if unit}, above[head]


def _unit(cell: str) -> str | None:
    """A unit as flexarm writes it; empty for a pure number; None for what is none."""
    inside = _BRACKETS.match(cell)
    text = (inside.group(1) if inside else cell).strip()
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        coherent(text)
    except ParameterError:
        return "" if inside else None
    return text


def _are_units(cells: list[str]) -> bool:
    known = [_unit(cell) for cell in cells]
    return all(unit is not None for unit in known) and any(known)
