"""Where a linear model is taken: what the user gives counts over the file, and over what is assumed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import flexarm
from engine.errors import FlexarmError

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
