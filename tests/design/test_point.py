"""Where a linear model is taken: what the user gives counts over the file, and over what is assumed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import flexarm
from engine.errors import FlexarmError
from scenarios.load import load

SLIDE = """\
schema: 1
name: pushed-table
blocks:
  drive: {type: Force}
  nut: {type: Mass, mass: 1 kg}
  play: {type: TranslationalBacklash, stiffness: 5e5 N/m, damping: 1e3 N.s/m, half_gap: 20 um}
  table: {type: Mass, mass: 30 kg}
  rest: {type: TranslationalGroundSpring, stiffness: 1e4 N/m, damping: 10 N.s/m}
  push: {type: Constant, value: -120 N}
  weight: {type: Force}
connect:
  - [drive.flange, nut.flange, play.a, rest.slide]
  - [play.b, table.flange, weight.flange]
  - [push.out, weight.force]
simulate: {stop: 1 s, step: 1 ms}
"""

HELD = """\
schema: 1
name: held-arm
blocks:
  source: {type: Constant, value: 0 V}
  motor: {type: DCMotor, resistance: 0.5 ohm, torque_constant: 0.1 N.m/A, rotor_inertia: 1e-4 kg.m2}
  weight: {type: GravityTorque, mass: 1 kg, radius: 0.2 m, gravity: 9.80665 m/s2}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, weight.shaft]
simulate: {stop: 1 s, step: 1 ms}
analyses:
  level: {kind: trim, inputs: [motor.voltage], outputs: [motor.current], free: [motor.voltage]}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("face", ["positive face", "negative face", "gap open"])
def test_a_mode_that_is_given_holds_at_the_equilibrium_that_is_assumed(tmp_path: Path, face: str) -> None:
    path = written(tmp_path, SLIDE)
    asked = {"inputs": ("drive.force",), "outputs": ("table.flange.position",)}
    found = flexarm.linearise(path, **asked, modes={"play.contact": face})  # type: ignore[arg-type]
    assert found.modes["play.contact"] == face
    # The table is pushed against one face, and that is where the model is taken if nothing is asked.
    assert flexarm.linearise(path, **asked).modes["play.contact"] == "positive face"  # type: ignore[arg-type]


def test_an_input_that_is_fixed_is_no_longer_free_as_the_file_has_it(tmp_path: Path) -> None:
    path = written(tmp_path, HELD)
    found = flexarm.trim(path, fix={"motor.voltage": "0.3 V"})
    assert found.inputs["motor.voltage"] == pytest.approx(0.3)
    # k u / R = m g r sin(angle)
    assert found.states["motor.shaft.angle"] == pytest.approx(math.asin(0.1 * 0.3 / 0.5 / (9.80665 * 0.2)), rel=1e-6)
    with pytest.raises(FlexarmError, match="both fixed and free"):
        flexarm.trim(path, fix={"motor.voltage": "0.3 V"}, free=["motor.voltage"])


def test_one_free_input_as_a_plain_text(tmp_path: Path) -> None:
    path = written(tmp_path, HELD)
    found = flexarm.trim(path, fix={"motor.shaft.angle": "30 deg"}, free="motor.voltage")
    assert found.inputs["motor.voltage"] == pytest.approx(9.80665 * 0.2 * math.sin(math.pi / 6) * 0.5 / 0.1, rel=1e-6)


def test_snapshots_are_at_their_interval(tmp_path: Path) -> None:
    """A falling arm, rows every 10 ms: every 15 ms was every 20 ms. The weight's slope is -m g r cos(angle) / J."""
    path = written(tmp_path, HELD.replace("simulate:", "initial: {motor.shaft.angle: 2 rad}\nsimulate:"))
    loaded = load(path, ["simulate.step=10 ms", "simulate.stop=0.3 s"])
    found = flexarm.linear_family(loaded, snapshots=0.015, inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
    (axis,) = found.axes
    assert axis.values == pytest.approx(0.015 * np.arange(21), abs=1e-12)
    run = flexarm.simulate(loaded, step=7.5e-3)
    angle = run["motor.shaft.angle"][::2]
    again = flexarm.linear_family(loaded, snapshots="15 ms", inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
    np.testing.assert_array_equal(again.axes[0].values, axis.values)
    assert found.x0[:, 0] == pytest.approx(angle, abs=1e-6)
    assert found.A[:, 1, 0] == pytest.approx(-9.80665 * 0.2 * np.cos(angle) / 1e-4, rel=1e-5)
    for given in ({"trim": "auto"}, {"at": {"motor.shaft.angle": 1.0}}):
        with pytest.raises(FlexarmError, match="snapshots are at the points of the run"):
            flexarm.linear_family(loaded, snapshots=0.015, **given)
    with pytest.raises(FlexarmError, match=r"no values are given for 'motor\.resistance'"):
        flexarm.linear_family(loaded, grid={"motor.resistance": []})


def test_times_and_bounds_that_are_given_as_one_guesses(tmp_path: Path) -> None:
    path = written(tmp_path, HELD)
    by_text, by_number = flexarm.simulate(path, stop="0.1 s", step="5 ms"), flexarm.simulate(path, stop=0.1, step=5e-3)
    np.testing.assert_array_equal(by_text.time, by_number.time)
    with pytest.raises(FlexarmError, match=r"stop: .*'0.1 V'"):
        flexarm.simulate(path, stop="0.1 V")
    for ends in (5, "5 V", (1, 2, 3)):
        with pytest.raises(FlexarmError, match=r"the bounds of 'motor.voltage' are "):
            flexarm.trim(path, bounds={"motor.voltage": ends})  # type: ignore[dict-item]
