"""The linear model that travels with an FMU: files inside and beside it, and a twin that runs along."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from engine.errors import FlexarmError
from engine.linearise import LinearModel
from engine.model import TIME, Model, Variable, Vector
from fmu.variables import flat

_MAT_TEXT = b"MATLAB 5.0 MAT-file, written by flexarm"


def linear_files(linear: LinearModel) -> dict[str, bytes]:
    """``resources/linear.json`` and ``resources/linear.mat`` of an archive."""
    return {"resources/linear.json": as_json(linear), "resources/linear.mat": as_mat(linear)}


def as_json(linear: LinearModel) -> bytes:
    """Matrices, names, units, modes and the operating point."""
    content: dict[str, Any] = {key: getattr(linear, key).tolist() for key in "ABCD"}
    content |= {"states": linear.states, "inputs": linear.inputs, "outputs": linear.outputs}
    content |= {"units": linear.units, "modes": linear.modes, "point": linear.point}
    return (json.dumps(content, indent=1) + "\n").encode()


def as_mat(linear: LinearModel) -> bytes:
    """The same for MATLAB, with a fixed header in place of the date."""
    from scipy.io import savemat

    content: dict[str, Any] = {key: getattr(linear, key) for key in "ABCD"}
    for key in ("states", "inputs", "outputs"):
        names = getattr(linear, key)
        content[key] = np.array(names, dtype=object)
        content[f"{key[:-1]}_units"] = np.array([linear.units.get(name, "") for name in names], dtype=object)
    buffer = io.BytesIO()
    savemat(buffer, content, long_field_names=True)
    return _MAT_TEXT.ljust(116) + buffer.getvalue()[116:]


def script(linear: LinearModel, name: str) -> str:
    """A MATLAB or Octave script that builds the named ``ss`` object from ``NAME_linear.mat`` beside it."""

    def cell(names: tuple[str, ...]) -> str:
        return "{" + ", ".join("'" + n.replace("'", "''") + "'" for n in names) + "}"

    variable = f"{flat(name)}_linear"
    lines = [f"% {name}: x' = A x + B u, y = C x + D u for deviations from the operating point; by flexarm"]
    lines += [f"% mode {mode}: {label}" for mode, label in linear.modes.items()]
    lines += [f"% {state} = {linear.point[state]!r}" for state in linear.states]
    lines += [
        f"flexarm_data = load(fullfile(fileparts(mfilename('fullpath')), '{name}_linear.mat'));",
        f"{variable} = ss(flexarm_data.A, flexarm_data.B, flexarm_data.C, flexarm_data.D);",
        "clear flexarm_data",
    ]
    for key, property_name in (("states", "State"), ("inputs", "Input"), ("outputs", "Output")):
        names = getattr(linear, key)
        lines.append(f"{variable}.{property_name}Name = {cell(names)};")
        units = cell(tuple(linear.units.get(n, "") for n in names))
        lines.append(f"if isprop({variable}, '{property_name}Unit'), {variable}.{property_name}Unit = {units}; end")
    return "\n".join(lines) + "\n"


def with_twin(model: Model, linear: LinearModel, inputs: Vector | None = None) -> Model:
    """The model with its linear model beside it, driven by the same inputs.

    Args:
        model: the model.
        linear: linearised from it, with all its inputs and outputs.
        inputs: inputs at the operating point; zero if None.

    Returns:
        A model whose further outputs ``NAME_lin`` are y0 + C dx + D du.

    Raises:
        FlexarmError: the linear model has other inputs or outputs.
    """
    for kind in ("inputs", "outputs"):
        if list(getattr(linear, kind)) != [variable.name for variable in getattr(model, kind)]:
            raise FlexarmError(
                f"the linear model's {kind} are not those of the model",
                remedy="linearise the model that is exported, with all its inputs and outputs",
            )
    e, n = model.equations, len(linear.states)
    u0 = np.zeros(len(model.inputs)) if inputs is None else np.asarray(inputs, dtype=float)
    dx, du = ca.SX.sym("linear", n), e.u[: len(model.inputs)] - ca.DM(u0)
    units = {variable.name: variable.unit for variable in model.states}
    equations = replace(
        e,
        x=ca.densify(ca.vertcat(e.x, dx)),
        derivative=ca.densify(ca.vertcat(e.derivative, _times(linear.A, dx) + _times(linear.B, du))),
        outputs=ca.densify(
            ca.vertcat(e.outputs, _outputs_at(model, linear, u0) + _times(linear.C, dx) + _times(linear.D, du))
        ),
        start=ca.densify(ca.vertcat(e.start, ca.SX.zeros(n))),
    )
    return replace(
        model,
        equations=equations,
        states=(
            *model.states,
            *(
                Variable(f"linear.{name}", units.get(name, ""), "deviation in the linear twin")
                for name in linear.states
            ),
        ),
        outputs=(
            *model.outputs,
            *(Variable(f"{y.name}_lin", y.unit, f"linear twin of {y.name}") for y in model.outputs),
        ),
    )


def _times(matrix: Any, column: Any) -> Any:
    return ca.mtimes(ca.SX(ca.sparsify(ca.DM(matrix))), column)


def _outputs_at(model: Model, linear: LinearModel, u0: Vector) -> Any:
    """The outputs at the operating point."""
    p = model.parameter_values
    x = [linear.point[state.name] for state in model.states]
    d = model.functions["memory_start"](p)
    u = np.concatenate([u0, [table.values[0] for table in model.tables]])
    m = [0.0 if mode.kind == TIME else float(mode.labels.index(linear.modes[mode.name]) - 1) for mode in model.modes]
    return model.functions["outputs"](0.0, x, u, d, m, p)
