"""Writing results: every file is made beside its target under another name and then moved, so none is half-written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from engine import linear_files
from engine.files import writing
from engine.linear_files import KINDS as LINEAR
from engine.result_files import TABLES, write
from flexarm._version import version

if TYPE_CHECKING:
    from engine.discretise import DiscreteModel
    from engine.family import LinearFamily
    from engine.linearise import LinearModel
    from engine.simulate import Result
    from scenarios.load import Scenario


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
    write(path, result, provenance(scenario))


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
    linear_files.write(path, linear, name, discrete)


__all__ = ["LINEAR", "TABLES", "provenance", "write_family", "write_linear", "write_result"]
