"""FMUs with a variable internal step, and with further signals to record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException

import fmu
from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import Drive, simulate
from flexarm.api import export
from flexarm.cli import main
from fmu.variables import flat
from fmu.verify import references, slave
from scenarios.load import load

ENDS: dict[str, Any] = {"fmi_type": "CoSimulation", "stop_time": 0.5, "output_interval": 1e-2}


@pytest.mark.parametrize("version", [2, 3])
def test_the_error_follows_the_importers_tolerance(version: int, tmp_path: Path) -> None:
    """A stiff drive of three masses, against a step twenty times shorter than the chosen one."""
    model = load("srv02-3mass-b2").build(outputs=["motor.shaft.speed", "link.shaft.speed", "contact.torque"])
    path = fmu.export(model, tmp_path / "m.fmu", platforms=["linux64"], version=version, variable_step=1e-5)
    assert fmu.validate(path) == []
    fine = simulate(model, 0.5, 1e-2, internal_step=2e-5)
    found = {}
    for tolerance in (1e-3, 1e-6, 1e-9):
        rows = simulate_fmu(str(path), relative_tolerance=tolerance, **ENDS)
        given = np.column_stack([rows[flat(output.name)] for output in model.outputs])
        found[tolerance] = float((np.abs(given - fine.values).max(axis=0) / np.ptp(fine.values, axis=0)).max())
    assert found[1e-3] < 1e-4
    assert found[1e-6] < 1e-6
    assert found[1e-9] < 1e-8
    assert found[1e-3] > 30 * found[1e-6] > 900 * found[1e-9]


def test_switches_clocks_and_saved_states(switching_model: Model, tmp_path: Path) -> None:
    """Stick, play and a sampled controller; the same from a saved state, however time is divided on the grid."""
    path = fmu.export(switching_model, tmp_path / "m.fmu", platforms=["linux64"], variable_step=1e-9)
    drive = Drive([0.0], [[1.5]])
    coarse, dense = (fmu.cosim(path, 0.4, step, drive=drive).values[-1] for step in (1e-2, 1e-3))
    assert np.array_equal(coarse, dense)
    fine = simulate(switching_model, 0.4, 1e-3, drive=drive, internal_step=2e-5).values
    assert (np.abs(dense - fine[-1]) <= 2e-5 * np.abs(fine).max(axis=0)).all()
    with slave(path) as (instance, description, messages):
        instance.setupExperiment(startTime=0.0, tolerance=1e-7)
        instance.enterInitializationMode()
        instance.setReal(references(description, "input"), [1.5])
        instance.exitInitializationMode()
        y = references(description, "output")

        def run(first: int, last: int) -> list[float]:
            for k in range(first, last):
                instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
            return list(instance.getReal(y))

        run(0, 100)
        blob = instance.serializeFMUstate(instance.getFMUstate())
        onward = run(100, 200)
        instance.setFMUstate(instance.deSerializeFMUstate(blob))
        assert run(100, 200) == onward
        instance.reset()
        messages.clear()
        with pytest.raises(FMICallException):
            instance.setupExperiment(startTime=0.0, tolerance=-1.0)
        assert "tolerance" in messages[-1]


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, 0.5, float("nan")])
def test_tolerances_that_make_no_sense_are_refused(tolerance: float, smooth_model: Model, tmp_path: Path) -> None:
    with pytest.raises(FlexarmError, match=r"tolerance of the variable step.*\n.*1e-12 to 0.01"):
        fmu.export(smooth_model, tmp_path / "m.fmu", platforms=["linux64"], variable_step=tolerance)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("version", [2, 3])
def test_results_are_local_variables_with_the_simulations_values(version: int, tmp_path: Path) -> None:
    scenario = load("srv02-backlash")
    path = export(
        scenario,
        tmp_path / "m.fmu",
        inputs=["motor.voltage"],
        outputs=["load.shaft.speed"],
        results=["contact.torque", "motor.*"],
        platforms=["linux64"],
        version=version,
        linear_twin=True,
    )
    assert fmu.validate(path) == []
    variables = {v.name: v for v in read_model_description(str(path)).modelVariables}
    assert [n for n, v in variables.items() if v.causality == "output"] == ["load_shaft_speed", "load_shaft_speed_lin"]
    names = ["contact.torque", "motor.current"]
    assert {variables[name].causality for name in names} == {"local"}
    assert variables["motor.current"].unit == "A"
    model = scenario.build(["motor.voltage"], names)
    expected = simulate(model, 0.5, 1e-2, drive=Drive([0.0], [[1.0]]), internal_step=1e-4).values
    rows = simulate_fmu(str(path), output=names, start_values={"motor_voltage": 1.0}, **ENDS)
    for k, name in enumerate(names):
        assert np.abs(rows[name][1:] - expected[1:, k]).max() <= 1e-4 * np.ptp(expected[:, k]), name


def test_names_that_fit_nothing_and_options_that_do_not_go_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*arguments: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main(["export", "srv02-backlash", "-o", str(tmp_path / "x.fmu"), *arguments])
        assert ended.value.code not in (0, None)
        return capsys.readouterr().err

    assert "no signal is called 'contact.torqe'" in said("--results", "contact.torqe")
    assert "contact.torque" in said("--results", "contact.torqe")
    assert "--variable-step" in said("--backend", "python", "--variable-step", "1e-6")
    assert "1e-12 to 0.01" in said("--variable-step", "3")
    assert not list(tmp_path.iterdir())
