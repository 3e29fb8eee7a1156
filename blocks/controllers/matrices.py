"""Matrices of linear controllers: given in the scenario, or read from a .json or .mat file, which runs no code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import ParameterError, nearest
from engine.ports import Expression, Port
from engine.quantity import coherent
from engine.readers.matlab import read_mat
from engine.readers.objects import read_json
from engine.readers.regular import FileProblem, shown

Matrix = NDArray[np.float64]
Rows = Sequence[Sequence[float]]

LARGEST_FILE = 20_000_000
"""Bytes."""


def read(file: str) -> dict[str, Matrix]:
    """Every numeric matrix of a file by name: keys of a JSON object, or variables of a MATLAB file.

    Raises:
        ParameterError: no such file, another kind of file, or not what its name says.
    """
    return {name: made for name, value in _content(file).items() if (made := _numeric(value)) is not None}


def _content(file: str) -> dict[str, Any]:
    path = Path(file)
    kind = path.suffix.lower()
    if kind not in (".json", ".mat"):
        raise ParameterError(f"'{file}' is not a .json or .mat file", remedy="save the matrices as one of these")
    try:
        return (read_json if kind == ".json" else read_mat)(path, LARGEST_FILE)
    except FileProblem as error:
        raise ParameterError(f"'{file}': {error.message}", remedy=error.remedy) from None


@dataclass(frozen=True)
class Labels:
    """Signals that a design file names, each with its coherent SI unit, ``*`` where it tells none.

    Attributes:
        states, inputs, outputs: (name, unit) in the order of the matrices; empty where the file has no names.
    """

    states: tuple[tuple[str, str], ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    outputs: tuple[tuple[str, str], ...] = ()

    def fitting(self, key: str, count: int, file: str) -> tuple[tuple[str, str], ...]:
        """The names of one kind, or as many without a name where the file has none.

        Raises:
            ParameterError: the file has another number of names.
        """
        named: tuple[tuple[str, str], ...] = getattr(self, key)
        if named and len(named) != count:
            raise ParameterError(
                f"'{file}' names {len(named)} {key}, and its matrices have {count}",
                remedy=f"give as many names as there are {key}, or leave '{key}' out of the file",
            )
        return named or (("", "*"),) * count


def labels(file: str) -> Labels:
    """What a design file says of its signals: ``states``, ``inputs`` and ``outputs``, and their ``units``.

    Files of `flexarm.design.save` and of ``flexarm linearise`` have them; others need not.

    Raises:
        ParameterError: as `read`, or a unit that is not coherent SI, in which all matrices are.
    """
    if not file:
        return Labels()
    content = _content(file)
    by_name = content.get("units")
    made: dict[str, tuple[tuple[str, str], ...]] = {}
    for key in ("states", "inputs", "outputs"):
        names = _texts(content.get(key))
        units = dict(zip(names, _texts(content.get(f"{key[:-1]}_units")), strict=False))
        if isinstance(by_name, dict):
            units |= by_name
        made[key] = tuple((name, _unit(name, units.get(name), file)) for name in names)
    return Labels(**made)


def _texts(value: Any) -> list[str]:
    items = np.ravel(np.array(value, dtype=object)).tolist() if isinstance(value, list | np.ndarray) else [value]
    return items if all(isinstance(item, str) for item in items) else []


def _unit(name: str, given: Any, file: str) -> str:
    if not isinstance(given, str) or not given:
        return "*"
    try:
        scale, unit = coherent(given)
    except ParameterError as error:
        raise ParameterError(f"'{file}': unit of '{name}': {error.message}", remedy=error.remedy) from None
    if scale != 1:
        raise ParameterError(f"'{file}': '{name}' is in {given}", remedy=f"matrices are in SI units: {unit}")
    return unit


def _numeric(value: Any) -> Matrix | None:
    """A value as a matrix, None if it is something else."""
    try:
        made = np.array(value, ndmin=2)
    except ValueError:
        return None
    return made.astype(float) if made.ndim == 2 and made.dtype.kind in "iuf" else None


def collect(given: Mapping[str, Rows], file: str, wanted: Iterable[str]) -> dict[str, Matrix]:
    """The wanted matrices: those given, and the rest from the file, if one is named.

    Raises:
        ParameterError: one is given in both places, is missing, or holds a number that is not finite.
    """
    read_in = read(file) if file else {}
    made: dict[str, Matrix] = {}
    for name in wanted:
        here, there = bool(given.get(name)), name in read_in
        if here and there:
            raise ParameterError(f"'{name}' is given, and in '{file}' too", remedy="keep one of them")
        if here or there:
            made[name] = np.array(given[name], dtype=float, ndmin=2) if here else read_in[name]
            if not np.isfinite(made[name]).all():
                raise ParameterError(f"'{name}' holds a number that is not finite", remedy="give finite numbers alone")
    if file and not made.keys() - {"dt"}:
        found = nearest("", map(shown, read_in)) if read_in else "it holds no matrices"
        raise ParameterError(
            f"'{file}' holds none of {', '.join(name for name in wanted if name != 'dt')}", remedy=found
        )
    return made


def shaped(name: str, matrix: Matrix | None, rows: int, columns: int, why: str) -> Matrix:
    """The matrix in a given shape; zeros for None; a single row stands for a column where one is wanted.

    Raises:
        ParameterError: it has another shape.
    """
    if matrix is None or (matrix.size == 0 and rows * columns == 0):
        return np.zeros((rows, columns))
    if matrix.shape == (1, rows) and columns == 1:
        matrix = matrix.T
    if matrix.shape != (rows, columns):
        got = f"{matrix.shape[0]} by {matrix.shape[1]}"
        raise ParameterError(f"{name} is {got}, not {rows} by {columns}", remedy=why)
    return matrix


def times(matrix: Matrix, vector: Sequence[Expression]) -> list[Expression]:
    """``matrix @ vector`` without the products with zero, which would be dependencies."""
    return [sum((float(c) * x for c, x in zip(row, vector, strict=True) if c), 0.0) for row in matrix]


def numbered(role: str, name: str, count: int, doc: str, carried: Sequence[tuple[str, str]] = ()) -> list[Port]:
    """Ports ``name1``, ``name2``, ... , or ``name`` alone where there is one; ``carried``: name and unit of each."""
    names = [name] if count == 1 else [f"{name}{k + 1}" for k in range(count)]
    made = []
    for k, n in enumerate(names):
        what, unit = carried[k] if carried else ("", "*")
        text = doc if count == 1 else f"{doc}, element {k + 1}"
        made.append(Port(n, role, f"{text}: {what}" if what else text, "", unit, None, carries=what))
    return made


def stated_period(matrices: Mapping[str, Matrix]) -> float | None:
    """``dt`` of a file (s), 0 for a continuous system; None where the file does not say.

    Raises:
        ParameterError: it is no time.
    """
    stated = matrices.get("dt")
    if stated is None:
        return None
    if not (stated.size == 1 and 0 <= stated.item() < math.inf):
        what = f"{stated.item():g}" if stated.size == 1 else f"{stated.shape[0]} by {stated.shape[1]} numbers"
        raise ParameterError(f"'dt' of the file is {what}", remedy="it is the sample period, one number of seconds")
    return stated.item()


def same_period(given: float | None, matrices: Mapping[str, Matrix], file: str) -> float:
    """The sample period (s) of a block that may be continuous (0): the one given, or ``dt`` of its file.

    Args:
        given: None where the scenario gives none.
        matrices: of the file.
        file: its name.

    Raises:
        ParameterError: both, and different: the matrices are those of another period.
    """
    stated = stated_period(matrices)
    if given is None or stated is None:
        return given or stated or 0.0
    if not math.isclose(given, stated, rel_tol=1e-9):
        made = f"sampled every {stated:g} s" if stated else "continuous"
        raise ParameterError(
            f"period = {given:g} s, but the matrices of '{file}' are {made} (dt = {stated:g})",
            remedy=f"design for a period of {given:g} s, or leave the period out" if given else "leave the period out",
        )
    return given


def period_of(given: float, matrices: Mapping[str, Matrix]) -> float:
    """The sample period (s) of a block that is sampled: the one given, or ``dt`` of the file.

    Raises:
        ParameterError: neither, or both and different.
    """
    found = stated_period(matrices) or 0.0
    if given and found and not math.isclose(given, found, rel_tol=1e-9):
        raise ParameterError(f"period = {given:g} s, but the file says dt = {found:g} s", remedy="leave the period out")
    if not (given or found > 0):
        raise ParameterError("no sample period is given", remedy="give period, or dt in the file")
    return given or found
