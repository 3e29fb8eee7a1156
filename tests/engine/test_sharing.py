"""A Jacobian by way of shared values is the Jacobian, in fewer numbers where several results depend on one another."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from engine.codegen import tangent_emitter
from engine.model import Model, Vector
from engine.ports import Expression
from engine.sharing import Jacobian, expressions
from scenarios.load import load, shipped_names


def _by_casadi(model: Model, parameters: tuple[int, ...], name: str) -> Expression:
    e = model.equations
    return ca.jacobian(getattr(e, name), ca.vertcat(e.x, e.t, e.u, e.d, *[e.p[i] for i in parameters]))


def _multiplied_out(jacobian: Jacobian, values: Vector) -> Vector:
    """The Jacobian by the inputs alone: each row in turn, shared ones first."""
    width = jacobian.shared
    made: dict[int, Vector] = {}
    for row in jacobian.order:
        made[row] = np.zeros(width)
        for place, column, value in zip(jacobian.rows, jacobian.columns, values, strict=True):
            if place == row and column < width:
                made[row][column] += value
            elif place == row:
                made[row] += value * made[jacobian.height + column - width]
    return np.array([made[row] for row in range(jacobian.height)]).reshape(jacobian.height, width)


@pytest.mark.parametrize("name", shipped_names())
def test_the_jacobian_of_every_shipped_model(name: str) -> None:
    model = load(name).build(smooth_readings=True)  # as fits take it; a rounding has no derivative to compare with
    parameters = tuple(range(min(9, len(model.parameters))))
    emitter, jacobians = tangent_emitter(model, parameters)
    e, jacobian = model.equations, jacobians["derivative"]
    arguments = [*e.arguments, e.fire]
    expected = _by_casadi(model, parameters, "derivative")
    assert len(jacobian.rows) <= expected.nnz()
    random = np.random.default_rng(0)
    given = [model.parameter_values if symbol is e.p else random.normal(0, 0.3, symbol.numel()) for symbol in arguments]
    given[4] = random.integers(-1, 2, e.m.numel()).astype(float)
    inputs = dict(zip(("t", "x", "u", "d", "m", "p", "fire"), arguments, strict=True))
    numbers = expressions(emitter, emitter.functions["derivative_values"], inputs, {})[0]
    values = np.array(ca.Function("v", arguments, [ca.vertcat(ca.SX(0, 1), *numbers)])(*given)).ravel()
    dense = np.array(ca.Function("j", arguments, [ca.densify(expected)])(*given))
    found = _multiplied_out(jacobian, values)
    assert np.abs(found - dense).max(initial=0) <= 1e-9 * np.abs(dense).max(initial=1)


def test_modes_of_a_link_share_the_acceleration_of_its_hub() -> None:
    model = load("reference-b").build()
    jacobian = tangent_emitter(model, ())[1]["derivative"]
    whole = _by_casadi(model, (), "derivative").nnz()
    assert max(jacobian.rows) >= jacobian.height
    assert len(jacobian.rows) < 0.65 * whole
