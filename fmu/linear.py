"""The linear model of an FMU: as files in the archive and beside it, and as a twin inside the FMU."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from engine.discretise import DiscreteModel
from engine.errors import FlexarmError
from engine.linear_files import as_json, as_mat
from engine.linearise import LinearModel
from engine.model import TIME, Model, Variable, Vector
from engine.start import start_values


def linear_files(linear: LinearModel, discrete: DiscreteModel | None = None) -> dict[str, bytes]:
    """``resources/linear.json`` and ``resources/linear.mat`` of an archive."""
    return {
        "resources/linear.json": as_json(linear, discrete=discrete),
        "resources/linear.mat": as_mat(linear, discrete),
    }


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
