"""Result files read back: numbers with their names, units and what made them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from engine.errors import FlexarmError, nearest
from engine.files import missing
from engine.readers.matlab import read_mat, simplified
from engine.readers.regular import FileProblem, opened
from engine.readers.text import LARGEST, check_names
from flexarm.console.text import columns as in_columns
from flexarm.console.text import number, plural

KINDS = (".parquet", ".csv", ".mat")


@dataclass(frozen=True)
class Table:
    """A result file of `flexarm run` or `flexarm sweep`.

    Attributes:
        path: the file.
        columns: values by name, each of shape (rows,): numbers, or texts (objects) where a column holds texts.
        units: unit of each column, empty for none.
        metadata: what the file says of itself: scenario, versions, and for a sweep its plan. CSV files say nothing.
    """

    path: Path
    columns: dict[str, Any] = field(repr=False)
    units: dict[str, str]
    metadata: dict[str, Any] = field(repr=False)

    @property
    def names(self) -> list[str]:
        """Names of the columns, in order."""
        return list(self.columns)

    @property
    def scenario_hash(self) -> str | None:
        """Identifies the scenario's files and overrides, equal to `Scenario.digest`; None if the file does not say."""
        found = self.metadata.get("scenario_hash")
        return None if found is None else str(found)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __getitem__(self, name: str) -> Any:
        """One column, shape (rows,).

        Raises:
            FlexarmError: no such column.
        """
        if name not in self.columns:
            raise FlexarmError(f"'{self.path}' has no column '{name}'", remedy=nearest(str(name), self.columns))
        return self.columns[name]

    def __str__(self) -> str:
        """Name, unit, least and greatest value of each column; of a column of texts, how many rows hold one."""
        rows = [[name, self.units.get(name, ""), *_range(values)] for name, values in self.columns.items()]
        return f"{self.path}: {plural(len(self), 'row')}\n" + in_columns(["column", "unit", "least", "greatest"], rows)

    def to_pandas(self) -> Any:
        """A pandas DataFrame, with the units in ``attrs["units"]``."""
        import pandas

        frame = pandas.DataFrame(self.columns)
        frame.attrs |= {"units": dict(self.units), "scenario_hash": self.scenario_hash}
        return frame


def _range(values: Any) -> list[str]:
    numbers = np.asarray(values)
    if numbers.dtype.kind not in "biuf":
        filled = sum(bool(value) for value in values)
        return [f"text in {filled}" if filled else "empty", ""]
    numbers = numbers[np.isfinite(numbers)] if numbers.dtype.kind == "f" else numbers
    return [number(float(numbers.min())), number(float(numbers.max()))] if len(numbers) else ["", ""]


def read(path: str | Path, columns: list[str] | None = None) -> Table:
    """Read a result file.

    Args:
        path: a .parquet, .csv or .mat file written by ``flexarm run`` or ``flexarm sweep``.
        columns: read these columns alone; all if None.

    Raises:
        FlexarmError: no such file or column, or it cannot be read.
    """
    file = Path(path)
    if missing(file):
        beside = [p.name for p in sorted(file.parent.glob("*")) if p.suffix in KINDS] if file.parent.is_dir() else []
        raise FlexarmError(f"there is no file '{file}'", remedy=nearest(file.name, beside) if beside else "")
    readers = {".parquet": _parquet, ".csv": _csv, ".mat": _mat}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise FlexarmError(f"'{file}' is of no kind that can be read", remedy=f"its name ends in {', '.join(KINDS)}")
    with opened(file, LARGEST):
        pass  # the readers below take a name, and would wait for a pipe
    try:
        made = reader(file, columns)
    except FileProblem as error:
        raise FlexarmError(
            f"'{file}' is no result file that can be read: {error.message}", remedy=error.remedy
        ) from error
    except FlexarmError:
        raise
    except Exception as error:
        # What a library says may repeat the file, so that its kind alone is told.
        raise FlexarmError(
            f"'{file}' is no result file that can be read ({type(error).__name__})", remedy="is it the right file?"
        ) from error
    for name in columns or ():
        made[name]
    return made if columns is None else Table(file, {n: made[n] for n in columns}, made.units, made.metadata)


def _parquet(path: Path, columns: list[str] | None) -> Table:
    import pyarrow.parquet

    schema = pyarrow.parquet.read_schema(path)
    check_names(path, schema.names)
    metadata = json.loads((schema.metadata or {}).get(b"flexarm", b"{}"))
    units = metadata.pop("units", {})
    wanted = schema.names if columns is None else [name for name in columns if name in schema.names]
    if columns is not None and len(wanted) < len(columns):
        missing = next(name for name in columns if name not in schema.names)
        raise FlexarmError(f"'{path}' has no column '{missing}'", remedy=nearest(missing, schema.names))
    # Read as one file: pyarrow would take a folder name such as 'kind=1' for a further column.
    table = pyarrow.parquet.ParquetFile(path).read(columns=wanted)
    return Table(
        path,
        {name: table.column(name).to_numpy() for name in wanted},
        {name: str(units.get(name, "")) for name in wanted},
        metadata,
    )


def _csv(path: Path, columns: list[str] | None) -> Table:
    import pyarrow.csv

    table = pyarrow.csv.read_csv(path)
    check_names(path, table.column_names)
    made: dict[str, Any] = {}
    units: dict[str, str] = {}
    for head in table.column_names:
        # Names may end in an index as well: 'link.q[1] [m]'.
        found = re.fullmatch(r"(.*?) \[([^\[\]]*)\]", head)
        name, unit = found.groups() if found else (head, "")
        values = table.column(head).to_numpy()
        made[name], units[name] = values.astype(float) if values.dtype.kind in "iu" else values, unit
    return Table(path, made, units, {})


def _mat(path: Path, columns: list[str] | None) -> Table:
    content = simplified(read_mat(path))
    if "flexarm_names" not in content:
        raise FlexarmError(f"'{path}' was not written by flexarm run", remedy="read it as a recording")
    names = [str(name) for name in np.atleast_1d(content["flexarm_names"])]
    units = [str(unit) for unit in np.atleast_1d(content["flexarm_units"])]
    # MATLAB names, in the order of the full names.
    flat = [key for key in content if not key.startswith(("__", "flexarm_"))]
    metadata = {key: str(value) for key, value in dict(content["flexarm_source"]).items()}
    return Table(
        path,
        {name: np.atleast_1d(content[key]) for name, key in zip(names, flat, strict=True)},
        dict(zip(names, units, strict=True)),
        metadata,
    )
