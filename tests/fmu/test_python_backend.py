"""The python backend: a scenario with a Python controller as an FMU, and pythonfmu's faults repaired."""

from __future__ import annotations

import ctypes
import gc
import math
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException

import fmu
from engine.errors import FlexarmError
from engine.simulate import Drive
from flexarm.api import export
from flexarm.cut import cut
from fmu import python_backend
from fmu.host import host
from fmu.verify import reference, references, slave
from scenarios.load import load

CONTROLLER = """\
class Integrator:
    def __init__(self):
        self.sum = 0.0

    def __call__(self, t, u):
        self.sum += 0.005 * (u[0] - u[1])
        return 0.4 * (u[0] - u[1]) + 2.0 * self.sum
"""
SCENARIO = """\
schema: 1
name: python arm
blocks:
  reference: {type: Step, height: 3 rad/s}
  control: {type: PythonController, function: Integrator, file: code/controller.py, inputs: 2, period: 5 ms}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 2e-4 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 0.002 N.m}
connect:
  - [reference.out, control.in1]
  - [motor.shaft.speed, control.in2]
  - [control.out, motor.voltage]
  - [motor.shaft, friction.shaft]
simulate: {stop: 1 s, step: 1 ms, record: [control.out, motor.shaft.speed]}
analyses:
  fmu: {kind: export, inputs: [control.in1], outputs: [control.out, motor.shaft.speed, motor.shaft.angle]}
"""


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*PythonController of the scenario names it")
        yield


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("python")
    (folder / "code").mkdir()
    (folder / "code" / "controller.py").write_text(CONTROLLER)
    (folder / "arm.yaml").write_text(SCENARIO)
    return folder / "arm.yaml"


@pytest.fixture(scope="module")
def made(scenario: Path) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return export(scenario, scenario.parent / "arm.fmu", backend="python")


def test_valid_and_marked(made: Path) -> None:
    assert fmu.validate(made) == []
    description: Any = read_model_description(str(made))
    assert description.coSimulation.needsExecutionTool
    assert not description.coSimulation.providesDirectionalDerivative
    assert description.modelExchange is None
    outputs = {v.name for v in description.modelVariables if v.causality == "output"}
    assert outputs <= {unknown.variable.name for unknown in description.initialUnknowns}


def test_equals_the_runner(made: Path, scenario: Path) -> None:
    model = cut(scenario, "export").model
    drive = Drive([0.0, 0.303, 0.61], [[3.0], [-2.0], [1.0]])
    assert fmu.compare_with_runner(model, made, 1.0, drive=drive) <= 1e-12
    changed = {"motor.resistance": 3.0}
    assert fmu.compare_with_runner(model, made, 0.3, drive=drive, parameters=changed) <= 1e-12
    whole = fmu.cosim(made, 0.5, 1e-2, drive=Drive([0.0], [[2.0]]))
    fine = fmu.cosim(made, 0.5, 1e-3, drive=Drive([0.0], [[2.0]]))
    assert np.array_equal(whole.values, fine.values[::10])


def _run(instance: Any, first: int, last: int) -> None:
    for k in range(first, last):
        instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)


def test_the_whole_state_comes_back(made: Path) -> None:
    """The controller's own attribute, the sampled memory and the friction's mode included; also in another instance."""
    with slave(made) as (instance, description, _), slave(made, "other") as (other, _, messages):
        u, y = (references(description, kind) for kind in ("input", "output"))
        for one in (instance, other):
            one.setupExperiment(startTime=0.0)
            one.enterInitializationMode()
            one.setReal(u, [3.0])
            one.exitInitializationMode()
        _run(instance, 0, 63)
        state = instance.getFMUstate()
        blob = instance.serializeFMUstate(state)
        _run(instance, 63, 200)
        expected = instance.getReal(y)
        instance.setFMUstate(state)
        _run(instance, 63, 200)
        assert instance.getReal(y) == expected
        other.setFMUstate(other.deSerializeFMUstate(blob))
        _run(other, 63, 200)
        assert other.getReal(y) == expected
        other.setFMUstate(other.deSerializeFMUstate(blob[:-1] + b"x"))
        assert "damaged" in messages[-1]
        assert other.getReal(y) == expected


