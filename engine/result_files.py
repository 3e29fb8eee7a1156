"""A simulation's signals as a file: CSV, Parquet and MAT-file, every column with its unit."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from engine.files import json_text, writing

TABLES = (".csv", ".parquet", ".mat")


class Signals(Protocol):
    """What is written: instants, values of shape (rows, signals), and names with units."""

    @property
    def time(self) -> NDArray[np.float64]:
        """Instants (s), shape (rows,)."""

    @property
    def values(self) -> NDArray[np.float64]:
        """Shape (rows, signals)."""

    @property
    def units(self) -> dict[str, str]:
        """Name -> unit, in the order of the columns."""


def write(path: Path, signals: Signals, source: dict[str, str]) -> None:
    """Write signals as .csv, .parquet or .mat.

    Args:
        path: the file; its ending says the kind.
        signals: what is written.
        source: what made them, kept in .parquet and .mat.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    with writing(path, TABLES) as temporary:
        writer = {".csv": _csv, ".parquet": _parquet, ".mat": _mat}[path.suffix.lower()]
        writer(temporary, signals, source)


def _csv(path: Path, signals: Signals, source: dict[str, str]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time [s]", *(f"{name} [{unit}]" for name, unit in signals.units.items())])
        for start in range(0, len(signals.time), 10_000):
            rows = slice(start, start + 10_000)
            writer.writerows(np.column_stack([signals.time[rows], signals.values[rows]]).tolist())


def _parquet(path: Path, signals: Signals, source: dict[str, str]) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = {"time": signals.time, **dict(zip(signals.units, signals.values.T, strict=True))}
    described = {"units": {"time": "s", **signals.units}, **source}
    table = pyarrow.table(columns)
    metadata = {**(table.schema.metadata or {}), b"flexarm": json_text(described).encode()}
    pyarrow.parquet.write_table(table.replace_schema_metadata(metadata), path)


def flat_names(names: Sequence[str]) -> list[str]:
    """Names that MATLAB accepts: letters, digits and underscores, at most 63, all different."""
    made: list[str] = []
    for name in names:
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:60]
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        unique, count = plain, 2
        while unique in made:
            unique, count = f"{plain}_{count}", count + 1
        made.append(unique)
    return made


def _mat(path: Path, signals: Signals, source: dict[str, str]) -> None:
    from scipy.io import savemat

    names = flat_names(list(signals.units))
    content: dict[str, Any] = {"time": signals.time[:, None]}
    content |= {flat: column[:, None] for flat, column in zip(names, signals.values.T, strict=True)}
    content["flexarm_names"] = np.array(["time", *signals.units], dtype=object)
    content["flexarm_units"] = np.array(["s", *signals.units.values()], dtype=object)
    content["flexarm_source"] = source
    savemat(path, content, do_compression=True, long_field_names=True)
