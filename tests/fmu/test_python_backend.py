"""The python backend: a scenario with a Python controller as an FMU. Its process: `tests.fmu.test_python_process`."""

from __future__ import annotations

import math
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
from fmu.verify import reference, references, slave
from scenarios.load import load
from tests.fmu.makers import PYTHON_CONTROLLER, PYTHON_SCENARIO

DISCARD, ERROR = 2, 3


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*PythonController of the scenario names it")
        yield


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("python")
    (folder / "code").mkdir()
    (folder / "code" / "controller.py").write_text(PYTHON_CONTROLLER)
    (folder / "arm.yaml").write_text(PYTHON_SCENARIO)
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
        with pytest.raises(FMICallException):
            other.deSerializeFMUstate(blob[:-1] + b"x")
        assert "damaged" in messages[-1]
        with pytest.raises(FMICallException):
            other.setFMUstate(state)
        assert "another instance" in messages[-1]
        assert other.getReal(y) == expected
        again = instance.getFMUstate()
        assert instance.serializeFMUstate(again) == other.serializeFMUstate(other.getFMUstate())
        for one in (state, again):
            instance.freeFMUstate(one)


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
        instance.setReal(u, [1.7e308])
        with pytest.raises(FMICallException):
            _run(instance, 100, 200)
        with pytest.raises(FMICallException):
            instance.getReal(y)
        instance.reset()
        instance.reset()
        assert start() == fresh


def test_the_documentation_says_what_it_needs(made: Path) -> None:
    with zipfile.ZipFile(made) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "FLEXARM_PYTHON" in page
    assert "SetRealInputDerivatives" not in page
    assert "Event indicators" not in page


def test_bad_calls_end_in_a_message_and_no_crash(made: Path) -> None:
    with slave(made) as (instance, description, messages):
        u, y = (references(description, kind) for kind in ("input", "output"))
        resistance = [reference(description, "motor.resistance")]
        instance.setupExperiment(startTime=0.0, stopTime=1.0)
        instance.enterInitializationMode()
        instance.setReal(u, [3.0])
        instance.exitInitializationMode()
        _run(instance, 0, 20)
        before = instance.getReal([*u, *y])
        cases: tuple[tuple[int, Callable[[], Any], str], ...] = (
            (DISCARD, lambda: instance.setReal(u, [math.nan]), "not finite"),
            (DISCARD, lambda: instance.setReal(u, [math.inf]), "not finite"),
            (DISCARD, lambda: instance.setReal(resistance, [-1.0]), "motor.resistance"),
            (DISCARD, lambda: instance.setReal([*u, *resistance], [1.0, math.nan]), "not finite"),
            (DISCARD, lambda: instance.getIntegerStatus(0), "status"),
            (ERROR, lambda: instance.setReal(y[:1], [0.0]), "cannot be set"),
            (ERROR, lambda: instance.setReal([999], [0.0]), "value reference 999"),
            (ERROR, lambda: instance.getReal([999]), "value reference 999"),
            (ERROR, lambda: instance.getReal([2**32 - 1]), "value reference"),
            (ERROR, lambda: instance.getInteger(u), "type"),
            (ERROR, lambda: instance.setInteger(u, [1]), "type"),
            (ERROR, lambda: instance.getBoolean(u), "type"),
            (ERROR, lambda: instance.setString(u, ["1"]), "type"),
            (ERROR, lambda: instance.doStep(0.5, 1e-3), "stands at"),
            (ERROR, lambda: instance.doStep(0.02, -1e-3), "cannot be done"),
            (ERROR, lambda: instance.doStep(0.02, 0.0), "cannot be done"),
            (ERROR, lambda: instance.doStep(0.02, math.nan), "cannot be done"),
            (ERROR, lambda: instance.doStep(0.02, 2.0), "stopTime"),
            (ERROR, lambda: instance.fmi2GetReal(instance.component, None, 1, None), "NULL"),
            (ERROR, lambda: instance.fmi2SetReal(instance.component, None, 1, None), "NULL"),
            (ERROR, lambda: instance.fmi2GetFMUstate(instance.component, None), "NULL"),
            (ERROR, lambda: instance.fmi2SetFMUstate(instance.component, None), "NULL"),
            (ERROR, lambda: instance.getDirectionalDerivative(y, u, [1.0]), "derivatives"),
            (ERROR, lambda: instance.setRealInputDerivatives(u, [1], [1.0]), "derivatives"),
            (ERROR, lambda: instance.setDebugLogging(True, ["nonsense"]), "category"),
            (ERROR, lambda: instance.cancelStep(), "pending"),
            (ERROR, lambda: instance.setupExperiment(), "step mode"),
            (ERROR, lambda: instance.enterInitializationMode(), "step mode"),
            (ERROR, lambda: instance.exitInitializationMode(), "step mode"),
        )
        for status, bad, piece in cases:
            messages.clear()
            with pytest.raises(FMICallException) as caught:
                bad()
            assert caught.value.status == status, piece
            assert len(messages) == 1
            assert piece in messages[0]
            assert instance.getReal([*u, *y]) == before
        assert instance.getRealStatus(2) == pytest.approx(0.02)
        _run(instance, 20, 40)
        assert instance.getReal(y) != before[1:]


def test_calls_before_the_start_and_after_the_end(made: Path) -> None:
    with slave(made) as (instance, description, messages):
        u, y = (references(description, kind) for kind in ("input", "output"))

        def refused(function: Callable[..., Any], *arguments: Any, words: str, **named: Any) -> None:
            messages.clear()
            with pytest.raises(FMICallException) as caught:
                function(*arguments, **named)
            assert caught.value.status == ERROR
            assert words in messages[0]

        refused(instance.doStep, 0.0, 1e-3, words="instantiated")
        refused(instance.exitInitializationMode, words="instantiated")
        refused(instance.terminate, words="instantiated")
        refused(instance.getReal, y, words="before initialization")
        refused(instance.setupExperiment, startTime=math.nan, words="startTime")
        refused(instance.setupExperiment, startTime=2.0, stopTime=1.0, words="stopTime")
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        refused(instance.enterInitializationMode, words="initialization mode")
        refused(instance.doStep, 0.0, 1e-3, words="initialization mode")
        instance.getReal(y)
        instance.setReal(u, [1.0])
        instance.exitInitializationMode()
        instance.setReal(u, [2.0])  # takes back what was worked out at this instant, and not the mode
        _run(instance, 0, 3)
        instance.terminate()
        instance.getReal(y)
        refused(instance.setReal, u, [1.0], words="terminated")
        refused(instance.doStep, 3e-3, 1e-3, words="terminated")


def test_a_failing_controller_is_named(scenario: Path, tmp_path: Path) -> None:
    (tmp_path / "code").mkdir()
    text = "def fail(t, u):\n    if t > 0.02:\n        raise ValueError('no more')\n    return 0.0\n"
    (tmp_path / "code" / "controller.py").write_text(text)
    (tmp_path / "arm.yaml").write_text(PYTHON_SCENARIO.replace("Integrator", "fail"))
    path = export(tmp_path / "arm.yaml", tmp_path / "arm.fmu", backend="python")
    with pytest.raises(FlexarmError, match=r"control.*no more"):
        fmu.cosim(path, 0.1)


def test_the_c_backend_refuses_and_names_the_way_out(scenario: Path, tmp_path: Path) -> None:
    with pytest.raises(FlexarmError) as caught:
        export(load(scenario), tmp_path / "x.fmu")
    assert "control" in str(caught.value)
    assert "python backend" in str(caught.value)
    assert list(tmp_path.iterdir()) == []
