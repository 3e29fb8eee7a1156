"""Model Exchange: another integrator on the same equations agrees with Co-Simulation."""

from __future__ import annotations

import ctypes
import html
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model

import fmu
from engine.model import Model
from engine.simulate import Drive, simulate
from fmu.variables import flat
from fmu.verify import reference
from scenarios.load import load

SETTINGS: dict[str, Any] = {"stop_time": 0.8, "output_interval": 1e-2, "solver": "CVode"}


def _exchange(path: Path, tolerance: float, level: float | None = None) -> Any:
    signal = None
    if level is not None:
        name = next(v.name for v in read_model_description(str(path)).modelVariables if v.causality == "input")
        signal = np.array([(0.0, level), (1.0, level)], dtype=[("time", float), (name, float)])
    return simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        relative_tolerance=tolerance,
        input=signal,
        record_events=False,
        **SETTINGS,
    )


@pytest.fixture(scope="module", params=[2, 3])
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("exchange")

    def make(model: Model) -> Path:
        name = f"{model.name.replace(' ', '_')}.fmu"
        return fmu.export(model, folder / name, platforms=["linux64"], version=request.param)

    return make


@pytest.mark.parametrize(
    ("name", "level", "bound"),
    [("smooth_model", 1.5, 1e-6), ("switching_model", 1.5, 2e-5), ("timed_model", None, 1e-6)],
)
def test_cvode_agrees_with_fine_co_simulation(
    name: str, level: float | None, bound: float, both: Any, request: pytest.FixtureRequest
) -> None:
    """The switching model samples at 1 kHz, so its step stays 1 ms outside while integrating at 0.1 ms inside."""
    model = request.getfixturevalue(name)
    drive = None if level is None else Drive([0.0], [[level]])
    fine = simulate(model, 0.8, 1e-2, drive=drive, internal_step=5e-5)
    rows = _exchange(both(model), 1e-9, level)
    assert len(rows) == 81
    for output, values in zip(model.outputs, fine.values.T, strict=True):
        if output.unit.endswith(("s2", "N.m")):
            continue
        given = rows[flat(output.name)]
        scale = np.abs(values).max()
        assert np.abs(given - values).max() <= bound * scale, output.name


def test_stick_slip_happens_at_the_same_instants(timed_model: Model, exported: Any, tmp_path: Path) -> None:
    """Events as CVODE finds them on the indicators, against those that Co-Simulation locates to 1e-13 of a step."""
    expected = [
        t for t, mode, _ in simulate(timed_model, 0.8, internal_step=1e-4).events if mode == "friction" and t > 0
    ]
    path = exported(timed_model)
    rows = simulate_fmu(
        str(path), fmi_type="ModelExchange", relative_tolerance=1e-9, output=["friction.mode"], **SETTINGS
    )
    changes = np.flatnonzero(np.diff(rows["friction.mode"]))
    given = rows["time"][changes + 1]
    assert len(expected) >= 2
    assert len(given) == len(expected)
    assert np.allclose(given, expected, atol=2e-6)


def test_indicators_are_named_in_the_documentation(switching_model: Model, exported: Any) -> None:
    """Each by the name that the description has, and in its order."""
    path = exported(switching_model)
    variables = read_model_description(str(path)).modelVariables
    names = [v.name for v in variables if "indicator" in v.name]
    assert len(names) == 2 * sum(mode.kind != "time" for mode in switching_model.modes)
    with zipfile.ZipFile(path) as archive:
        page = archive.read("documentation/index.html").decode()
    section = page.partition("<h2>Event indicators</h2>")[2].partition("<h2>")[0]
    places = [section.index(f"<td>{html.escape(name)}</td>") for name in names]
    assert places == sorted(places)


def test_indicators_rest_above_zero_and_calls_out_of_order_are_refused(
    switching_model: Model, exported: Any, tmp_path: Path
) -> None:
    path = exported(switching_model)
    description = read_model_description(str(path))
    extract(str(path), str(tmp_path))
    instance = FMU2Model(
        guid=description.guid,
        unzipDirectory=str(tmp_path),
        modelIdentifier=description.modelExchange.modelIdentifier,
        instanceName="instance",
    )
    count = description.numberOfEventIndicators
    assert count == 2 * sum(mode.kind != "time" for mode in switching_model.modes)
    instance.instantiate()
    try:
        instance.setupExperiment(startTime=0.0)
        with pytest.raises(FMICallException):
            instance.enterContinuousTimeMode()
        instance.enterInitializationMode()
        instance.exitInitializationMode()
        info = instance.newDiscreteStates()
        assert (info[3], info[4], info[5]) == (False, True, 1e-3)
        instance.enterContinuousTimeMode()
        indicators = (ctypes.c_double * count)()
        instance.getEventIndicators(indicators, count)
        assert all(z > 0 for z in indicators)
        states = (ctypes.c_double * len(switching_model.states))()
        instance.getContinuousStates(states, len(states))
        rows = simulate(switching_model, 1e-3, record_states=True).states
        assert rows is not None
        assert np.array_equal(list(states), rows[0])
        with pytest.raises(FMICallException):
            instance.getContinuousStates(states, len(states) - 1)
        with pytest.raises(FMICallException):
            instance.setTime(float("nan"))
        gear = reference(description, "gear.ratio")
        with pytest.raises(FMICallException):
            instance.setReal([gear], [50.0])
        instance.enterEventMode()
        instance.setReal([gear], [50.0])
        assert instance.getReal([gear]) == [50.0]
    finally:
        instance.freeInstance()


RUBBING = """\
schema: 1
name: rubbing
blocks:
  source: {type: Constant, value: 0 V}
  motor: {type: DCMotor, resistance: 1.3 ohm, inductance: 0.9 mH, torque_constant: 0.042, rotor_inertia: 1.1e-5}
  bearing: {type: BearingFriction, coulomb_friction: 30 mN.m}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, bearing.shaft]
"""


def test_a_recorded_input_given_as_steps_runs_at_fmpys_default_tolerance(both: Any, tmp_path: Path) -> None:
    """As the guide says; held against the runner's own integrator, with the drive held between its rows."""
    (tmp_path / "rubbing.yaml").write_text(RUBBING)
    model = load(tmp_path / "rubbing.yaml").build(["motor.voltage"], ["motor.current", "motor.shaft.speed"])
    t = np.linspace(0, 1, 1001)
    u = 12 * np.sin(12 * t)
    rows = zip(np.repeat(t, 2)[1:], np.repeat(u, 2)[:-1], strict=True)
    steps = np.array(list(rows), dtype=[("time", float), ("motor_voltage", float)])
    made = simulate_fmu(
        str(both(model)),
        fmi_type="ModelExchange",
        input=steps,
        stop_time=1.0,
        output_interval=1e-2,
        record_events=False,
    )
    own = simulate(model, 1.0, 1e-3, drive=Drive(t, u[:, None], ("zero_order",)))
    for name in ("motor.current", "motor.shaft.speed"):
        expected = own[name][::10]
        np.testing.assert_allclose(made[flat(name)], expected, atol=1e-3 * np.abs(expected).max())
