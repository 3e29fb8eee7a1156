"""Files of columns, of every format, checked with row numbers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns_type import Columns, Elsewhere, RecordingError, Vector
from diagnosis.recordings.dialect import read_dialect
from diagnosis.recordings.loggers.found import Found
from diagnosis.recordings.loggers.host import FORMATS, installed, read_foreign
from engine.errors import Where, nearest
from engine.files import missing
from engine.readers.matlab import LARGEST as LARGEST_MAT
from engine.readers.matlab import read_mat, simplified
from engine.readers.objects import LINES, read_json
from engine.readers.regular import FileProblem, opened, problem, shown
from engine.readers.text import LARGEST, Oddity, TextTable, as_numbers, check_names, read_plain, read_table

__all__ = ["SUFFIXES", "Columns", "RecordingError", "Vector", "read_columns"]

OWN = (".csv", ".txt", ".tsv", ".log", ".asc", ".mat", ".parquet", ".json", ".jsonl", ".ndjson", ".dat")
SUFFIXES = (*OWN, *(ending for ending in FORMATS if ending.startswith(".")))
TEXTS = ("", ".csv", ".txt", ".tsv", ".log", ".asc")
FREE_CELLS, CELLS_A_BYTE = 10_000_000, 10
"""Rows times columns that a Parquet file may unpack to in any case, and for each of its bytes."""
HDF5 = b"\x89HDF\r\n\x1a\n"
DEEPEST = 40
"""Levels of structures in a MATLAB or JSON file that are searched for columns."""


def read_columns(path: Path, where: Where | None = None, like: str = "", form: str = "") -> Columns:
    """Read a file of columns.

    Columns are called as in the header, the variable or the key; those of a matrix ``name[1]``, ``name[2]``, the cells
    of a MATLAB cell array ``name{1}``, and the columns of a .dat file, which has no header, ``[1]``, ``[2]``; a bag's
    ``topic.field``. Columns of another length than the time's are kept with their own clock, where the file has one.

    Args:
        path: a file of one of `SUFFIXES`, or the folder of a rosbag2.
        where: the place in the scenario that names it.
        form: format of a file whose name does not tell it, such as ``csv``.
        like: column whose length the others must have, for files that hold several lengths; the most common otherwise.

    Raises:
        RecordingError: it does not exist or cannot be read.
    """
    if missing(path):
        beside = [p.name for p in sorted(path.parent.glob("*")) if p.suffix in SUFFIXES] if path.parent.is_dir() else []
        raise RecordingError(f"there is no recording '{path}'", where, nearest(path.name, beside) if beside else "")
    kind = f".{form.lower().lstrip('.')}" if form else path.suffix.lower()
    try:
        if _is_bag(path):
            columns = _foreign(path, read_foreign(path, "rosbag2"), like)
        elif kind in FORMATS:
            columns = _foreign(path, read_foreign(path, kind), like)
        elif kind == ".mat" and _needs_library(path):
            columns = _foreign(path, read_foreign(path, "matlab"), like)
        elif kind in (".mat", ".json", *LINES):
            columns = _structure(path, like)
        elif kind == ".dat":
            columns = _text(path, read_plain)
        elif kind in TEXTS or kind not in SUFFIXES:
            columns = _any_text(path, kind)
        elif kind == ".parquet":
            columns = _parquet(path)
        else:
            raise AssertionError(kind)
    except FileProblem as error:
        raise RecordingError(error.message, error.where or where, error.remedy) from error
    if not len(columns):
        raise RecordingError("the recording is empty", Where(str(path)), "it needs a header and at least two rows")
    return columns


def _is_bag(path: Path) -> bool:
    """Whether it is the folder of a rosbag2; a name that no file can have is none."""
    try:
        return path.is_dir() and (path / "metadata.yaml").is_file()
    except OSError:
        return False


def _text(path: Path, reader: Callable[[Path], TextTable]) -> Columns:
    table = reader(path)
    return Columns(str(path), table.columns, table.lines, "line", odd=table.odd)


def _any_text(path: Path, kind: str) -> Columns:
    """A tidy table, or one whose layout has to be guessed; a file of another kind is refused as such.

    Raises:
        FileProblem: neither.
    """
    laid_out = False
    try:
        tidy = _text(path, read_table)
        if not tidy.odd:
            return tidy
        # A row of units, or decimal commas, make words of what stands in every row; later ones leave names as they are.
        laid_out = not any(odd.row <= tidy.rows[min(2, len(tidy.rows) - 1)] for odd in tidy.odd.values())
        problem = None
    except FileProblem as error:
        tidy, problem = None, error
    guessed = read_dialect(path)
    if guessed is not None and guessed.notes:  # without an assumption it would be what the tidy reader refused
        if tidy is None:
            return guessed
        if len(guessed.odd) < len(tidy.odd) and (guessed.names == tidy.names or not laid_out):
            return replace(guessed, words=tidy.odd) if laid_out else guessed
    if tidy is not None:
        return tidy
    assert problem is not None
    if kind in TEXTS:
        raise problem
    known = ", ".join(SUFFIXES)
    raise RecordingError(
        f"'{path.name}' is of no known kind", None, f"recordings are {known} files; 'format: csv' says what another is"
    )


def _structure(path: Path, like: str) -> Columns:
    """Every vector and matrix of a MATLAB or JSON file that is as long as most, or as ``like``."""
    matlab = path.suffix.lower() == ".mat"
    content = simplified(read_mat(path)) if matlab else read_json(path, records=True)
    objects = [shown(name) for name, value in content.items() if value is None] if matlab else []
    if objects and installed("matlab"):
        return _foreign(path, read_foreign(path, "matlab"), like)
    flat: dict[str, Vector] = {}
    _collect("", content, flat, path)
    remedy = f"pip install 'flexarm[{FORMATS['matlab'].extra}]' to read tables" if objects else ""
    if not flat:
        raise RecordingError("the file holds no columns of numbers", Where(str(path)), remedy)
    notes = (f"{', '.join(objects[:8])} hold no plain numbers and are left out; {remedy}",) if objects else ()
    return replace(_of_length(path, Found(flat), like), units=_mat_units(content), notes=notes)


def _foreign(path: Path, found: Found, like: str) -> Columns:
    columns = _of_length(path, found, like)
    odd = {name: Oddity(*said) for name, said in found.odd.items()}
    return replace(columns, units=found.units, odd=odd, notes=tuple(found.notes))


def _needs_library(path: Path) -> bool:
    """Whether a MATLAB file is of version 7.3, or holds tables."""
    with opened(path, LARGEST_MAT, "save a part of it") as file:
        start = file.read(520)
    return start[:8] == HDF5 or start[512:] == HDF5 or start[124:128] in (b"\x00\x02IM", b"\x02\x00MI")


def _of_length(path: Path, found: Found, like: str) -> Columns:
    """The columns that belong to the clock ``like``, or are as long as it, or as most."""
    flat = found.columns
    lengths = Counter(len(values) for values in flat.values())
    length = len(flat[like]) if like in flat else max(lengths, key=lambda n: (lengths[n] * (n > 1), n))
    clock = found.clocks.get(like)

    def together(name: str) -> bool:
        own = found.clocks.get(name)
        return len(flat[name]) == length and (own == clock or own is None or clock is None)

    columns = {name: values for name, values in flat.items() if together(name)}
    others = {
        name: Elsewhere(values, found.clocks.get(name, ""), flat.get(found.clocks.get(name, "")))
        for name, values in flat.items()
        if name not in columns
    }
    return Columns(str(path), columns, np.arange(found.rows, found.rows + length), others=others)


def _collect(prefix: str, value: Any, flat: dict[str, Vector], path: Path, depth: int = 0) -> None:
    """Every vector of numbers in a structure, under its path; time runs along the longer side of a matrix."""
    if depth > DEEPEST:
        raise problem(path, f"structures are nested more than {DEEPEST} levels deep")
    if isinstance(value, dict):
        for key, inner in value.items():
            _collect(f"{prefix}.{key}" if prefix else key, inner, flat, path, depth + 1)
        return
    if isinstance(value, list) and len(value) > 1 and all(isinstance(entry, dict) for entry in value):
        _collect_records(prefix, value, flat, path, depth + 1)
        return
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        return
    if array.dtype.kind == "O" and all(cell is None or isinstance(cell, int | float) for cell in array.flat):
        array = array.astype(float)
    if array.dtype.kind == "O" and array.ndim == 1:
        for i, cell in enumerate(array):
            if isinstance(cell, np.ndarray | dict):
                _collect(f"{prefix}{{{i + 1}}}", cell, flat, path, depth + 1)
        return
    if array.dtype.kind not in "fiub":
        return
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    if array.ndim == 0:
        array = array.reshape(1)
    if array.ndim == 1:
        _add(flat, prefix, array, path)
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(array.shape[1]):
            _add(flat, f"{prefix}[{i + 1}]", array[:, i], path)


def _collect_records(
    prefix: str, entries: list[dict[str, Any]], flat: dict[str, Vector], path: Path, depth: int
) -> None:
    """A list of records, one for each instant: a column for each number in them; NaN where a record lacks it."""
    if depth > DEEPEST:
        raise problem(path, f"structures are nested more than {DEEPEST} levels deep")
    for key in dict.fromkeys(key for entry in entries for key in entry):
        cells = [entry.get(key) for entry in entries]
        name = f"{prefix}.{key}" if prefix else key
        if all(cell is None or isinstance(cell, bool | int | float) for cell in cells):
            _add(flat, name, np.array([np.nan if cell is None else float(cell) for cell in cells]), path)
        elif all(isinstance(cell, dict) for cell in cells):
            _collect_records(name, [cell for cell in cells if isinstance(cell, dict)], flat, path, depth + 1)
        elif all(isinstance(cell, list) for cell in cells):
            _collect(name, cells, flat, path, depth + 1)


def _add(flat: dict[str, Vector], name: str, values: NDArray[Any], path: Path) -> None:
    check_names(path, [*([name] if name in flat else []), name])
    flat[name] = values.astype(float)


def _mat_units(content: dict[str, Any]) -> dict[str, str]:
    names, units = _all_texts(content.get("flexarm_names")), _all_texts(content.get("flexarm_units"))
    return dict(zip([name.replace(".", "_") for name in names], units, strict=False))


def _all_texts(value: Any) -> list[str]:
    """A text or a list of texts as a list; empty for anything else."""
    found = [value] if isinstance(value, str) else value
    if not isinstance(found, list | np.ndarray) or not all(isinstance(text, str) for text in found):
        return []
    return [text.strip() for text in found]


def _parquet(path: Path) -> Columns:
    import pyarrow.parquet as parquet

    with opened(path, LARGEST, "save a part of it") as file:
        try:
            described = parquet.ParquetFile(file)
            names, rows = list(described.schema_arrow.names), described.metadata.num_rows
            most = FREE_CELLS + CELLS_A_BYTE * path.stat().st_size
            if rows * len(names) <= most:
                table = described.read()
        except Exception as error:
            # What the library says may repeat the file, so that its kind alone is told.
            raise problem(
                path, f"the Parquet file cannot be read ({type(error).__name__})", "save it anew, or as .csv"
            ) from error
    check_names(path, names)
    if rows * len(names) > most:
        said = f"it says that it holds {rows} rows of {len(names)} columns, out of all proportion to its size"
        raise problem(path, f"the Parquet file is refused: {said}", "save it without so much compression, or as .csv")
    columns: dict[str, Vector] = {}
    odd: dict[str, Oddity] = {}
    for name in names:
        values = table.column(name).to_numpy()
        if values.dtype.kind in "fiub":
            columns[name] = values.astype(float)
            continue
        texts = ["" if value is None else str(value) for value in values]
        columns[name], found = as_numbers(texts, range(1, len(texts) + 1))
        odd |= {name: found} if found is not None else {}
    units = _units(table.schema.metadata or {})
    return Columns(str(path), columns, np.arange(1, table.num_rows + 1), units=units, odd=odd)


def _units(metadata: Mapping[bytes, bytes]) -> dict[str, str]:
    """The units of a file that flexarm wrote; none of another, whatever it says under the same key."""
    try:
        units = json.loads(metadata.get(b"flexarm", b"{}"))["units"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    if not isinstance(units, dict):
        return {}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}
