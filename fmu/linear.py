"""The linear model that travels with an FMU: files, a twin that runs along, and the family of other modes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from engine.discretise import DiscreteModel
from engine.errors import FlexarmError
from engine.linear_files import as_json, as_mat, content
from engine.linear_modes import deaf
from engine.linearise import LinearModel
from engine.model import TIME, Model, Variable, Vector
from engine.start import start_values


def linear_files(
    linear: LinearModel, discrete: DiscreteModel | None = None, others: Sequence[LinearModel] = ()
) -> dict[str, bytes]:
    """``resources/linear.json`` and ``.mat`` of an archive, and ``linear_family.json`` if there are other modes."""
    made = {
        "resources/linear.json": as_json(linear, discrete=discrete),
        "resources/linear.mat": as_mat(linear, discrete),
    }
    return made | ({"resources/linear_family.json": family_file(linear, others)} if others else {})


def family_file(linear: LinearModel, others: Sequence[LinearModel]) -> bytes:
    """The linear models of all modes as JSON: a list, that of the operating point first."""
    return (json.dumps([content(member) for member in (linear, *others)], indent=1) + "\n").encode()


def warning(linear: LinearModel, others: Sequence[LinearModel]) -> str:
    """What is said at export of a linear model in which inputs move nothing, empty if all of them move something."""
    silent = deaf(linear)
    if not silent:
        return ""
    held = {name for other in others for name, label in other.modes.items() if linear.modes[name] != label}
    why = ", ".join(f"'{name}' is {label}" for name, label in linear.modes.items() if not held or name in held)
    text = f"the linear model is a zero system for {', '.join(silent)}, which moves no output at the operating point"
    text += f": {why}" if why else ""
    if not others:
        return text
    choices = dict.fromkeys(
        f'--mode {name}="{label}"'
        for other in others
        for name, label in other.modes.items()
        if name in held and label != linear.modes[name]
    )
    return f"{text}; linear_family.json holds the other modes; for one of them give {' or '.join(choices)}"


def with_twin(model: Model, linear: LinearModel) -> Model:
    """The model with its linear model beside it, driven by the same inputs.

    Args:
        model: the model.
        linear: linearised from it, with all its inputs and outputs.

    Returns:
        A model whose further outputs ``NAME_lin`` are y0 + C dx + D du, with dx starting at the difference between
        the model's initial state and the operating point.

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
    u0 = np.array([linear.point.get(variable.name, 0.0) for variable in model.inputs])
    begun = dict(zip((state.name for state in model.states), start_values(model, model.parameter_values), strict=True))
    dx0 = [float(begun[name]) - linear.point[name] for name in linear.states]
    dx, du = ca.SX.sym("linear", n), e.u[: len(model.inputs)] - ca.DM(u0)
    units = {variable.name: variable.unit for variable in model.states}
    equations = replace(
        e,
        x=ca.densify(ca.vertcat(e.x, dx)),
        derivative=ca.densify(ca.vertcat(e.derivative, _times(linear.A, dx) + _times(linear.B, du))),
        outputs=ca.densify(
            ca.vertcat(e.outputs, _outputs_at(model, linear, u0) + _times(linear.C, dx) + _times(linear.D, du))
        ),
        start=ca.densify(ca.vertcat(e.start, ca.SX(ca.DM(dx0)))),
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
