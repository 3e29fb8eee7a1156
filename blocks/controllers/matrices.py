"""Matrices of linear controllers: given in the scenario, or read from a .json or .mat file, which runs no code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import ParameterError, nearest
from engine.ports import Expression, Port
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
    return _matrices(content(file))


def content(file: str) -> dict[str, Any]:
    """Everything in a file, by name; errors as of `read`."""
    path = Path(file)
    kind = path.suffix.lower()
    if kind not in (".json", ".mat"):
        raise ParameterError(f"'{file}' is not a .json or .mat file", remedy="save the matrices as one of these")
    try:
        return (read_json if kind == ".json" else read_mat)(path, LARGEST_FILE)
    except FileProblem as error:
        raise ParameterError(f"'{file}': {error.message}", remedy=error.remedy) from None


def _matrices(held: Mapping[str, Any]) -> dict[str, Matrix]:
    return {name: made for name, value in held.items() if (made := _numeric(value)) is not None}


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
        ParameterError: one is given in both places, is no matrix, or holds a number that is not finite; or the file
            holds none.
    """
    held = content(file) if file else {}
    read_in = _matrices(held)
    made: dict[str, Matrix] = {}
    for name in wanted:
        if name in held and held[name] is not None and name not in read_in:
            raise ParameterError(
                f"'{name}' in '{file}' is no matrix of numbers", remedy="give rows of numbers, such as [[1, 2], [3, 4]]"
            )
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


def system(found: Mapping[str, Matrix]) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """A (n by n), B (n by m), C (p by n) and D (p by m, zero if left out) of a linear system that fit each other.

    Args:
        found: as `collect` gives them; D alone is a gain without states.

    Raises:
        ParameterError: one is missing or does not fit the others.
    """
    n = len(found["A"]) if "A" in found and found["A"].size else 0
    if n and not ("B" in found and "C" in found):
        missing = "C" if "B" in found else "B"
        raise ParameterError(f"'{missing}' is missing", remedy="a system with A needs B and C")
    if not n and "D" not in found:
        raise ParameterError("no matrix is given", remedy="give A, B and C, or D, or a file")
    if "D" in found and found["D"].size:
        p, m = found["D"].shape
    else:
        b, c = found["B"], found["C"]
        p, m = c.shape[0] if c.shape[1] == n else 1, b.shape[1] if b.shape[0] == n else 1
    why = f"there are {n} states, {m} inputs and {p} outputs"
    return (
        shaped("A", found.get("A"), n, n, "A has as many columns as rows"),
        shaped("B", found.get("B") if n else None, n, m, why),
        shaped("C", found.get("C") if n else None, p, n, why),
        shaped("D", found.get("D"), p, m, why),
    )


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
