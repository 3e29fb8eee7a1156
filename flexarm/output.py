"""Writing results: every file is made beside its target under another name and then moved, so none is half-written."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.files import json_text, writing
from flexarm._version import version

if TYPE_CHECKING:
    from engine.discretise import DiscreteModel
    from engine.family import LinearFamily
    from engine.linearise import LinearModel
    from engine.simulate import Result
    from scenarios.load import Scenario

TABLES = (".csv", ".parquet", ".mat")
LINEAR = (".json", ".npz", ".mat", ".m")


def provenance(scenario: Scenario) -> dict[str, str]:
    """What made a result: scenario, its content hash, overrides and versions."""
    from importlib import metadata

    return {
        "scenario": scenario.name,
        "file": str(scenario.path),
        "scenario_hash": scenario.digest,
        "overrides": " ".join(scenario.overrides),
        "flexarm": version(),
        "casadi": metadata.version("casadi"),
        "numpy": np.__version__,
    }


def write_result(path: Path, result: Result, scenario: Scenario) -> None:
    """Write a simulation as .csv, .parquet or .mat; every column with its unit.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    with writing(path, TABLES) as temporary:
        writer = {".csv": _csv, ".parquet": _parquet, ".mat": _mat}[path.suffix.lower()]
        writer(temporary, result, scenario)


def _csv(path: Path, result: Result, scenario: Scenario) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time [s]", *(f"{name} [{unit}]" for name, unit in result.units.items())])
        for start in range(0, len(result.time), 10_000):
            rows = slice(start, start + 10_000)
            writer.writerows(np.column_stack([result.time[rows], result.values[rows]]).tolist())


def _parquet(path: Path, result: Result, scenario: Scenario) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = {"time": result.time, **{name: result[name] for name in result.names}}
    units = {"time": "s", **result.units}
    described = {"units": units, **provenance(scenario)}
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


def _mat(path: Path, result: Result, scenario: Scenario) -> None:
    from scipy.io import savemat

    names = flat_names(result.names)
    content: dict[str, Any] = {"time": result.time[:, None]}
    content |= {flat: result[name][:, None] for flat, name in zip(names, result.names, strict=True)}
    content["flexarm_names"] = np.array(["time", *result.names], dtype=object)
    content["flexarm_units"] = np.array(["s", *result.units.values()], dtype=object)
    content["flexarm_source"] = provenance(scenario)
    savemat(path, content, do_compression=True, long_field_names=True)


def write_family(path: Path, family: LinearFamily, name: str) -> list[Path]:
    """Write a family as .json, .npz, .mat, or as a MATLAB script with its MAT-file; returns what was written.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    from engine import family_files

    made = {
        ".json": lambda: family_files.as_json(family, name),
        ".npz": lambda: family_files.as_npz(family),
        ".mat": lambda: family_files.as_mat(family),
        ".m": lambda: family_files.script(family, name, path.with_suffix(".mat").name).encode(),
    }
    written = [path.with_suffix(".mat"), path] if path.suffix.lower() == ".m" else [path]
    for file in written:
        with writing(file, LINEAR) as temporary:
            temporary.write_bytes(made[file.suffix.lower()]())
    return written


def write_linear(path: Path, linear: LinearModel, name: str, discrete: DiscreteModel | None = None) -> None:
    """Write a linear model, and the discrete-time one if given, as .json, .npz, .mat or a MATLAB script.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    from engine import linear_files

    with writing(path, LINEAR) as temporary:
        kind = path.suffix.lower()
        if kind == ".json":
            made = linear_files.as_json(linear, name, discrete)
        elif kind == ".npz":
            made = linear_files.as_npz(linear, discrete)
        elif kind == ".mat":
            made = linear_files.as_mat(linear, discrete)
        else:
            made = linear_files.script(linear, name, discrete).encode()
        temporary.write_bytes(made)
