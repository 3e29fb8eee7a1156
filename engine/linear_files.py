"""A linear model as a file: JSON, NumPy archive, MAT-file, and a script for MATLAB or Octave."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.files import json_text, writing
from engine.names import identifier

Matrix = NDArray[np.float64]
LinearModel = Any
"""`engine.linearise.LinearModel`, which saves itself by this module and so is not imported here."""

KINDS = (".json", ".npz", ".mat", ".m")

_MAT_TEXT = b"MATLAB 5.0 MAT-file, written by flexarm"
_NAMES = ("states", "inputs", "outputs")


def write(path: Path, linear: LinearModel, name: str = "", discrete: LinearModel | None = None) -> None:
    """Write a linear model, and the discrete-time one if given, as .json, .npz, .mat or a MATLAB script.

    Raises:
        FlexarmError: an unknown kind of file, or it cannot be written.
    """
    with writing(path, KINDS) as temporary:
        kind = path.suffix.lower()
        if kind == ".json":
            made = as_json(linear, name, discrete)
        elif kind == ".npz":
            made = as_npz(linear, discrete)
        elif kind == ".mat":
            made = as_mat(linear, discrete)
        else:
            made = script(linear, name or path.stem, discrete).encode()
        temporary.write_bytes(made)


def content(linear: LinearModel) -> dict[str, Any]:
    """Matrices, names, units, modes, operating point and its check, poles and zeros, as plain lists and texts."""
    made: dict[str, Any] = {key: getattr(linear, key).tolist() for key in "ABCD"}
    if hasattr(linear, "dt"):
        made["dt"] = linear.dt
    made |= {key: list(getattr(linear, key)) for key in _NAMES}
    made |= {"units": linear.units, "modes": linear.modes, "assumed": list(linear.assumed), "point": linear.point}
    made |= {"equilibrium": not linear.moving, "moving": linear.moving}
    zeros: Iterable[complex] = linear.zeros() if linear.inputs and linear.outputs else []
    return made | {"poles": _pairs(linear.poles()), "zeros": _pairs(zeros)}


def _pairs(roots: Iterable[complex]) -> list[list[float]]:
    return [[float(root.real), float(root.imag)] for root in roots]


def as_json(linear: LinearModel, name: str = "", discrete: LinearModel | None = None) -> bytes:
    """Everything of `content`; the discrete-time model under ``discrete``."""
    made = ({"name": name} if name else {}) | content(linear)
    if discrete is not None:
        made["discrete"] = content(discrete)
    return (json_text(made, indent=1) + "\n").encode()


def as_npz(linear: LinearModel, discrete: LinearModel | None = None) -> bytes:
    """Arrays by name, without pickles; those of the discrete-time model as ``discrete_A``, ``discrete_dt``, ..."""
    arrays: dict[str, Any] = {}
    for prefix, model in (("", linear), ("discrete_", discrete)):
        if model is not None:
            arrays |= {f"{prefix}{key}": value for key, value in _arrays(model).items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, value in arrays.items():
            one = io.BytesIO()
            np.save(one, np.asarray(value), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{key}.npy", (1980, 1, 1, 0, 0, 0)), one.getvalue())
    return buffer.getvalue()


def _arrays(linear: LinearModel) -> dict[str, Any]:
    made: dict[str, Any] = {key: getattr(linear, key) for key in "ABCD"}
    for key in _NAMES:
        names = getattr(linear, key)
        made[key] = np.array(names, dtype=str)
        made[f"{key[:-1]}_units"] = np.array([linear.units.get(name, "") for name in names], dtype=str)
    made["modes"] = np.array(list(linear.modes.items()), dtype=str).reshape(-1, 2)
    made["point_names"] = np.array(list(linear.point), dtype=str)
    made["point"] = np.array(list(linear.point.values()), dtype=float)
    made["poles"] = linear.poles()
    made["zeros"] = linear.zeros() if linear.inputs and linear.outputs else np.zeros(0, dtype=complex)
    if hasattr(linear, "dt"):
        made["dt"] = linear.dt
    return made


def as_mat(linear: LinearModel, discrete: LinearModel | None = None) -> bytes:
    """The same for MATLAB, texts as cells, with a fixed header in place of the date; ``discrete`` is a struct."""
    from scipy.io import savemat

    made = _cells(linear)
    if discrete is not None:
        made["discrete"] = _cells(discrete)
    buffer = io.BytesIO()
    savemat(buffer, made, long_field_names=True)
    return _MAT_TEXT.ljust(116) + buffer.getvalue()[116:]


def _cells(linear: LinearModel) -> dict[str, Any]:
    return {
        key: value.astype(object) if isinstance(value, np.ndarray) and value.dtype.kind == "U" else value
        for key, value in _arrays(linear).items()
    }


def script(linear: LinearModel, name: str, discrete: LinearModel | None = None) -> str:
    """A MATLAB or Octave script that needs no other file: ``NAME_linear``, a named ``ss``, and ``NAME_discrete``."""
    lines = [
        f"% {name}: linear model by flexarm, for deviations from the operating point; x' = A x + B u, y = C x + D u"
    ]
    lines += [f"% mode {mode}: {label}" for mode, label in linear.modes.items()]
    lines += [f"% assumed: {text}" for text in linear.assumed]
    lines += [f"% {state} = {value!r} {linear.units.get(state, '')}".rstrip() for state, value in linear.point.items()]
    lines += [f"% not an equilibrium: {state} changes at {rate!r} per second" for state, rate in linear.moving.items()]
    lines += _system(linear, f"{identifier(name)}_linear", "")
    if discrete is not None:
        lines += ["", "% in discrete time, memories of the sampled blocks included; input held between instants"]
        lines += _system(discrete, f"{identifier(name)}_discrete", f", {discrete.dt!r}")
    return "\n".join(lines) + "\n"


def _system(linear: LinearModel, variable: str, period: str) -> list[str]:
    matrices = ", ".join(_matrix(getattr(linear, key)) for key in "ABCD")
    lines = [f"{variable} = ss({matrices}{period});"]
    for key, prefix in (("states", "State"), ("inputs", "Input"), ("outputs", "Output")):
        names = getattr(linear, key)
        lines.append(f"{variable}.{prefix}Name = {_cell(names)};")
        units = _cell([linear.units.get(n, "") for n in names])
        lines.append(f"if isprop({variable}, '{prefix}Unit'), {variable}.{prefix}Unit = {units}; end")
    return lines


def _matrix(values: Matrix) -> str:
    if 0 in values.shape:
        return f"zeros({values.shape[0]}, {values.shape[1]})"
    return "[" + "; ".join(" ".join(repr(float(v)) for v in row) for row in values) + "]"


def _cell(names: Sequence[str]) -> str:
    return "{" + ", ".join("'" + n.replace("'", "''") + "'" for n in names) + "}"
