"""FMI 3 Co-Simulation with event mode: early return, limits from both sides, clocks, saved states and refusals."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave

import fmu
from engine.model import Model
from engine.simulate import Drive, simulate
from fmu.variables import flat
from fmu.verify import reference, references
from scenarios.load import load


@pytest.fixture(scope="module")
def exported3(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Model], Path]:
    folder = tmp_path_factory.mktemp("events")
    made: dict[str, Path] = {}

    def make(model: Model) -> Path:
        if model.name not in made:
            name = model.name.replace(" ", "_") + ".fmu"
            made[model.name] = fmu.export(model, folder / name, platforms=["linux64"], version=3)
        return made[model.name]

    return make


class Instance:
    """An instance in Co-Simulation, with event mode unless told otherwise."""

    def __init__(self, path: Path, folder: Path, events: bool = True, early: bool = True) -> None:
        extract(str(path), str(folder))
        self.description: Any = read_model_description(str(path))
        self.messages: list[str] = []
        self.fmu = FMU3Slave(
            guid=self.description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="instance",
        )

        def log(environment: Any, status: int, category: bytes, message: bytes) -> None:
            self.messages.append(message.decode())

        self.fmu.instantiate(loggingOn=True, logMessage=log, eventModeUsed=events, earlyReturnAllowed=early)
        self.u, self.y = references(self.description, "input"), references(self.description, "output")
        self.clocks = [v.valueReference for v in self.description.modelVariables if v.type == "Clock"]

    def start(self) -> None:
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()

    def handle(self) -> None:
        """Event mode from beginning to end."""
        self.fmu.enterEventMode()
        self.fmu.updateDiscreteStates()
        self.fmu.enterStepMode()

    def run(self, time: float, stop: float, step: float) -> tuple[list[float], np.ndarray]:
        """Instants of early returns, and the outputs at the end."""
        found = []
        while time < stop - 1e-12:
            following = min(stop, (np.floor(time / step + 1e-9) + 1) * step)
            needed, _, early, last = self.fmu.doStep(time, following - time)
            if early:
                found.append(last)
            if needed:
                self.handle()
            time = last if early else following
        return found, np.array(self.fmu.getFloat64(self.y))

    def refuses(self, words: str, action: Any, *arguments: Any) -> None:
        self.messages.clear()
        with pytest.raises(FMICallException) as caught:
            action(*arguments)
        assert caught.value.status == 3
        assert [words in message for message in self.messages] == [True], self.messages


@pytest.mark.parametrize("name", ["srv02-backlash", "reference-b", "friction-damper", "flexible-arm-braked"])
def test_fmpy_with_event_mode_agrees_with_plain_co_simulation(name: str, exported3: Any) -> None:
    """Every 10 ms; an event splits an integration step, hence not to the last bit."""
    model = load(name).build()
    path = exported3(model)
    assert fmu.validate(path) == []
    settings: dict[str, Any] = {"fmi_type": "CoSimulation", "stop_time": 1.0, "output_interval": 1e-2}
    plain = simulate_fmu(str(path), **settings)
    for early in (True, False):
        rows = simulate_fmu(str(path), use_event_mode=True, early_return_allowed=early, **settings)
        index = np.searchsorted(rows["time"], plain["time"] + 1e-9, side="right") - 1
        for output in model.outputs:
            own, given = plain[flat(output.name)], rows[flat(output.name)][index]
            assert np.abs(given - own).max() <= (1e-7 if early else 0) * (np.ptp(own) or 1.0), output.name


def test_early_returns_are_the_events_of_the_simulation(timed_model: Model, exported3: Any, tmp_path: Path) -> None:
    """Stick and slip of a rotor: the instants that `simulate` locates, and none besides."""
    run = simulate(timed_model, 0.8, 1e-2, internal_step=1e-3)
    expected = sorted({t for t, _, _ in run.events if t > 0})
    made = Instance(exported3(timed_model), tmp_path)
    made.start()
    made.fmu.updateDiscreteStates()
    made.fmu.enterStepMode()
    found, last = made.run(0.0, 0.8, 0.1)
    assert len(found) == len(expected) >= 3
    assert np.abs(np.array(found) - expected).max() < 1e-9
    assert np.allclose(last, run.values[-1], rtol=1e-9, atol=1e-12)


def test_values_before_event_mode_are_limits_from_the_left(timed_model: Model, exported3: Any, tmp_path: Path) -> None:
    made = Instance(exported3(timed_model), tmp_path)
    made.start()
    made.fmu.enterStepMode()
    mode, speed = (reference(made.description, name) for name in ("friction.mode", "motor_shaft_speed"))
    needed, _, early, last = made.fmu.doStep(0.0, 0.8)
    assert (needed, early) == (True, True)
    assert made.fmu.getInt32([mode]) == [0]
    assert made.fmu.getFloat64([reference(made.description, "time")]) == [last]
    made.fmu.enterEventMode()
    made.fmu.updateDiscreteStates()
    assert made.fmu.getInt32([mode]) == [1]
    assert made.fmu.getFloat64([speed]) == [0.0]
    made.fmu.enterStepMode()
    needed, _, early, last = made.fmu.doStep(last, 0.8 - last)
    assert made.fmu.getInt32([mode]) == [1]
    assert abs(made.fmu.getFloat64([speed])[0]) < 1e-9
    made.handle()
    assert made.fmu.getInt32([mode]) != [1]


def test_clocks_tick_in_event_mode_and_inputs_of_that_instant_count(
    switching_model: Model, exported3: Any, tmp_path: Path
) -> None:
    """A PI sampled at 1 kHz: its command changes in event mode, by the reference that is set there."""
    made = Instance(exported3(switching_model), tmp_path)
    command = reference(made.description, "controller_out")
    [clock] = [v for v in made.description.modelVariables if v.type == "Clock"]
    assert (clock.causality, clock.intervalVariability) == ("output", "triggered")
    assert clock.description == "sample instants, every 0.001 s from 0 s on"
    made.start()
    assert made.fmu.getClock(made.clocks) == [True]
    made.fmu.updateDiscreteStates()
    assert made.fmu.getClock(made.clocks) == [False]
    made.fmu.enterStepMode()
    needed, _, early, last = made.fmu.doStep(0.0, 5e-3)
    assert (needed, early) == (True, True)
    assert last == pytest.approx(1e-3, abs=1e-12)
    before = made.fmu.getFloat64([command])
    made.fmu.setFloat64(made.u, [2.0])
    assert made.fmu.getFloat64([command]) == before
    made.fmu.enterEventMode()
    assert made.fmu.getClock(made.clocks) == [True]
    assert made.fmu.getFloat64([command])[0] == pytest.approx(0.3 * 2.0, rel=1e-3)
    made.fmu.setFloat64(made.u, [3.0])
    assert made.fmu.getFloat64([command])[0] == pytest.approx(0.3 * 3.0, rel=1e-3)
    again, _, _, _, timed, following = made.fmu.updateDiscreteStates()
    assert (again, timed) == (False, True)
    assert following == pytest.approx(2e-3, abs=1e-12)
    assert made.fmu.getClock(made.clocks) == [False]
    made.fmu.enterStepMode()


def test_inputs_set_at_an_event_act_from_there(switching_model: Model, exported3: Any, tmp_path: Path) -> None:
    """As a drive that steps at the same sample instant does in plain Co-Simulation."""
    made = Instance(exported3(switching_model), tmp_path)
    made.start()
    made.fmu.updateDiscreteStates()
    made.fmu.enterStepMode()
    made.run(0.0, 0.019, 1e-3)
    needed, _, early, _ = made.fmu.doStep(0.019, 1e-3)
    assert (needed, early) == (True, False)
    made.fmu.enterEventMode()
    made.fmu.setFloat64(made.u, [2.0])
    made.fmu.updateDiscreteStates()
    made.fmu.enterStepMode()
    _, last = made.run(0.02, 0.1, 5e-3)
    drive = Drive([0.0, 0.02], [[0.0], [2.0]])
    expected = fmu.cosim(exported3(switching_model), 0.1, 1e-3, drive=drive).values
    assert (np.abs(last - expected[-1]) <= 1e-9 * np.abs(expected).max(axis=0)).all()


@pytest.mark.parametrize("waiting", [True, False], ids=["before event mode", "in event mode"])
def test_states_saved_at_an_event_come_back(
    waiting: bool, switching_model: Model, exported3: Any, tmp_path: Path
) -> None:
    made = Instance(exported3(switching_model), tmp_path)
    made.start()
    made.fmu.setFloat64(made.u, [2.0])
    made.fmu.updateDiscreteStates()
    made.fmu.enterStepMode()
    made.run(0.0, 0.02, 5e-3)
    needed, _, _, last = made.fmu.doStep(0.02, 5e-3)
    assert needed

    def onward() -> np.ndarray:
        if waiting:
            made.fmu.enterEventMode()
        made.fmu.updateDiscreteStates()
        made.fmu.enterStepMode()
        return made.run(last, 0.05, 5e-3)[1]

    if not waiting:
        made.fmu.enterEventMode()
    blob = made.fmu.serializeFMUState(made.fmu.getFMUState())
    first = onward()
    made.fmu.setFMUState(made.fmu.deserializeFMUState(blob))
    assert np.array_equal(onward(), first)
    other = Instance(exported3(switching_model), tmp_path / "other", events=False)
    state = other.fmu.deserializeFMUState(blob)
    other.refuses("with and without event mode", other.fmu.setFMUState, state)


def test_without_early_return_a_step_goes_to_its_end(timed_model: Model, exported3: Any, tmp_path: Path) -> None:
    made = Instance(exported3(timed_model), tmp_path, early=False)
    made.start()
    made.fmu.enterStepMode()
    found, _ = made.run(0.0, 0.8, 0.1)
    assert found == []


def test_refusals(switching_model: Model, exported3: Any, tmp_path: Path) -> None:
    plain = Instance(exported3(switching_model), tmp_path / "plain", events=False)
    plain.start()
    plain.refuses("without event mode", plain.fmu.enterEventMode)
    plain.refuses("in step mode", plain.fmu.enterStepMode)
    made = Instance(exported3(switching_model), tmp_path / "events")
    made.refuses("instantiated", made.fmu.enterEventMode)
    made.start()
    made.refuses("in event mode", made.fmu.doStep, 0.0, 1e-3)
    made.refuses("not a clock", made.fmu.getClock, made.y[:1])
    made.refuses("tick by themselves", made.fmu.setClock, made.clocks, [True])
    made.refuses("not for Co-Simulation", made.fmu.fmi3EnterContinuousTimeMode, made.fmu.component)
    made.refuses("not for Co-Simulation", made.fmu.fmi3SetTime, made.fmu.component, 1.0)
    made.refuses("no variable of this type", made.fmu.getFloat64, made.clocks)
    made.fmu.enterStepMode()
    made.refuses("in step mode", made.fmu.getClock, made.clocks)
    made.refuses("in step mode", made.fmu.updateDiscreteStates)
    made.refuses("in step mode", made.fmu.enterStepMode)


def test_fmusim_uses_event_mode(exported3: Any, tmp_path: Path) -> None:
    tool = os.environ.get("FLEXARM_FMUSIM") or shutil.which("fmusim")
    if not tool:
        pytest.skip("fmusim is not installed: build it from the sources of the Reference FMUs")
    path, result = exported3(load("srv02-backlash").build()), tmp_path / "rows.csv"
    command = [tool, "--interface-type", "cs", "--event-mode-used", "--early-return-allowed", "--stop-time", "1"]
    command += ["--output-interval", "0.01", "--output-file", str(result), str(path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=3600, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = np.genfromtxt(result, delimiter=",", names=True, deletechars="")
    plain = simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=1.0, output_interval=1e-2)
    assert len(rows) > len(plain)
    for name in plain.dtype.names[1:]:
        given = np.interp(1.0, rows["time"], rows[name])
        assert abs(given - plain[name][-1]) <= 1e-7 * (np.ptp(plain[name]) or 1.0), name
