"""What is decided at the start and said of it: poses that an importer sets, the internal step, nominals, events."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model

import fmu
from engine.compile import library
from engine.model import Model
from engine.simulate import Drive, simulate
from engine.step import internal_step
from fmu.nominal import FLOORS, SHARE
from fmu.verify import cosim, reference, references, slave
from scenarios.load import load


def _start(instance: Any, values: dict[int, float] | None = None) -> None:
    for vr, value in (values or {}).items():
        instance.setReal([vr], [value])
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()


@pytest.fixture(scope="module")
def two_link(tmp_path_factory: pytest.TempPathFactory) -> tuple[Model, Path]:
    model = load("two-link-flexible").build()
    path = tmp_path_factory.mktemp("start") / "two.fmu"
    return model, fmu.export(model, path, platforms=["linux64"])


UNDAMPED = """\
schema: 1
name: undamped
blocks:
  m: {type: Mass, mass: 1}
  k: {type: TranslationalSpringDamper, stiffness: 39.47841760435743}
  g: {type: TranslationalFixed}
connect:
  - [m.flange, k.a]
  - [k.b, g.flange]
initial: {m.flange.position: 1}
"""


@pytest.mark.parametrize("step", [0.1, 0.02], ids=["modes decide", "the grid decides"])
@pytest.mark.parametrize("stiffer", [0.25, 4.0, 16.0])
def test_a_tuned_oscillator_is_followed_to_the_end(step: float, stiffer: float, tmp_path: Path) -> None:
    """x = cos(w t); the phase may be off by 1e-3 rad after 100 s, whatever the stiffness that an importer sets."""
    (tmp_path / "a.yaml").write_text(UNDAMPED)
    model = load(tmp_path / "a.yaml").build(outputs=["m.flange.position", "m.flange.speed"])
    path = fmu.export(model, tmp_path / "a.fmu", platforms=["linux64"], step=step, stop=100.0)
    rate = 2 * np.pi * np.sqrt(stiffer)
    trace = cosim(path, 100.0, step, parameters={"k.stiffness": rate**2})
    late = np.exp(1j * rate * trace.time[-1]) * (trace.values[-1, 0] + 1j * trace.values[-1, 1] / rate)
    assert abs(np.angle(late)) < 1.05e-3
    assert abs(abs(late) - 1) < 1e-3


def test_poses_are_exact_starts_with_the_scenarios_own_values(two_link: tuple[Model, Path]) -> None:
    model, path = two_link
    states = [v for v in read_model_description(str(path)).modelVariables if v.initial == "exact" and v.start]
    states = [v for v in states if v.causality == "local"]
    assert [v.name for v in states[:2]] == [s.name for s in model.states[:2]]
    assert float(states[0].start) == pytest.approx(np.radians(-40))


@pytest.mark.parametrize("version", [2, 3])
def test_an_importer_sets_the_pose(version: int, tmp_path: Path) -> None:
    """By FMPy's start values, in Co-Simulation and Model Exchange; as `simulate` with the same initial values."""
    model = load("two-link-flexible").build()
    path = fmu.export(model, tmp_path / "two.fmu", platforms=["linux64"], version=version)
    names = [state.name for state in model.states[:2]]
    wanted = {names[0]: 0.3, names[1]: -0.5}
    expected = simulate(model, 0.5, initial={"arm.joint1.angle": 0.3, "arm.joint2.angle": -0.5})
    signal = model.outputs[0].name.replace(".", "_")
    for kind in ("CoSimulation", "ModelExchange"):
        rows = simulate_fmu(
            str(path),
            fmi_type=kind,
            stop_time=0.5,
            output_interval=1e-2,
            start_values=wanted,
            step_size=1e-3,
            relative_tolerance=1e-8,
            record_events=False,
        )
        own = expected.values[::10, 0]
        bound = 1e-9 if kind == "CoSimulation" else 1e-5
        assert np.abs(rows[signal] - own).max() <= bound * np.abs(own).max(), kind


def test_stuck_joints_follow_the_start(timed_model: Model, exported: Any) -> None:
    """With a speed given the joint starts sliding, without one stuck; after the start no state can be set."""
    speed = next(s.name for s in timed_model.states if s.name.endswith("speed"))
    with slave(exported(timed_model)) as (instance, description, _):
        vr, mode = reference(description, speed), reference(description, "friction.mode")
        assert instance.getReal([vr]) == [0.0]
        _start(instance)
        assert instance.getInteger([mode]) == [0]
        with pytest.raises(FMICallException):
            instance.setReal([vr], [1.0])
        instance.reset()
        instance.setReal([vr], [-2.0])
        assert instance.getReal([vr]) == [-2.0]
        _start(instance)
        assert instance.getReal([vr]) == [-2.0]
        assert instance.getInteger([mode]) == [-1]
        instance.reset()
        assert instance.getReal([vr]) == [0.0]


def test_the_internal_step_follows_the_parameters(smooth_model: Model, exported: Any) -> None:
    """Stiffness a thousandfold: what was wrong by 11 % and what `flexarm run --set` gives right are the same."""
    changed = {"link.flexural_rigidity": 137.422}
    drive = Drive([0.0], [[1.5]])
    expected = simulate(smooth_model, 0.2, parameters=changed, drive=drive)
    assert expected.internal_step < 0.1 * simulate(smooth_model, 0.01, drive=drive).internal_step
    given = fmu.cosim(exported(smooth_model), 0.2, drive=drive, parameters=changed)
    assert np.abs(given.values - expected.values).max() <= 1e-9 * np.abs(expected.values).max()


