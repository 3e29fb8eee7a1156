"""``flexarm check --recordings``: what is said of recordings, and the page."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SCENARIO = """\
schema: 1
name: spring
blocks:
  source: {type: Step, height: 0 N.m}
  motor: {type: Torque}
  arm: {type: Inertia, inertia: 0.01 kg.m2}
  spring: {type: GroundSpring, stiffness: 9 N.m/rad, damping: 0.05 N.m.s/rad}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, arm.shaft, spring.shaft]
simulate: {stop: 3 s, step: 2 ms}
recordings:
"""
RECORDING = """\
  NAME:
    file: NAME.csv
    time: {column: t}
    drive: {motor.torque: {column: u, unit: N.m}}
    measurements: {arm.shaft.angle: {column: y, unit: rad}}
"""


@pytest.fixture
def twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same experiment twice, at rest at first; the second time 50 times the noise apart, and three samples lost."""
    from engine.simulate import Drive, simulate
    from scenarios.load import load

    path = tmp_path / "spring.yaml"
    path.write_text(SCENARIO[: SCENARIO.index("recordings")])
    t = 2e-3 * np.arange(1500)
    u = np.where(t < 0.5, 0.0, np.sign(np.sin(5 * t)))
    model = load(path).build(["motor.torque"], ["arm.shaft.angle"])
    y = simulate(model, 3.0, 2e-3, drive=Drive(t, u)).values[:1500, 0]
    random = np.random.default_rng(1)
    text = SCENARIO
    for name, slow in (("one", 0.0), ("two", 1.0)):
        noisy = y + random.normal(0, 1e-4, 1500) + slow * 7e-3 * np.sin(4 * t) * (t > 0.5)
        rows = np.column_stack([t, u, noisy])
        rows = np.delete(rows, [900, 901, 1200], axis=0) if slow else rows
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,y", comments="")
        text += RECORDING.replace("NAME", name)
    path.write_text(text)
    monkeypatch.chdir(tmp_path)
    return path


def test_noise_clock_and_repeats(twice: Path, command: Callable[..., Any]) -> None:
    answer = command("check", twice.name, "--recordings", "--json")
    assert answer.code == 0, answer.err
    found = json.loads(answer.out)
    row = found["recordings"]["one"]["signals"]["arm.shaft.angle"]
    assert row["noise_from"] == "at rest"
    assert row["noise"] == pytest.approx(1e-4, rel=0.15)
    assert row["correlation"] > 0.999
    assert found["recordings"]["two"]["dropped"] == 3
    assert any("3 samples missing" in warning["text"] for warning in found["warnings"])
    assert not any(warning["grave"] for warning in found["warnings"])


def test_the_page(twice: Path, command: Callable[..., Any]) -> None:
    text = twice.with_name("two.csv").read_text().splitlines()
    whole = np.loadtxt(twice.with_name("one.csv"), delimiter=",", skiprows=1)
    whole[:, 2] += 7e-3 * np.sin(4 * whole[:, 0]) * (whole[:, 0] > 0.5)
    assert len(text) == 1498
    np.savetxt(twice.with_name("two.csv"), whole, delimiter=",", header="t,u,y", comments="")
    answer = command("check", twice.name, "--recordings", "--report", "page.html")
    assert answer.code == 0, answer.err
    assert "one and two: arm.shaft.angle apart by" in answer.out
    assert "no model can do better" in answer.out
    page = twice.with_name("page.html").read_text()
    for piece in ("Spectra", "Clocks", "Repeated experiments", "at rest", "data-plot"):
        assert piece in page


def test_options_that_need_recordings(twice: Path, command: Callable[..., Any]) -> None:
    answer = command("check", twice.name, "--report", "page.html")
    assert answer.code == 1
    assert "--report is about recordings" in answer.err
    answer = command("check", twice.name, "--recordings", "--report", "page.pdf")
    assert answer.code == 1
    assert ".html" in answer.err
    twice.write_text(SCENARIO[: SCENARIO.index("recordings")])
    answer = command("check", twice.name, "--recordings")
    assert answer.code == 1
    assert "describes no recordings" in answer.err
