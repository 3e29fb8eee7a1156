"""``flexarm fit -o``: the scenario with what was fitted, which fits the recording; intervals that say nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm
from diagnosis.estimation.least_squares import Interval, interval_in_words
from engine.errors import FlexarmError
from scenarios.amend import with_values

WHEEL = """\
schema: 1
name: wheel
parameters:
  mass: 2 kg        # weighed
  radius: 100 mm
blocks:
  push: {type: Step, height: 1 N.m}
  torque: {type: Torque}
  wheel: {type: Inertia, inertia: 0.5 * $mass * $radius^2}
  bearing: {type: BearingFriction, viscous_friction: 0.05 N.m.s/rad}
connect:
  - [push.out, torque.torque]
  - [torque.shaft, wheel.shaft]
  - [wheel.shaft, bearing.shaft]
tolerances: {mass: 50 %}
simulate: {stop: 1 s, step: 5 ms, record: [wheel.shaft.speed]}
recordings:
  spin:
    file: spin.csv
    time: {column: t}
    drive: {torque.torque: {column: u, unit: N.m}}
    measurements: {wheel.shaft.speed: {column: w, unit: rad/s}}
"""
MASS, FRICTION = 2.6, 0.06


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    inertia, t = 0.5 * MASS * 0.1**2, np.arange(0, 1, 0.005)
    speed = (1 - np.exp(-FRICTION / inertia * t)) / FRICTION + np.random.default_rng(1).normal(0, 0.02, len(t))
    np.savetxt("spin.csv", np.column_stack([t, np.ones_like(t), speed]), delimiter=",", header="t,u,w", comments="")
    path = tmp_path / "wheel.yaml"
    path.write_text(WHEEL)
    return path


def test_a_fitted_scenario_is_written_and_fits(wheel: Path, command: Any) -> None:
    Path("out").mkdir()
    answer = command("fit", wheel, "-o", "out/fitted.yaml", "--json")
    assert answer.code == 0, answer.err
    found = json.loads(answer.out)
    values = {name: row["value"] for name, row in found["parameters"].items()}
    assert values["mass"] == pytest.approx(MASS, rel=0.03)
    fitted = flexarm.load("out/fitted.yaml")
    assert fitted.system.blocks["wheel"].values["inertia"] == pytest.approx(values["mass"] * 0.1**2 / 2, rel=1e-7)
    assert fitted.system.blocks["bearing"].values["viscous_friction"] == pytest.approx(FRICTION, rel=0.03)
    text = Path("out/fitted.yaml").read_text()
    assert text.startswith("# wheel.yaml, fitted; 95 % intervals:\n#   ")
    assert "# weighed" in text
    assert "inertia: 0.5 * $mass * $radius^2" in text
    compared = flexarm.compare("out/fitted.yaml", "spin")
    assert compared.signals["wheel.shaft.speed"].rmse == pytest.approx(0.02, rel=0.15)
    spread = found["spread"]
    assert set(spread["names"]) >= {"mass", "bearing.viscous_friction"}
    np.testing.assert_allclose(np.diag(spread["correlation"]), 1.0, rtol=1e-12)
    k = spread["names"].index("mass")
    row = found["parameters"]["mass"]
    width = np.log(row["high"] / row["low"]) if spread["logarithmic"][k] else row["high"] - row["low"]
    assert spread["deviation"][k] == pytest.approx(width / (2 * 1.96), rel=1e-6)


def test_values_are_written_where_they_stand() -> None:
    text = WHEEL.replace("viscous_friction: 0.05 N.m.s/rad", "viscous_friction: 0.05 N.m.s/rad, coulomb_friction: 0")
    made = with_values(text, {"mass": "3 kg", "bearing.coulomb_friction": "1 N.m"}, "head")
    assert made.startswith("# head\n")
    assert "mass: 3 kg" in made
    assert "coulomb_friction: 1 N.m" in made
    with pytest.raises(FlexarmError, match="no place to write 'width'"):
        with_values(text, {"width": 1.0})


def test_what_was_set_is_written_with_what_was_fitted(wheel: Path, command: Any) -> None:
    """A fit of a run of another length ended in 'no place to write simulate.stop', and was lost."""
    settings = ["-s", "radius=0.1 m", "-s", "simulate.stop=2 s", "-s", "tolerances.mass=40 %"]
    answer = command("fit", wheel, *settings, "-o", "fitted.yaml")
    assert answer.code == 0, answer.err
    fitted = flexarm.load("fitted.yaml")
    assert fitted.simulation is not None
    assert fitted.simulation.stop == 2.0
    assert fitted.tolerances["mass"] == pytest.approx(0.4)
    assert "# weighed" in Path("fitted.yaml").read_text()


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(1.8e-8, 9.2e7, "not determined"), (1.0, 2.0, "1 to 2"), (-3.0, 5.0, "-3 to 5"), (1.0, np.inf, "at least 1")],
)
def test_an_interval_that_says_nothing_is_none(low: float, high: float, words: str) -> None:
    assert words in interval_in_words(Interval("motor.resistance", 1.0, low, high, "ohm", 1.0).numbers(), 6)
