"""Calls that cannot be obeyed: a defined status, one message, nothing changed, no crash."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from typing import Any

import pytest
from fmpy import fmi2
from fmpy.fmi1 import FMICallException

from engine.model import Model
from fmu.verify import reference, references, slave

DISCARD, ERROR = 2, 3


class Patient:
    """An instance, what it logged, and a fingerprint of its values."""

    def __init__(self, instance: Any, description: Any, messages: list[str]) -> None:
        self.fmu, self.description, self.messages = instance, description, messages
        self.reals = [v.valueReference for v in description.modelVariables if v.type == "Real"]
        self.inputs = references(description, "input")
        self.outputs = references(description, "output")

    def start(self, stop: float | None = None) -> Patient:
        self.fmu.setupExperiment(startTime=0.0, stopTime=stop)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def step(self, k: int, length: float = 1e-3) -> None:
        self.fmu.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=length)

    def run(self, steps: int) -> None:
        for k in range(steps):
            self.step(k)

    def refuses(self, status: int, words: str, function: Any, *arguments: Any, **named: Any) -> None:
        """The call gives this status and a message with these words."""
        self.messages.clear()
        with pytest.raises(FMICallException) as caught:
            function(*arguments, **named)
        assert caught.value.status == status
        assert len(self.messages) == 1
        assert words in self.messages[0], self.messages

    def unknown(self) -> int:
        return 1 + max(int(v.valueReference) for v in self.description.modelVariables)


@pytest.fixture
def patient(switching_model: Model, exported: Any) -> Iterator[Patient]:
    with slave(exported(switching_model)) as (instance, description, messages):
        yield Patient(instance, description, messages)


@pytest.fixture
def running(patient: Patient) -> Iterator[Patient]:
    """A patient in step mode; whatever a test tried must have left its values and its course as they were."""
    patient.start(stop=1.0)
    patient.fmu.setReal(patient.inputs, [1.0])
    for k in range(20):
        patient.step(k)
    before = patient.fmu.getReal(patient.reals)
    state = patient.fmu.getFMUstate()
    yield patient
    assert patient.fmu.getReal(patient.reals) == before
    patient.step(20)
    after = patient.fmu.getReal(patient.reals)
    patient.fmu.setFMUstate(state)
    patient.step(20)
    assert patient.fmu.getReal(patient.reals) == after


def test_start_values_read_back(patient: Patient) -> None:
    given = [v for v in patient.description.modelVariables if v.start is not None]
    assert {v.causality for v in given} == {"parameter", "input", "local"}
    assert all(v.causality != "local" or v.initial == "exact" for v in given)
    for phase in ("instantiated", "initializing", "stepping"):
        assert patient.fmu.getReal([v.valueReference for v in given]) == [float(v.start) for v in given], phase
        if phase == "instantiated":
            patient.fmu.setupExperiment()
            patient.fmu.enterInitializationMode()
        elif phase == "initializing":
            patient.fmu.exitInitializationMode()


def test_unknown_references(running: Patient) -> None:
    for wrong in (running.unknown(), 2**32 - 1):
        running.refuses(ERROR, "value reference", running.fmu.getReal, [wrong])
        running.refuses(ERROR, "value reference", running.fmu.setReal, [wrong], [1.0])
        running.refuses(ERROR, "value reference", running.fmu.getInteger, [wrong])
        running.refuses(ERROR, "value reference", running.fmu.getDirectionalDerivative, [wrong], running.inputs, [1.0])
        running.refuses(ERROR, "value reference", running.fmu.getDirectionalDerivative, running.outputs, [wrong], [1.0])


def test_wrong_types(running: Patient) -> None:
    f, some = running.fmu, running.inputs
    mode = [v.valueReference for v in running.description.modelVariables if v.type == "Integer"][:1]
    running.refuses(ERROR, "type", f.getReal, mode)
    running.refuses(ERROR, "type", f.getInteger, some)
    running.refuses(ERROR, "type", f.getBoolean, some)
    running.refuses(ERROR, "type", f.getString, some)
    running.refuses(ERROR, "type", f.setInteger, mode, [1])
    running.refuses(ERROR, "type", f.setBoolean, some, [True])
    running.refuses(ERROR, "type", f.setString, some, ["1"])
    assert f.getString([]) == f.getBoolean([]) == f.getInteger([]) == f.getReal([]) == []


def test_only_inputs_and_parameters_can_be_set(running: Patient) -> None:
    for variable in running.description.modelVariables:
        if variable.type == "Real" and variable.causality not in ("input", "parameter"):
            running.refuses(ERROR, variable.name, running.fmu.setReal, [variable.valueReference], [1.0])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite(running: Patient, value: float) -> None:
    running.refuses(DISCARD, "finite", running.fmu.setReal, running.inputs, [value])
    running.refuses(DISCARD, "finite", running.fmu.setReal, [reference(running.description, "gear.ratio")], [value])
    running.refuses(DISCARD, "finite", running.fmu.setRealInputDerivatives, running.inputs, [1], [value])


def test_a_refused_value_refuses_the_whole_call(running: Patient) -> None:
    gear = reference(running.description, "gear.ratio")
    running.refuses(DISCARD, "finite", running.fmu.setReal, [gear, *running.inputs], [50.0, math.nan])
    running.refuses(ERROR, "reference", running.fmu.setReal, [gear, running.unknown()], [50.0, 1.0])


@pytest.mark.parametrize(
    ("name", "wrong", "right"),
    [
        ("gear.ratio", [0.0, -1.0], 1e-3),
        ("gear.efficiency", [0.0, 1.0000001], 1.0),
        ("friction.viscous_friction", [-1e-12], 0.0),
        ("zone.lower", [0.1], 0.0),
    ],
)
def test_parameters_out_of_range(running: Patient, name: str, wrong: list[float], right: float) -> None:
    at = reference(running.description, name)
    for value in wrong:
        running.refuses(DISCARD, name, running.fmu.setReal, [at], [value])
    old = running.fmu.getReal([at])
    running.fmu.setReal([at], [right])
    running.fmu.setReal([at], old)


def test_steps_that_cannot_be_done(running: Patient) -> None:
    step = running.fmu.doStep
    for length in (0.0, -1e-3, math.nan, math.inf, -math.inf):
        running.refuses(ERROR, "step", step, 0.02, length)
    for begin in (0.0, 0.019, 0.021, -1.0, math.nan, math.inf):
        running.refuses(ERROR, "step", step, begin, 1e-3)
    running.refuses(ERROR, "stopTime", step, 0.02, 0.98 + 1e-4)


def test_missing_pointers(running: Patient) -> None:
    f, c = running.fmu, running.fmu.component
    vr = (ctypes.c_uint * 1)(running.inputs[0])
    value = (ctypes.c_double * 1)()
    for function in (f.fmi2GetReal, f.fmi2SetReal):
        for arguments in ((None, 1, value), (vr, 1, None), (None, 1, None)):
            running.refuses(ERROR, "NULL", function, c, *arguments)
    running.refuses(ERROR, "NULL", f.fmi2GetInteger, c, vr, 1, None)
    running.refuses(ERROR, "NULL", f.fmi2GetFMUstate, c, None)
    running.refuses(ERROR, "NULL", f.fmi2DeSerializeFMUstate, c, None, 3, None)
    running.refuses(ERROR, "NULL", f.fmi2GetDirectionalDerivative, c, None, 1, vr, 1, value, value)
    running.refuses(ERROR, "categor", f.fmi2SetDebugLogging, c, 1, 1, None)
    running.refuses(ERROR, "category", f.setDebugLogging, True, ["nonsense"])


def test_calls_out_of_order(running: Patient) -> None:
    f = running.fmu
    running.refuses(ERROR, "step mode", f.setupExperiment)
    running.refuses(ERROR, "step mode", f.enterInitializationMode)
    running.refuses(ERROR, "step mode", f.exitInitializationMode)
    running.refuses(ERROR, "pending", f.cancelStep)
    running.refuses(DISCARD, "status", f.getIntegerStatus, 0)
    assert f.getStatus(0) == 0
    assert f.getBooleanStatus(3) is False
    assert f.getStringStatus(1) == ""
    assert f.getRealStatus(2) == 0.02


def test_calls_before_the_start(patient: Patient) -> None:
    f = patient.fmu
    patient.refuses(ERROR, "instantiated", f.doStep, 0.0, 1e-3)
    patient.refuses(ERROR, "instantiated", f.exitInitializationMode)
    patient.refuses(ERROR, "instantiated", f.terminate)
    patient.refuses(ERROR, "before initialization", f.getReal, patient.outputs)
    patient.refuses(ERROR, "instantiated", f.getDirectionalDerivative, patient.outputs, patient.inputs, [1.0])
    patient.refuses(ERROR, "startTime", f.setupExperiment, startTime=math.nan)
    patient.refuses(ERROR, "stopTime", f.setupExperiment, startTime=2.0, stopTime=1.0)
    f.setupExperiment()
    f.enterInitializationMode()
    patient.refuses(ERROR, "initialization mode", f.enterInitializationMode)
    patient.refuses(ERROR, "initialization mode", f.doStep, 0.0, 1e-3)
    f.exitInitializationMode()
    f.terminate()
    f.getReal(patient.outputs)
    patient.refuses(ERROR, "terminated", f.setReal, patient.inputs, [1.0])
    patient.refuses(ERROR, "terminated", f.doStep, 0.0, 1e-3)


def test_a_missing_instance_is_refused(patient: Patient) -> None:
    with pytest.raises(FMICallException):
        patient.fmu.fmi2DoStep(None, 0.0, 1e-3, 0)
    patient.fmu.fmi2FreeInstance(None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"instanceName": None}, "name"),
        ({"instanceName": b""}, "name"),
        ({"fmuGUID": b"{wrong}"}, "GUID"),
        ({"fmuGUID": None}, "GUID"),
        ({"callbacks": None}, None),
    ],
)
def test_instances_that_cannot_be_made(patient: Patient, change: dict[str, Any], words: str | None) -> None:
    arguments: dict[str, Any] = {
        "instanceName": b"x",
        "fmuType": fmi2.fmi2CoSimulation,
        "fmuGUID": patient.description.guid.encode(),
        "resourceLocation": None,
        "callbacks": ctypes.byref(patient.fmu.callbacks),
        "visible": 0,
        "loggingOn": 1,
    }
    patient.messages.clear()
    assert patient.fmu.fmi2Instantiate(*(arguments | change).values()) is None
    assert (words is None) == (not patient.messages)
    assert words is None or words in patient.messages[0]


def test_a_state_that_is_not_finite_is_an_error(smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (instance, description, messages):
        patient = Patient(instance, description, messages).start()
        good = instance.getFMUstate()
        instance.setReal(patient.inputs, [1e160])
        messages.clear()
        with pytest.raises(FMICallException) as caught:
            patient.run(2000)
        assert caught.value.status == ERROR
        assert "not finite" in messages[-1]
        patient.refuses(ERROR, "error", patient.step, 0)
        patient.refuses(ERROR, "after an error", instance.getReal, patient.outputs)
        instance.setFMUstate(good)
        patient.step(0)
        assert all(math.isfinite(v) for v in instance.getReal(patient.outputs))
        instance.reset()
        patient.start()
        patient.step(0)
