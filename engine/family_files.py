"""A family of linear models as a file: JSON, NumPy archive, MAT-file, and a MATLAB script that makes an LPV model."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np

from engine.family import LinearFamily
from engine.files import json_text
from engine.names import identifier

_MAT_TEXT = b"MATLAB 5.0 MAT-file, written by flexarm"
_ARRAYS = ("A", "B", "C", "D", "x0", "u0", "y0", "dx0")


def as_json(family: LinearFamily, name: str = "") -> bytes:
    """Arrays with the axes first, and everything by name."""
    made: dict[str, Any] = {"name": name} if name else {}
    made["axes"] = [
        {
            "name": a.name,
            "unit": a.unit,
            "values": a.values.tolist(),
            **({"labels": list(a.labels)} if a.labels else {}),
        }
        for a in family.axes
    ]
    made |= {key: getattr(family, key).tolist() for key in _ARRAYS}
    made |= {"states": list(family.states), "inputs": list(family.inputs), "outputs": list(family.outputs)}
    made |= {"units": family.units, "modes": list(family.modes), "assumed": list(family.assumed)}
    if family.parameters:
        made["parameters"] = list(family.parameters)
    return (json_text(made, indent=1) + "\n").encode()


def as_npz(family: LinearFamily) -> bytes:
    """Arrays by name, without pickles; axes as ``axis_names``, ``axis_units`` and ``axis0``, ``axis1``, ..."""
    arrays: dict[str, Any] = {key: getattr(family, key) for key in _ARRAYS}
    arrays |= {f"axis{i}": axis.values for i, axis in enumerate(family.axes)}
    arrays["axis_names"] = np.array([axis.name for axis in family.axes], dtype=str)
    arrays["axis_units"] = np.array([axis.unit for axis in family.axes], dtype=str)
    for key in ("states", "inputs", "outputs"):
        arrays[key] = np.array(getattr(family, key), dtype=str)
    arrays["modes"] = _labels(family).astype(str)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, value in arrays.items():
            one = io.BytesIO()
            np.save(one, np.asarray(value), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{key}.npy", (1980, 1, 1, 0, 0, 0)), one.getvalue())
    return buffer.getvalue()


def _labels(family: LinearFamily) -> Any:
    made = np.empty(len(family), dtype=object)
    made[:] = [", ".join(f"{k} {v}" for k, v in modes.items()) or "-" for modes in family.modes]
    return made.reshape(family.shape)


def fields(family: LinearFamily) -> list[str]:
    """A MATLAB name for each axis, all different."""
    found: list[str] = []
    for axis in family.axes:
        name = identifier(axis.name)
        while name in found:
            name += "_"
        found.append(name)
    return found


def as_mat(family: LinearFamily) -> bytes:
    """For MATLAB: matrices as n x n x grid, offsets as n x 1 x grid, the sampling grid as a struct of full arrays."""
    from scipy.io import savemat

    g = len(family.axes)
    made: dict[str, Any] = {}
    for key in _ARRAYS:
        array = getattr(family, key)
        array = array if array.ndim == g + 2 else array[..., None]
        made[key] = np.moveaxis(array, (-2, -1), (0, 1))
    full = np.meshgrid(*(axis.values for axis in family.axes), indexing="ij")
    # MATLAB has no arrays of one dimension: a grid of one axis is a column.
    grids = [values[:, None] if g == 1 else values for values in full]
    made["sampling_grid"] = dict(zip(fields(family), grids, strict=True))
    made["axes"] = {
        name: {"name": axis.name, "unit": axis.unit, "values": axis.values[:, None]}
        for name, axis in zip(fields(family), family.axes, strict=True)
    }
    for key in ("states", "inputs", "outputs"):
        names = getattr(family, key)
        made[key] = np.array(names, dtype=object)[:, None]
        units = [family.units.get(name, "") for name in names]
        made[f"{key[:-1]}_units"] = np.array(units, dtype=object)[:, None]
    made["modes"] = _labels(family)[:, None] if g == 1 else _labels(family)
    buffer = io.BytesIO()
    savemat(buffer, made, long_field_names=True)
    return _MAT_TEXT.ljust(116) + buffer.getvalue()[116:]


def script(family: LinearFamily, name: str, data: str) -> str:
    """A MATLAB script that reads ``data`` (the MAT-file) and makes the array, its offsets and an LPV model."""
    plain = identifier(name)
    size = " x ".join(str(k) for k in family.shape)
    axes = ", ".join(f"{axis.name} [{axis.unit}]" if axis.unit else axis.name for axis in family.axes)
    n, r, m = len(family.states), len(family.inputs), len(family.outputs)
    lines = [
        f"% {name}: a family of {size} linear models over {axes}, by flexarm",
        "%   dx/dt = dx0 + A (x - x0) + B (u - u0),  y = y0 + C (x - x0) + D (u - u0)",
        f"% Reads {data}, which holds",
        f"%   A, B, C, D     {n} x {n}, {n} x {r}, {m} x {n}, {m} x {r}, by the size of the grid",
        f"%   x0, u0, y0, dx0  offsets, {n} x 1, {r} x 1, {m} x 1, {n} x 1, by the size of the grid",
        "%   sampling_grid  struct: each scheduling variable at every point of the grid",
        "%   axes           struct: name, unit and values of each",
        "%   states, inputs, outputs, *_units, modes  names, units, and the modes each member was linearised in",
        "% In the LPV System block of Simulink (Control System Toolbox): State-space array",
        f"% {plain}_family; Input offset, Output offset, State offset and State derivative offset {plain}_data.u0,",
        f"% .y0, .x0 and .dx0; Parameter: {', '.join(fields(family))}, in this order.",
        f"{plain}_data = load('{data}');",
        f"{plain}_family = ss({plain}_data.A, {plain}_data.B, {plain}_data.C, {plain}_data.D);",
        f"{plain}_family.SamplingGrid = {plain}_data.sampling_grid;",
    ]
    lines += [
        f"{plain}_family.{prefix}Name = cellstr({plain}_data.{key});"
        for key, prefix in (("states", "State"), ("inputs", "Input"), ("outputs", "Output"))
        if getattr(family, key)
    ]
    lines += [
        "% The same as a gridded LPV model, from release R2023a on.",
        "if exist('ssInterpolant', 'file')",
        f"    offsets = struct('x', num2cell({plain}_data.x0, [1 2]), 'u', num2cell({plain}_data.u0, [1 2]), ...",
        f"        'y', num2cell({plain}_data.y0, [1 2]), 'dx', num2cell({plain}_data.dx0, [1 2]));",
        f"    offsets = reshape(offsets, size({plain}_data.sampling_grid.{fields(family)[0]}));",
        f"    {plain}_lpv = ssInterpolant({plain}_family, offsets);",
        "end",
    ]
    return "\n".join(lines) + "\n"
