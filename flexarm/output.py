"""Writing results: every file is made beside its target under another name and then moved, so none is half-written."""

from __future__ import annotations

import csv
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.errors import FlexarmError

if TYPE_CHECKING:
    from engine.linearise import LinearModel
    from engine.simulate import Result
    from scenarios.load import Scenario

TABLES = (".csv", ".parquet", ".mat")
LINEAR = (".json", ".npz", ".mat", ".m")


def check_suffix(path: Path, allowed: Sequence[str]) -> None:
    """Refuse a file name whose kind cannot be written, or whose folder does not exist.

    Raises:
        FlexarmError: so, before any work is done.
    """
    if path.suffix.lower() not in allowed:
        raise FlexarmError(f"'{path}' is of no kind that can be written here", remedy=f"end it in {', '.join(allowed)}")
    if not path.parent.is_dir():
        raise FlexarmError(f"there is no folder '{path.parent}'", remedy="make it first, or write somewhere else")
    if path.is_dir():
        raise FlexarmError(f"'{path}' is a folder", remedy="give a file name")


@contextmanager
def writing(path: Path, allowed: Sequence[str]) -> Iterator[Path]:
    """A temporary file in the same folder that becomes ``path`` if the block ends well, and vanishes if not.

    Raises:
        FlexarmError: the file cannot be written.
    """
    check_suffix(path, allowed)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror}") from error
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise FlexarmError(f"cannot write '{path}': {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def provenance(scenario: Scenario) -> dict[str, str]:
    """What made a result: scenario, its content hash, overrides and versions."""
    from importlib.metadata import version

    import flexarm

    return {
        "scenario": scenario.name,
        "file": str(scenario.path),
        "scenario_hash": scenario.digest,
        "overrides": " ".join(scenario.overrides),
        "flexarm": flexarm.version(),
        "casadi": version("casadi"),
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
    metadata = {**(table.schema.metadata or {}), b"flexarm": json.dumps(described).encode()}
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


def write_linear(path: Path, linear: LinearModel, name: str) -> None:
    """Write a linear model as .json, .npz, .mat or a MATLAB script.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    with writing(path, LINEAR) as temporary:
        kind = path.suffix.lower()
        matrices = {"A": linear.A, "B": linear.B, "C": linear.C, "D": linear.D}
        units = [[linear.units.get(n, "") for n in names] for names in (linear.states, linear.inputs, linear.outputs)]
        if kind == ".json":
            content: dict[str, Any] = {"name": name, **{key: matrix.tolist() for key, matrix in matrices.items()}}
            content |= {"states": linear.states, "inputs": linear.inputs, "outputs": linear.outputs}
            content |= {"units": linear.units, "modes": linear.modes, "point": linear.point}
            for key, roots in (("poles", linear.poles()), ("zeros", linear.zeros())):
                content[key] = [[root.real, root.imag] for root in roots]
            temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        elif kind == ".npz":
            names = {key: np.array(getattr(linear, key)) for key in ("states", "inputs", "outputs")}
            with temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **matrices, **names, poles=linear.poles(), zeros=linear.zeros())
        elif kind == ".mat":
            from scipy.io import savemat

            cells: dict[str, Any] = {}
            for key, unit in zip(("states", "inputs", "outputs"), units, strict=True):
                cells[key] = np.array(getattr(linear, key), dtype=object)
                cells[f"{key[:-1]}_units"] = np.array(unit, dtype=object)
            savemat(temporary, {**matrices, **cells}, long_field_names=True)
        else:
            temporary.write_text(_script(linear, name), encoding="utf-8")


def _script(linear: LinearModel, name: str) -> str:
    """A MATLAB script that makes a named state-space model."""

    def matrix(values: Any) -> str:
        return "[" + "; ".join(" ".join(f"{v:.17g}" for v in row) for row in np.atleast_2d(values)) + "]"

    def cell(names: Sequence[str]) -> str:
        return "{" + ", ".join(f"'{n}'" for n in names) + "}"

    variable = flat_names([name])[0]
    n, r, m = len(linear.states), len(linear.inputs), len(linear.outputs)
    lines = [f"% {name}: linear model by flexarm; x' = A x + B u, y = C x + D u"]
    lines += [f"% mode {mode}: {label}" for mode, label in linear.modes.items()]
    for key, values, shape in (("A", linear.A, (n, n)), ("B", linear.B, (n, r)), ("C", linear.C, (m, n))):
        lines.append(f"{key} = {matrix(values) if 0 not in shape else f'zeros({shape[0]}, {shape[1]})'};")
    lines.append(f"D = {matrix(linear.D)};")
    lines.append(
        f"{variable} = ss(A, B, C, D, 'StateName', {cell(linear.states)}, 'InputName', {cell(linear.inputs)}, "
        f"'OutputName', {cell(linear.outputs)});"
    )
    units = ((linear.states, "StateUnit"), (linear.inputs, "InputUnit"), (linear.outputs, "OutputUnit"))
    lines += [f"{variable}.{key} = {cell([linear.units.get(v, '') for v in names])};" for names, key in units]
    return "\n".join(lines) + "\n"