def test_reset_equals_a_fresh_instance(made: Path) -> None:
    """Also after tuning, after a failed step, and twice over; the controller's attribute starts afresh."""
    with slave(made) as (instance, description, _):
        u, y = (references(description, kind) for kind in ("input", "output"))
        tuned = reference(description, "motor.resistance")

        def start() -> list[float]:
            instance.setupExperiment(startTime=0.0)
            instance.enterInitializationMode()
            instance.setReal(u, [3.0])
            instance.exitInitializationMode()
            _run(instance, 0, 100)
            return instance.getReal(y)  # type: ignore[no-any-return]

        fresh = start()
        instance.setReal([tuned], [4.0])
        _run(instance, 100, 150)
        instance.reset()
        assert instance.getReal([tuned, *u]) == [2.6, 0.0]
        assert start() == fresh
        instance.setReal(u, [math.nan])
        with pytest.raises(FMICallException):
            _run(instance, 100, 101)
        instance.reset()
        instance.reset()
        assert start() == fresh


def test_a_refused_value_is_said_by_the_next_step(made: Path) -> None:
    """pythonfmu's binary knows no way to refuse but one that frees the instance, so the call itself gives OK."""
    with slave(made) as (instance, description, messages):
        u = references(description, "input")
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        vr, value = (ctypes.c_uint * 1)(*u), (ctypes.c_double * 1)(math.nan)
        assert instance.fmi2SetReal(instance.component, vr, 1, value) == 0
        assert "cannot be nan" in messages[-1]
        assert instance.getReal(u) == [0.0]
        with pytest.raises(FMICallException) as caught:
            _run(instance, 0, 1)
        assert caught.value.status == 2
        instance.setReal(u, [1.0])
        _run(instance, 0, 1)


def test_the_documentation_says_so(made: Path) -> None:
    with zipfile.ZipFile(made) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "the next step is refused" in page
    assert "SetRealInputDerivatives" not in page
    assert "Event indicators" not in page


def test_bad_calls_end_in_a_message_and_no_crash(made: Path) -> None:
    with slave(made) as (instance, description, messages):
        u, y = (references(description, kind) for kind in ("input", "output"))
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        instance.setReal(u, [3.0])
        instance.exitInitializationMode()
        _run(instance, 0, 20)
        before = instance.getReal([*u, *y])
        cases: tuple[tuple[Callable[[], Any], str], ...] = (
            (lambda: instance.setReal(u, [math.nan]), "nan"),
            (lambda: instance.setReal(u, [math.inf]), "inf"),
            (lambda: instance.setReal(y[:1], [0.0]), "cannot be set"),
            (lambda: instance.getReal([999]), "IndexError"),
        )
        for bad, piece in cases:
            bad()
            assert piece in messages[-1]
            assert instance.getReal([*u, *y]) == before
            with pytest.raises(FMICallException):
                _run(instance, 20, 21)
            instance.setReal(u, [3.0])
        for begin, length in ((0.5, 1e-3), (0.02, -1e-3), (0.02, 0.0)):
            with pytest.raises(FMICallException):
                instance.doStep(currentCommunicationPoint=begin, communicationStepSize=length)
        _run(instance, 20, 40)
        assert instance.getReal(y) != before[1:]


def test_loaded_many_times(made: Path) -> None:
    """pythonfmu's binary releases the module once too often; without repair the second load or the next collection of
    garbage crashes."""
    for _ in range(10):
        with host(made) as instance:
            with instance.starting():
                pass
            instance.step(0.0, 1e-3)
        gc.collect()


def test_a_failing_controller_is_named(scenario: Path, tmp_path: Path) -> None:
    (tmp_path / "code").mkdir()
    text = "def fail(t, u):\n    if t > 0.02:\n        raise ValueError('no more')\n    return 0.0\n"
    (tmp_path / "code" / "controller.py").write_text(text)
    (tmp_path / "arm.yaml").write_text(SCENARIO.replace("Integrator", "fail"))
    path = export(tmp_path / "arm.yaml", tmp_path / "arm.fmu", backend="python")
    with pytest.raises(FlexarmError, match=r"control.*no more"):
        fmu.cosim(path, 0.1)


def test_the_c_backend_refuses_and_names_the_way_out(scenario: Path, tmp_path: Path) -> None:
    with pytest.raises(FlexarmError) as caught:
        export(load(scenario), tmp_path / "x.fmu")
    assert "control" in str(caught.value)
    assert "python backend" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_pythonfmu_is_told_with_what_installs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pythonfmu", None)
    with pytest.raises(FlexarmError, match="needs pythonfmu") as raised:
        python_backend._binaries()
    assert raised.value.remedy == "pip install pythonfmu"
