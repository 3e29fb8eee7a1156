"""The next experiment as files: a scenario that plays the proposed input, and what each rival predicts for it."""

from __future__ import annotations

import csv
import json
from typing import Any

import numpy as np
import pytest

import flexarm
from diagnosis.api import diagnose
from diagnosis.verdict import experiment_design as experiment
from diagnosis.verdict.write import EXPERIMENT, THINNED, write
from scenarios.load import load
from tests.diagnosis import plants

TIED = {"coulomb_friction at motor.shaft", "dead_zone at source.out -> motor.voltage"}
SIGNAL = "motor.shaft.speed"


def forwards(t: Any) -> dict[str, Any]:
    """Inputs in one direction that stay above the dead zone of 0.2 V: the motor never stands, and both are one."""
    return {
        "steps": ("train", np.where(t % 1.0 < 0.6, 1.0, 0.6)),
        "waves": ("train", 0.65 + 0.3 * np.sin(2 * np.pi * 1.3 * t)),
        "ramp": ("hold_out", np.interp(t, [0, 0.5, 1.5, 2.0], [0.3, 1.4, 0.4, 1.0])),
    }


OTHERS = (
    *("stribeck_friction", "direction_dependent_friction", "viscous_friction", "quadratic_drag", "saturation"),
    *("uneven_gain", "lag", "delay", "inductance", "stray_spring", "payload", "outside_vibration", "extra_mode"),
    *("gravity", "torque_ripple", "sensor_scale", "sensor_lag", "sensor_bias", "rectified_sensor", "wrong_parameter"),
    *("load_dependent_friction", "current_limit", "cogging", "transmission_error"),
    *("rate_limit", "command_quantisation", "supply_sag", "belt_slack", "end_stop", "warm_up", "friction_warm_up"),
    *("quadratic_load_friction", "dead_time"),
)


@pytest.fixture(scope="module")
def tied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, set[Any]]:
    """Coulomb friction concealed, and few effects tried, so that it is quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plants, "inputs", forwards)
        path = plants.case(tmp_path_factory.mktemp("tied"), coulomb=4.0e-4, seed=3)
    found = diagnose(path, without=OTHERS, overrides=["source.height=2 V", "simulate.stop=1.5 s"])
    folder = path.parent / "out"
    return found, folder, {p.name for p in write(found, folder)}


def columns(path: Any) -> dict[Any, Any]:
    with path.open(newline="") as file:
        names, *rows = list(csv.reader(file))
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def test_one_direction_leaves_a_tie(tied: tuple[Any, Any, set[Any]]) -> None:
    found, folder, files = tied
    assert found.verdict == "tie"
    assert {t.label for t in (found.study.chosen, *found.rivals)} >= TIED
    assert any("one direction only" in warning for warning in found.warnings)
    assert {"next-experiment.csv", "next-experiment.yaml", "next-experiment-predictions.csv"} <= files
    told = json.loads((folder / "diagnosis.json").read_text())["next_experiment"]
    assert set(told["separates"]) >= TIED
    assert told["kind"] == found.proposal.kind


def test_the_scenario_plays_the_proposed_input(tied: tuple[Any, Any, set[Any]]) -> None:
    _, folder, _ = tied
    scenario = load(folder / "next-experiment.yaml")
    assert scenario.recordings == {}
    result = flexarm.simulate(scenario)
    table = columns(folder / "next-experiment.csv")
    assert list(table) == ["t [s]", "motor.voltage [V]"]
    time, drive = table.values()
    played = np.interp(result.time, time, drive)
    np.testing.assert_allclose(result[f"{EXPERIMENT}.out"], played, rtol=0, atol=1e-8)
    assert result.time[-1] == pytest.approx(time[-1])
    largest = max(np.abs(u).max() for _, u in forwards(np.linspace(0, 2, 1001)).values())
    assert np.abs(drive).max() <= largest * 1.001
    assert drive.min() < 0 < drive.max()


def test_the_scenario_says_what_for_and_keeps_what_the_user_wrote(tied: tuple[Any, Any, set[Any]]) -> None:
    found, folder, _ = tied
    text = (folder / "next-experiment.yaml").read_text()
    for label in found.proposal.separates:
        assert label in text
    assert "# measured cold" in text
    sentence = found.proposal.sentence
    assert sentence[:1].upper() + sentence[1:] in text, "units keep their capitals"
    blocks = load(folder / "next-experiment.yaml").system.blocks
    assert set(blocks) == {"source", "motor", EXPERIMENT}


def test_what_was_set_is_written_though_nothing_fits_it(tied: tuple[Any, Any, set[Any]]) -> None:
    """The model was found with a source of 2 V over 1.5 s; the files had that of 1 V over 2 s."""
    _, folder, _ = tied
    amended = load(folder / "amended.yaml")
    assert set(amended.system.blocks) > {"source", "motor"}
    assert amended.system.blocks["source"].values["height"] == 2.0
    assert amended.simulation is not None
    assert amended.simulation.stop == 1.5
    assert load(folder / "next-experiment.yaml").system.blocks["source"].values["height"] == 2.0


def test_the_experiment_drives_the_motor(tied: tuple[Any, Any, set[Any]]) -> None:
    """The model of the file with the true parameters is the plant without its friction."""
    _, folder, _ = tied
    given = [f"motor.resistance={plants.RESISTANCE}", f"motor.rotor_inertia={plants.INERTIA}"]
    result = flexarm.simulate(load(folder / "next-experiment.yaml", given))
    time, drive = columns(folder / "next-experiment.csv").values()
    frictionless = plants.speed(time, drive, parts=5)
    np.testing.assert_allclose(result[SIGNAL], frictionless, rtol=0, atol=0.01 * np.ptp(frictionless))


def test_there_is_a_prediction_for_every_rival_and_signal(tied: tuple[Any, Any, set[Any]]) -> None:
    found, folder, _ = tied
    table = columns(folder / "next-experiment-predictions.csv")
    rivals = found.proposal.separates
    assert rivals[0] == found.study.chosen.label
    assert set(rivals) <= {t.label for t in (found.study.chosen, *found.rivals)}
    assert list(table) == ["t [s]", *(f"{SIGNAL} with {label} [rad/s]" for label in rivals)]
    full = columns(folder / "next-experiment.csv")["t [s]"]
    np.testing.assert_allclose(table["t [s]"], full[::THINNED], atol=1e-9)


def test_the_plant_itself_decides_between_the_predictions(tied: tuple[Any, Any, set[Any]]) -> None:
    """The concealed plant, which is no part of flexarm, is driven by the file: it does as one of the rivals says."""
    _, folder, _ = tied
    time, drive = columns(folder / "next-experiment.csv").values()
    table = columns(folder / "next-experiment-predictions.csv")
    truth = plants.speed(time, drive, coulomb=4.0e-4, parts=20)[::THINNED]
    right, wrong = (
        np.sqrt(np.mean((next(v for name, v in table.items() if label in name) - truth) ** 2)) for label in sorted(TIED)
    )
    assert right < 0.5
    assert wrong > 5 * right


def test_the_proposal_is_the_input_that_separates_best(tied: tuple[Any, Any, set[Any]]) -> None:
    """No other input of the menu keeps the two nearest rivals further apart, in what no scale or shift absorbs."""
    found, _, _ = tied
    size = np.abs(found.proposal.drive).max()
    assert found.proposal.kind in experiment.menu(size)
    assert found.proposal.expected > 5
    assert list(found.proposal.predictions) == list(found.proposal.separates)
    for values in found.proposal.predictions.values():
        assert values.shape[1] == len(found.proposal.signals) == 1
