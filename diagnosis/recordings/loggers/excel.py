"""Excel workbooks by openpyxl: each sheet is read as the CSV that it would be saved as."""

from __future__ import annotations

import csv
import datetime
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import openpyxl

from diagnosis.recordings.loggers.found import MOST_CELLS, Found, Unreadable
from engine.errors import FlexarmError

UNPACKED = 2_000_000_000
"""Bytes that a workbook, which is an archive, may unpack to."""


def read(path: Path) -> Found:
    """Columns are called by the header of their sheet; ``Sheet.column`` if several sheets hold a table.

    Raises:
        Unreadable: no workbook, or no table in it.
    """
    from diagnosis.recordings.columns import read_columns

    with zipfile.ZipFile(path) as archive:
        if sum(part.file_size for part in archive.infolist()) > UNPACKED:
            raise Unreadable("it unpacks to more than is read", "save a part of it, or as .csv")
    book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
    tables = {}
    with tempfile.TemporaryDirectory() as folder:
        for k, sheet in enumerate(book.worksheets):
            saved = Path(folder) / f"{k}.csv"
            if _save(sheet, saved):
                try:
                    tables[sheet.title] = read_columns(saved)
                except FlexarmError as error:
                    problem = error
    if not tables:
        try:
            raise Unreadable(f"no sheet holds a table of numbers: {problem.message}", problem.remedy)
        except UnboundLocalError:
            raise Unreadable("all its sheets are empty", "formulas have values once the workbook was saved") from None
    found = Found()
    for title, table in tables.items():
        prefix = f"{title}." if len(tables) > 1 else ""
        for name in table.names:
            found.add(f"{prefix}{name}", table.raw[name], unit=table.units.get(name, ""))
            if name in table.odd:
                odd = table.odd[name]
                found.odd[f"{prefix}{name}"] = (odd.row, odd.what, odd.remedy)
        said = f"sheet '{title[:60]}': " if prefix else ""
        found.notes += [f"{said}{note}" for note in table.notes]
        found.rows = int(table.rows[0])
    return found


def _save(sheet: Any, path: Path) -> bool:
    """A sheet as CSV, and whether anything is in it."""
    cells, filled = 0, False
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for row in sheet.iter_rows(values_only=True):
            texts = [_text(cell) for cell in row]
            while texts and not texts[-1]:
                texts.pop()
            cells += len(texts) + 1
            if cells > MOST_CELLS:
                raise Unreadable("a sheet holds more cells than are read", "save a part of it")
            filled = filled or bool(texts)
            texts += [""] * (len(row) - len(texts)) if texts else []
            writer.writerow(texts)
    return filled


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, int | float):
        return repr(cell)
    if isinstance(cell, datetime.datetime | datetime.time):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime.datetime) else cell.isoformat()
    if isinstance(cell, datetime.timedelta):
        return repr(cell.total_seconds())
    return " ".join(str(cell).split())