@pytest.mark.parametrize("factor", [0.01, 0.3, 7.0, 1000.0])
@pytest.mark.parametrize("name", ["link.flexural_rigidity", "motor.rotor_inertia", "gear.ratio"])
def test_the_fmu_chooses_the_step_that_the_runner_chooses(name: str, factor: float, smooth_model: Model) -> None:
    """Gelfand's formula in the FMU's C against numpy's eigenvalues."""
    p = smooth_model.parameter_vector({name: factor * dict(_values(smooth_model))[name]})
    x = np.zeros(len(smooth_model.states))
    assert _gelfand(smooth_model, p, x) == pytest.approx(internal_step(smooth_model, p, x, 1.0), rel=1e-6)


def _values(model: Model) -> list[tuple[str, float]]:
    return [(parameter.name, parameter.value) for parameter in model.parameters]


def _gelfand(model: Model, p: Any, x: Any) -> float:
    """The step by the FMU's own C, compiled alone."""
    internal_step(model, p, x, 1.0)
    matrix = model.jacobian(0, x, [0.0], np.zeros(0), np.zeros(0), p).full()
    text = (Path(fmu.__file__).parent / "heads" / "common.c").read_text(encoding="utf-8")
    begin = text.index("/* The largest |eigenvalue|")
    body = text[begin : text.index("/* -- start ----")]
    code = "#include <math.h>\n#include <string.h>\n" + body
    code = code.replace("static double fa_spectral", '__attribute__((visibility("default"))) double fa_spectral')
    function = library(code).fa_spectral_radius
    function.restype = ctypes.c_double
    n = len(matrix)
    room = (ctypes.c_double * (3 * n * n))(*matrix.ravel())
    return 0.5 / float(function(n, room))


def test_a_change_that_needs_a_finer_step_is_said(smooth_model: Model, exported: Any) -> None:
    with slave(exported(smooth_model)) as (instance, description, messages):
        _start(instance)
        messages.clear()
        stiff = reference(description, "link.flexural_rigidity")
        instance.setReal([stiff], [0.1])
        instance.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e-3)
        assert messages == []
        instance.setReal([stiff], [137.0])
        instance.doStep(currentCommunicationPoint=1e-3, communicationStepSize=1e-3)
        assert len(messages) == 1
        assert "internal step" in messages[0]


def test_events_are_logged_by_name_and_only_when_asked(timed_model: Model, exported: Any) -> None:
    expected = [(t, m) for t, m, _ in simulate(timed_model, 0.8).events if m == "friction" and t > 0]
    with slave(exported(timed_model)) as (instance, _, messages):
        _start(instance)
        for k in range(400):
            instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
        said = len([line for line in messages if "'friction' becomes" in line])
        assert said == sum(t <= 0.4 for t, _ in expected)
        instance.setDebugLogging(False, [])
        messages.clear()
        for k in range(400, 800):
            instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
        with pytest.raises(FMICallException):
            instance.setReal([10**6], [0.0])
        assert messages == []


@pytest.mark.parametrize("version", [2, 3])
def test_nominals_follow_the_run(version: int, tmp_path: Path) -> None:
    model = load("two-link-flexible").build()
    path = fmu.export(model, tmp_path / "n.fmu", platforms=["linux64"], version=version)
    description = read_model_description(str(path))
    by_name = {v.name: v for v in description.modelVariables}
    run = simulate(model, 10.0, record_states=True)
    assert run.states is not None
    for state, values in zip(model.states, run.states.T, strict=True):
        nominal = float(by_name[state.name].nominal)
        assert nominal == pytest.approx(max(SHARE * np.abs(values).max(), FLOORS[state.unit]), rel=1e-9)
    assert min(float(by_name[s.name].nominal) for s in model.states) < 1e-2


def test_the_exchanger_gives_the_nominals_of_the_description(two_link: tuple[Model, Path], tmp_path: Path) -> None:
    model, path = two_link
    description = read_model_description(str(path))
    instance = FMU2Model(
        guid=description.guid,
        unzipDirectory=extract(str(path), str(tmp_path)),
        modelIdentifier=description.modelExchange.modelIdentifier,
        instanceName="n",
    )
    instance.instantiate()
    _start(instance)
    given = (ctypes.c_double * len(model.states))()
    instance.getNominalsOfContinuousStates(given, len(given))
    by_name = {v.name: v for v in description.modelVariables}
    assert list(given) == [float(by_name[state.name].nominal) for state in model.states]
    instance.freeInstance()


def test_a_mode_switch_reports_changed_states(timed_model: Model, exported: Any, tmp_path: Path) -> None:
    """A joint that breaks away keeps its state, but its derivative jumps: the integrator must start afresh."""
    path = exported(timed_model)
    description = read_model_description(str(path))
    instance = FMU2Model(
        guid=description.guid,
        unzipDirectory=extract(str(path), str(tmp_path)),
        modelIdentifier=description.modelExchange.modelIdentifier,
        instanceName="switch",
    )
    instance.instantiate()
    _start(instance)
    mode = reference(description, "friction.mode")
    instance.newDiscreteStates()
    assert instance.newDiscreteStates()[3] is False
    away = next(t for t, name, _ in simulate(timed_model, 0.8).events if name == "friction" and t > 0)
    before = instance.getInteger([mode])
    instance.enterContinuousTimeMode()
    instance.setTime(away + 1e-3)
    instance.enterEventMode()
    assert instance.newDiscreteStates()[3] is True
    assert instance.getInteger([mode]) != before
    assert instance.newDiscreteStates()[3] is False
    instance.freeInstance()


def test_the_tolerance_and_the_terminals_are_described(smooth_model: Model, exported: Any) -> None:
    description = read_model_description(str(exported(smooth_model)))
    assert float(description.defaultExperiment.tolerance) == 1e-6
    assert references(description, "output")
