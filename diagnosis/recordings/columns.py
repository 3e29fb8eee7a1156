"""Files of columns: CSV, MATLAB, Parquet, JSON and plain tables, checked with row numbers."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError, Where, nearest

Vector = NDArray[np.float64]

EMPTY = frozenset({"", "na", "n/a", "nan", "null", "none", "-"})
SUFFIXES = (".csv", ".mat", ".parquet", ".json", ".dat")
LONG_TEXT = 20_000_000
"""Bytes of a text file beyond which it is read at once as numbers, not cell by cell."""
LONGEST_TEXT = 2_000_000_000
"""Bytes of a text file beyond which it is refused."""


class RecordingError(FlexarmError):
    """A recording cannot be used."""


def _remedy(text: str, first: bool) -> str:
    """What to do about a text where a number should be."""
    if any(c.isdigit() for c in text):
        dated = text.count("-") > 1 or ":" in text
        return "give the time as a number of seconds" if dated else "numbers are written with a decimal point"
    if first:
        return "if this row holds units, put '#' before it"
    return "leave it empty, or write 'nan', where nothing was recorded"


@dataclass
class Columns:
    """The columns of a file.

    Attributes:
        file: the file's name, for messages.
        raw: column name -> texts or numbers.
        rows: for each value the row (line) of the file that holds it, 1-based.
        row: what a row is called: ``line`` or ``row``.
        units: units that the file itself states, by column.
    """

    file: str
    raw: Mapping[str, Any]
    rows: NDArray[np.int64]
    row: str = "row"
    units: dict[str, str] = field(default_factory=dict)

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
        if name not in self.raw:
            raise RecordingError(f"'{self.file}' has no column '{name}'", where, nearest(name, self.names))
        values = self.raw[name]
        if not isinstance(values, list):
            return np.asarray(values, dtype=float)
        try:
            return np.array(values, dtype=float)
        except ValueError:
            return np.array([self._cell(name, i, text) for i, text in enumerate(values)])

    def _cell(self, name: str, i: int, text: str) -> float:
        if text.strip().lower() in EMPTY:
            return float("nan")
        try:
            return float(text)
        except ValueError:
            raise RecordingError(
                f"column '{name}' holds '{text.strip()[:40]}' in {self.row} {self.rows[i]}, which is not a number",
                Where(self.file, int(self.rows[i])),
                _remedy(text, first=i == 0),
            ) from None


def read_columns(path: Path, where: Where | None = None, like: str = "") -> Columns:
    """Read a file of columns.

    Columns are called as in the header, the variable or the key; those of a matrix ``name[1]``, ``name[2]``, the cells
    of a MATLAB cell array ``name{1}``, and the columns of a .dat file, which has no header, ``[1]``, ``[2]``.

    Args:
        path: a .csv, .mat (version 5), .parquet, .json or .dat file.
        where: the place in the scenario that names it.
        like: column whose length the others must have, for files that hold several lengths; the most common otherwise.

    Raises:
        RecordingError: it does not exist or cannot be read.
    """
    if not path.is_file():
        beside = [p.name for p in sorted(path.parent.glob("*")) if p.suffix in SUFFIXES] if path.parent.is_dir() else []
        raise RecordingError(f"there is no recording '{path}'", where, nearest(path.name, beside) if beside else "")
    kind = path.suffix.lower()
    if kind in (".mat", ".json"):
        columns = _structure(path, like)
    elif kind in (".csv", ".txt", ".parquet", ".dat"):
        columns = {".parquet": _parquet, ".dat": _plain}.get(kind, _csv)(path)
    else:
        raise RecordingError(f"'{path.name}' is of no known kind", where, f"recordings are {', '.join(SUFFIXES)} files")
    if not len(columns):
        raise RecordingError("the recording is empty", Where(str(path)), "it needs a header and at least two rows")
    return columns


def _csv(path: Path) -> Columns:
    size = path.stat().st_size
    if size > LONGEST_TEXT:
        raise RecordingError(
            f"the file holds {size / 1e9:.3g} GB of text", Where(str(path)), "save it as .parquet, or a part of it"
        )
    if size > LONG_TEXT:
        return _long_csv(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError("the file is not UTF-8 text", Where(str(path)), "save it as UTF-8") from error
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise RecordingError("the recording is empty", Where(str(path)), "it needs a header and at least two rows")
    header_line, header = lines[0]
    delimiter = max((";", "\t", ","), key=header.count)
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter))]
    if all(_is_number(name) for name in names):
        raise RecordingError(
            "the first line holds numbers, not names", Where(str(path), header_line), "give every column a name"
        )
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise RecordingError(f"two columns are called '{min(twice)}'", Where(str(path), header_line), "rename one")
    records = list(csv.reader((line for _, line in lines[1:]), delimiter=delimiter))
    for (number, _), record in zip(lines[1:], records, strict=False):
        if len(record) != len(names):
            raise RecordingError(
                f"{len(record)} values where the header names {len(names)} columns",
                Where(str(path), number),
                "numbers are written with a decimal point; put '#' before lines that describe the file",
            )
    turned = zip(*records, strict=True) if records else ([] for _ in names)
    columns = {name: list(values) for name, values in zip(names, turned, strict=True)}
    return Columns(str(path), columns, np.array([number for number, _ in lines[1:]], dtype=np.int64), "line")


def _long_csv(path: Path) -> Columns:
    """A long file, read into numbers at once: cell by cell it would take some fifty times its size of memory."""
    import pandas

    try:
        with path.open(encoding="utf-8-sig") as lines:
            before, header = next(
                (i, line) for i, line in enumerate(lines) if line.strip() and not line.startswith("#")
            )
        delimiter = max((";", "\t", ","), key=header.count)
        table = pandas.read_csv(path, sep=delimiter, skiprows=before, comment="#", dtype=float, na_values=list(EMPTY))
    except (ValueError, StopIteration, UnicodeDecodeError) as error:
        raise RecordingError(
            f"the file cannot be read as columns of numbers: {str(error)[:200]}",
            Where(str(path)),
            "numbers are written with a decimal point, and every row has every column",
        ) from error
    columns = {str(name).strip(): np.asarray(table[name], dtype=float) for name in table.columns}
    return Columns(str(path), columns, np.arange(before + 2, before + 2 + len(table), dtype=np.int64), "line")


def _plain(path: Path) -> Columns:
    try:
        table = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise RecordingError(
            f"the file cannot be read as a table of numbers: {error}", Where(str(path)), "a .dat file has no header"
        ) from error
    return Columns(str(path), {f"[{i + 1}]": table[:, i] for i in range(table.shape[1])}, np.arange(1, len(table) + 1))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _structure(path: Path, like: str) -> Columns:
    """Every vector and matrix of a MATLAB or JSON file that is as long as most, or as ``like``."""
    content = _json(path) if path.suffix.lower() == ".json" else _mat(path)
    flat: dict[str, Vector] = {}
    _collect("", {key: value for key, value in content.items() if not key.startswith("__")}, flat)
    if not flat:
        raise RecordingError("the file holds no columns of numbers", Where(str(path)))
    lengths = [len(values) for values in flat.values()]
    length = len(flat[like]) if like in flat else max(set(lengths), key=lambda n: (lengths.count(n) * (n > 1), n))
    columns = {name: values for name, values in flat.items() if len(values) == length}
    return Columns(str(path), columns, np.arange(1, length + 1), units=_mat_units(content))


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"cannot read the JSON file: {error}", Where(str(path))) from error
    if not isinstance(content, dict):
        raise RecordingError("the file holds no JSON object", Where(str(path)), 'write {"t": [...], "u": [...]}')
    return content


def _mat(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        content: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        raise RecordingError(
            "this is a MATLAB 7.3 file", Where(str(path)), "save it with save(..., '-v7'), or as .parquet or .csv"
        ) from error
    except Exception as error:
        raise RecordingError(f"cannot read the MATLAB file: {error}", Where(str(path))) from error
    return content


def _collect(prefix: str, value: Any, flat: dict[str, Vector]) -> None:
    """Every vector of numbers in a structure, under its path; time runs along the longer side of a matrix."""
    if isinstance(value, dict):
        for key, inner in value.items():
            _collect(f"{prefix}.{key}" if prefix else key, inner, flat)
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
                _collect(f"{prefix}{{{i + 1}}}", cell, flat)
        return
    if array.dtype.kind not in "fiub":
        return
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    if array.ndim == 0:
        array = array.reshape(1)
    if array.ndim == 1:
        flat[prefix] = array.astype(float)
    elif array.ndim == 2:
        array = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(array.shape[1]):
            flat[f"{prefix}[{i + 1}]"] = array[:, i].astype(float)


def _mat_units(content: dict[str, Any]) -> dict[str, str]:
    names, units = content.get("flexarm_names"), content.get("flexarm_units")
    if names is None or units is None:
        return {}
    plain = [str(name).strip().replace(".", "_") for name in np.atleast_1d(names)]
    return dict(zip(plain, [str(unit).strip() for unit in np.atleast_1d(units)], strict=False))


def _parquet(path: Path) -> Columns:
    import pyarrow.parquet as parquet

    try:
        table = parquet.read_table(path)
    except Exception as error:
        raise RecordingError(f"cannot read the Parquet file: {error}", Where(str(path))) from error
    metadata = table.schema.metadata or {}
    units = json.loads(metadata.get(b"flexarm", b"{}")).get("units", {})
    columns: dict[str, Any] = {}
    for name in table.column_names:
        values = table.column(name).to_numpy()
        columns[name] = values.astype(float) if values.dtype.kind in "fiub" else [str(v) for v in values]
    return Columns(str(path), columns, np.arange(1, table.num_rows + 1), units=units)
