"""Directional derivatives and ModelStructure: against differences, the linear model, and values."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model

from engine.linearise import linearise
from engine.model import Model
from fmu.twists import twists
from fmu.verify import reference, references, slave

each_model = pytest.mark.parametrize("name", ["smooth_model", "switching_model"])


def _moving(instance: Any, description: Any, level: float = 2.0, steps: int = 150) -> None:
    """Bring an instance to a point off the grid where everything moves."""
    u = references(description, "input")
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.setReal(u, [level] * len(u))
    instance.exitInitializationMode()
    for k in range(steps):
        instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
    instance.doStep(currentCommunicationPoint=steps * 1e-3, communicationStepSize=0.4e-3)


def _matrix(instance: Any, unknowns: list[int], knowns: list[int]) -> np.ndarray:
    columns = [instance.getDirectionalDerivative(unknowns, [known], [1.0]) for known in knowns]
    return np.array(columns).T.reshape(len(unknowns), len(knowns))


def _states(description: Any) -> tuple[list[int], list[int]]:
    rates = [v for v in description.modelVariables if v.derivative is not None]
    return [v.derivative.valueReference for v in rates], [v.valueReference for v in rates]


@each_model
def test_columns_are_the_linear_model(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    model: Model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        _moving(instance, description)
        states, rates = _states(description)
        u, y = references(description, "input"), references(description, "output")
        names = [state.name for state in model.states]
        point = {name: instance.getReal([reference(description, name)])[0] for name in names}
        shown = _shown(model)
        given = np.block(
            [
                [_matrix(instance, rates, states), _matrix(instance, rates, u)],
                [_matrix(instance, y, states), _matrix(instance, y, u)],
            ]
        )
        if model.memories:
            held = [v.valueReference for v in description.modelVariables if v.variability == "discrete"]
            held = [h for h in held if h not in references(description, "input")]
            d = instance.getReal(held[: len(model.memories)])
            m = instance.getInteger(held[len(model.memories) :])
            x = list(point.values())
            # Modes and memories at the point are the FMU's, so the Jacobian is taken there and not at rest.
            q = model.equations
            jacobian = ca.jacobian(ca.vertcat(q.derivative, q.outputs), ca.vertcat(q.x, q.u))
            linear = ca.Function("j", q.arguments, [ca.densify(jacobian)])
            expected = linear(0.1504, x, [2.0], d, m, model.parameter_values).full()
        else:
            found = linearise(model, at=point, inputs={"motor.voltage": 2.0})
            expected = np.block([[found.A, found.B], [found.C, found.D]])
    n = len(names)
    expected[:n] = shown @ expected[:n]
    expected[:, :n] = expected[:, :n] @ np.linalg.inv(shown)
    assert np.allclose(given, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def _shown(model: Model) -> np.ndarray:
    """States that are shown = this matrix times those of the model; see test_twists."""
    matrix = np.eye(len(model.states))
    for twist in twists(model):
        for k, coefficient in twist.terms.items():
            matrix[twist.coordinate, k] = coefficient
    return matrix


@each_model
def test_input_derivatives_agree_with_central_differences(
    name: str, exported: Any, request: pytest.FixtureRequest
) -> None:
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        _moving(instance, description)
        _, rates = _states(description)
        unknowns = rates + references(description, "output")
        for known in references(description, "input"):
            exact = np.array(instance.getDirectionalDerivative(unknowns, [known], [1.0]))
            middle = instance.getReal([known])[0]
            sides = []
            for side in (1e-4, -1e-4):
                instance.setReal([known], [middle + side])
                sides.append(np.array(instance.getReal(unknowns)))
            instance.setReal([known], [middle])
            difference = (sides[0] - sides[1]) / 2e-4
            assert np.allclose(difference, exact, rtol=1e-6, atol=1e-6 * max(1, np.abs(exact).max()))


class Differences:
    """A Model Exchange instance at a point where everything moves; states are given, not integrated."""

    def __init__(self, path: Path, folder: Path) -> None:
        extract(str(path), str(folder))
        self.description: Any = read_model_description(str(path))
        self.fmu = FMU2Model(
            guid=self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.modelExchange.modelIdentifier,
            instanceName="instance",
        )
        states, rates = _states(self.description)
        self.inputs = references(self.description, "input")
        self.knowns = states + self.inputs
        indicators = [v.valueReference for v in self.description.modelVariables if "indicator" in v.name]
        self.unknowns = rates + references(self.description, "output") + indicators

    def start(self, voltage: float, states: np.ndarray) -> None:
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.setReal(self.inputs, [voltage])
        self.fmu.exitInitializationMode()
        self.fmu.newDiscreteStates()
        self.fmu.enterContinuousTimeMode()
        self.states = len(states)
        self.point = np.append(states, voltage)

    def values(self, point: np.ndarray) -> np.ndarray:
        self.fmu.setContinuousStates((ctypes.c_double * self.states)(*point[: self.states]), self.states)
        self.fmu.setReal(self.inputs, point[self.states :].tolist())
        return np.array(self.fmu.getReal(self.unknowns))


@each_model
def test_every_pair_agrees_with_central_differences(
    name: str, exported: Any, request: pytest.FixtureRequest, tmp_path: Path, record_property: Any
) -> None:
    """Derivatives, outputs and event indicators by states and inputs; differences of two widths, extrapolated."""
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        _moving(instance, description)
        states = np.array(instance.getReal(_states(description)[0]))
    ode = Differences(exported(model), tmp_path)
    ode.start(2.0, states)
    try:
        ode.values(ode.point)
        exact = _matrix(ode.fmu, ode.unknowns, ode.knowns)
        given = np.empty_like(exact)
        for k, size in enumerate(np.abs(ode.point)):
            slopes = []
            for width in (2e-4 * max(size, 1e-3), 1e-4 * max(size, 1e-3)):
                side = np.eye(len(ode.point))[k] * width
                slopes.append((ode.values(ode.point + side) - ode.values(ode.point - side)) / (2 * width))
            given[:, k] = (4 * slopes[1] - slopes[0]) / 3
    finally:
        ode.fmu.freeInstance()
    # Relative to the largest entry of the row, for a difference cannot resolve what is small against its row.
    scale = np.abs(exact).max(axis=1, keepdims=True)
    worst = float((np.abs(given - exact) / np.where(scale == 0, 1, scale)).max())
    record_property("largest relative difference", f"{worst:.1e}")
    assert exact.shape == (len(ode.unknowns), len(ode.knowns))
    assert worst < 1e-6


@each_model
def test_structure_lists_what_has_a_derivative(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        _moving(instance, description)
        states, _ = _states(description)
        knowns = states + references(description, "input")
        for unknown in [*description.derivatives, *description.outputs]:
            listed = {v.valueReference for v in unknown.dependencies}
            for known in knowns:
                [value] = instance.getDirectionalDerivative([unknown.variable.valueReference], [known], [1.0])
                assert value == 0 or known in listed, (unknown.variable.name, known)
        assert any(len(unknown.dependencies) < len(knowns) for unknown in description.outputs)


def test_seeds_add_up(smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (instance, description, _):
        _moving(instance, description)
        states, rates = _states(description)
        u, y = references(description, "input"), references(description, "output")
        knowns, unknowns = states + u, rates + y
        seed = np.random.default_rng(1).standard_normal(len(knowns))
        once = instance.getDirectionalDerivative(unknowns, knowns, seed.tolist())
        assert np.allclose(once, _matrix(instance, unknowns, knowns) @ seed, rtol=1e-12, atol=1e-9)


@each_model
def test_initial_values_depend_on_what_is_listed(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    """Changing a parameter before the start changes nothing that does not list it."""
    model = request.getfixturevalue(name)
    with slave(exported(model)) as (instance, description, _):
        listed = {unknown.variable.valueReference: unknown.dependencies for unknown in description.initialUnknowns}
        unknowns = list(listed)
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        before = instance.getReal(unknowns)
        for variable in description.modelVariables:
            if variable.start is not None:
                old = instance.getReal([variable.valueReference])[0]
                instance.setReal([variable.valueReference], [old * 0.9 or 0.01])
                after = instance.getReal(unknowns)
                for unknown, a, b in zip(unknowns, before, after, strict=True):
                    assert a == b or variable in listed[unknown], (variable.name, unknown)
                instance.setReal([variable.valueReference], [old])
        assert instance.getReal(unknowns) == before
        states, rates = _states(description)
        exact = {v.valueReference for v in description.modelVariables if v.initial == "exact"}
        assert set(unknowns) == {*references(description, "output"), *states, *rates} - exact
