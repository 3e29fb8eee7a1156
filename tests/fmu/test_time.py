"""An FMU's results over time: equal to the runner, independent of how the importer divides time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fmu
import scenarios
from engine.model import Model
from engine.simulate import Drive, simulate
from fmu.verify import references, slave
from scenarios.load import load

MODELS = ["smooth_model", "switching_model", "timed_model"]


@pytest.fixture
def model(request: pytest.FixtureRequest) -> Model:
    return request.getfixturevalue(request.param)  # type: ignore[no-any-return]


def _drive(model: Model, size: float = 2.0) -> Drive | None:
    if not model.inputs:
        return None
    knots = np.arange(0, 1, 0.04)
    return Drive(knots, size * np.random.default_rng(3).standard_normal((len(knots), len(model.inputs))))


def _constant(model: Model, value: float) -> Drive | None:
    return Drive([0.0], [[value]]) if model.inputs else None


@pytest.mark.parametrize("model", MODELS, indirect=True)
def test_equals_the_runner_at_the_same_step(
    model: Model, exported: Any, record_property: Callable[[str, object], None]
) -> None:
    difference = fmu.compare_with_runner(model, exported(model), 1.5, drive=_drive(model))
    record_property("largest difference", f"{difference:.1e}")
    assert difference <= 1e-12


@pytest.mark.parametrize("model", ["smooth_model", "switching_model"], indirect=True)
def test_equals_the_runner_with_other_parameters(model: Model, exported: Any) -> None:
    changed = {"gear.ratio": 50.0, "link.mass": 0.08, "motor.resistance": 3.1}
    path = exported(model)
    expected = simulate(model, 1.0, drive=_drive(model), parameters=changed, internal_step=1e-3)
    given = fmu.cosim(path, 1.0, drive=_drive(model), parameters=changed)
    assert np.abs(given.values - expected.values).max() <= 1e-11


def test_equals_the_runner_with_a_linear_input(smooth_model: Model, exported: Any) -> None:
    drive = Drive([0.0, 0.3, 0.5, 1.0], [[0.0], [2.0], [-1.0], [0.5]], hold="linear")
    assert fmu.compare_with_runner(smooth_model, exported(smooth_model), 1.0, drive=drive) <= 1e-12


def test_agrees_with_an_adaptive_solver_and_has_order_four(
    smooth_model: Model, exported: Any, record_property: Callable[[str, object], None]
) -> None:
    f = smooth_model.functions
    p, n = smooth_model.parameter_values, len(smooth_model.states)
    empty = np.zeros(0)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        return f["derivative"](t, x, [1.5], empty, empty, p).full().ravel()  # type: ignore[no-any-return]

    x = solve_ivp(rate, (0, 0.5), np.zeros(n), rtol=1e-11, atol=1e-13, method="DOP853").y[:, -1]
    exact = f["outputs"](0.5, x, [1.5], empty, empty, p).full().ravel()
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        trace = fmu.cosim(exported(smooth_model, step=step), 0.5, 1e-2, drive=_constant(smooth_model, 1.5))
        errors.append(float(np.abs(trace.values[-1] - exact)[:2].max()))
    assert errors[0] < 1e-6
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    record_property("difference at 1 ms", f"{errors[0]:.1e}")
    record_property("orders", ", ".join(f"{order:.2f}" for order in orders))
    assert (np.abs(orders - 4) < 0.5).all(), (errors, orders)


@pytest.mark.parametrize("model", MODELS, indirect=True)
def test_long_and_short_communication_steps_are_bit_identical(model: Model, exported: Any) -> None:
    path = exported(model)
    short = fmu.cosim(path, 1.0, 1e-3, drive=_constant(model, 1.5))
    long = fmu.cosim(path, 1.0, 1e-2, drive=_constant(model, 1.5))
    assert np.array_equal(short.values[::10], long.values)


@pytest.mark.parametrize("model", MODELS, indirect=True)
@pytest.mark.parametrize("steps", [(0.37e-3,), (1.9e-3,), (0.37e-3, 1.9e-3, 0.5e-3)])
def test_irregular_steps_end_at_the_right_time_and_value(model: Model, exported: Any, steps: tuple[float, ...]) -> None:
    trace = fmu.cosim(exported(model), 0.5, steps, drive=_constant(model, 1.5))
    fine = simulate(model, 0.5, drive=_constant(model, 1.5), internal_step=5e-5)
    regular = simulate(model, 0.5, drive=_constant(model, 1.5))
    assert trace.time[-1] == 0.5
    # Dividing a cell shortens steps, so the error must stay of the size that whole cells have.
    bound = 3 * np.abs(regular.values[-1] - fine.values[-1]) + 1e-9 * np.abs(fine.values).max(axis=0)
    assert (np.abs(trace.values[-1] - fine.values[-1]) <= bound).all()


def test_time_counts_without_drift(smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (instance, _, _):
        instance.setupExperiment(startTime=2.0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        time = 2.0
        for _ in range(5000):
            instance.doStep(currentCommunicationPoint=time, communicationStepSize=1e-4)
            time += 1e-4
        assert instance.getRealStatus(2) == instance.getReal([0])[0] == 2.5


def test_clocks_tick_inside_a_long_step_and_use_the_inputs_of_their_instant(
    switching_model: Model, exported: Any
) -> None:
    # A step in the reference at 0.1 s, where the controller samples: it must answer at once, by kp = 0.3 V.s/rad.
    drive = Drive([0.0, 0.1], [[0.0], [2.0]])
    trace = fmu.cosim(exported(switching_model), 0.12, 1e-2, drive=drive)
    command = trace["controller.out"]
    assert command[9] == 0.0
    assert command[10] == pytest.approx(0.6, abs=1e-12)
    # Each later sample adds ki T e = 1 * 1e-3 * 2 while the speed is still small; ten of them lie in the next step.
    fine = fmu.cosim(exported(switching_model), 0.12, 1e-3, drive=drive)["controller.out"]
    assert fine[101] == pytest.approx(0.602, abs=5e-3)
    assert np.array_equal(fine[::10], command)


def test_outputs_may_be_read_before_or_after_inputs_are_set(switching_model: Model, exported: Any) -> None:
    path = exported(switching_model)
    drive = _drive(switching_model)
    assert drive is not None
    expected = fmu.cosim(path, 0.5, 1e-2, drive=drive)
    with slave(path) as (instance, description, _):
        u, y = (references(description, kind) for kind in ("input", "output"))
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        for k in range(51):
            instance.getReal(y)
            value = float(np.asarray(drive.values)[min(int(k * 0.01 / 0.04 + 1e-9), 24), 0])
            instance.setReal(u, [value + 1])
            instance.getReal(y)
            instance.setReal(u, [value])
            assert np.array_equal(instance.getReal(y), expected.values[k])
            if k < 50:
                instance.doStep(currentCommunicationPoint=k * 0.01, communicationStepSize=0.01)


def test_output_derivatives_are_those_of_the_motion(smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (instance, description, _):
        u, y = (references(description, kind) for kind in ("input", "output"))
        x = [v.valueReference for v in description.modelVariables if v.name == "gear.output.speed"]
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.setReal(u, [1.0])
        instance.exitInitializationMode()
        for k in range(300):
            instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
        # The first output is the hub's angle, whose derivative is the speed of the gear's output shaft.
        assert instance.getRealOutputDerivatives(y[:1], [1]) == pytest.approx(instance.getReal(x), rel=1e-12)


def _shipped() -> list[str]:
    folder = Path(scenarios.__file__).parent
    return sorted(file.stem for file in folder.glob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("name", _shipped())
def test_every_shipped_scenario_equals_the_runner(name: str, tmp_path: Path) -> None:
    model = load(name).build([], None)
    path = fmu.export(model, tmp_path / "scenario.fmu", platforms=["linux64"])
    assert fmu.validate(path) == []
    assert fmu.compare_with_runner(model, path, 0.5) <= 1e-12
