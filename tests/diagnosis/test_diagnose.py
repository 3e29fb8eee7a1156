"""Diagnosis on recordings that flexarm did not make: the right name, the right place, the right size, and restraint."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm
from diagnosis.api import diagnose, fit
from diagnosis.verdict.write import write
from engine.errors import CompilerUnavailable
from scenarios.load import load
from tests.diagnosis.plants import INERTIA, RESISTANCE, case


@pytest.fixture(scope="module")
def sticky(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    folder = tmp_path_factory.mktemp("sticky")
    return diagnose(case(folder, coulomb=4.0e-4, seed=3)), folder


def test_concealed_coulomb_friction_is_named_placed_and_sized(sticky: tuple[Any, Any]) -> None:
    found, _ = sticky
    assert found.verdict == "named"
    (finding,) = found.findings
    assert finding["effect"] == "coulomb_friction"
    assert finding["place"] == "motor.shaft"
    size = finding["parameters"]["coulomb_friction"]
    assert size["low"] <= 4.0e-4 <= size["high"]
    assert size["value"] == pytest.approx(4.0e-4, rel=0.15)
    assert found.study.chosen.hold_out < 1.2
    assert found.study.refit.hold_out > 20
    odds = found.numbers()["place_odds"]
    assert max(odds, key=odds.get) == "motor.shaft"
    assert sum(odds.values()) == pytest.approx(1.0)


def test_the_files_hold_together(sticky: tuple[Any, Any], tmp_path: Path) -> None:
    found, _ = sticky
    made = write(found, tmp_path / "out")
    assert {p.name for p in made} == {
        "diagnosis.json",
        "amended.yaml",
        "held-out.png",
        "places.png",
        "before-after.png",
        "recovered-force.png",
    }
    verdict = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert verdict["verdict"] == "named"
    assert verdict["fit"]["hold_out"]["amended"]["motor.shaft.speed"]["chi2"] < 1.2
    amended = load(tmp_path / "out" / "amended.yaml")
    text = amended.path.read_text()
    assert "# measured cold" in text
    assert "95 % interval" in text
    better = flexarm.compare(amended, "ramp").signals["motor.shaft.speed"].rmse
    worse = flexarm.compare(found.study.scenario, "ramp").signals["motor.shaft.speed"].rmse
    assert better < 0.35 < worse
    linear = flexarm.linearise(amended, inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
    assert linear.inputs == ("motor.voltage",)


def test_a_concealed_dead_zone_is_told_from_friction(tmp_path: Path) -> None:
    found = diagnose(case(tmp_path, dead=0.15, seed=5))
    assert found.verdict == "named"
    (finding,) = found.findings
    assert finding["effect"] == "dead_zone"
    upper, lower = finding["parameters"]["upper"], finding["parameters"]["lower"]
    assert upper["value"] == pytest.approx(0.15, rel=0.1)
    assert lower["value"] == pytest.approx(-0.15, rel=0.1)


def test_nothing_is_found_where_nothing_is_concealed(tmp_path: Path) -> None:
    found = diagnose(case(tmp_path, seed=8))
    assert found.verdict == "none"
    assert found.study.refit.hold_out < 1.2
    assert found.study.nominal[1] > 2


def test_an_inertia_far_outside_its_tolerance_is_a_wrong_parameter(tmp_path: Path) -> None:
    found = diagnose(case(tmp_path, inertia=3.0 * INERTIA, seed=11))
    assert found.verdict in ("wrong_parameter", "tie")
    named = {c.effect for t in (found.study.chosen, *found.rivals) for c in t.effects}
    places = {c.place for t in (found.study.chosen, *found.rivals) for c in t.effects}
    assert named <= {"wrong_parameter", "payload"}
    assert "motor.rotor_inertia" in places


def test_a_fit_recovers_what_the_recordings_hold(tmp_path: Path) -> None:
    """Resistance and inertia trade off against other parameters; gain and time constant do not."""
    made, scores = fit(case(tmp_path, seed=2))
    p = made.parameters()
    km, eta = p["motor.back_emf_constant"], p["motor.efficiency"]
    constant = eta * p["motor.torque_constant"] / p["motor.resistance"]
    rate = (p["motor.viscous_friction"] + constant * km) / p["motor.rotor_inertia"]
    truth = 0.69 * 7.68e-3 / RESISTANCE
    assert constant / p["motor.rotor_inertia"] == pytest.approx(truth / INERTIA, rel=0.01)
    assert rate == pytest.approx((1.26e-6 + truth * 7.68e-3) / INERTIA, rel=0.01)
    assert scores["held out"] < 1.15
    assert made.weak
    for interval in made.intervals():
        assert interval.low <= interval.value <= interval.high


def test_the_verdict_does_not_depend_on_threads(tmp_path: Path) -> None:
    path = case(tmp_path, coulomb=4.0e-4, seed=3)
    runs = [diagnose(path, workers=n).numbers() for n in (1, 2)]
    assert runs[0]["verdict"] == runs[1]["verdict"]
    values = [run["findings"][0]["parameters"]["coulomb_friction"]["value"] for run in runs]
    assert np.ptp(values) == 0.0


@pytest.mark.parametrize("call", [diagnose, fit])
def test_a_missing_compiler_is_told_before_anything_is_simulated(
    call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs fall back on Python, minutes of it, and tangents do not."""

    def missing() -> str:
        raise CompilerUnavailable("no C compiler: the package ziglang is not installed")

    monkeypatch.setattr("diagnosis.api.compiler_version", missing)
    monkeypatch.setattr("engine.native.run", lambda *given: pytest.fail("simulated"))
    with pytest.raises(CompilerUnavailable, match="ziglang"):
        call(case(tmp_path))
