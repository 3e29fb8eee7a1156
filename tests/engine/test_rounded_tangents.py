"""Tangents of models that round: an encoder reads a motion by the line through its steps, and closes its loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from engine.roundings import jacobian
from engine.simulate import simulate
from engine.tangent import tangents
from scenarios.load import load

SERVO = """schema: 1
name: servo
blocks:
  reference: {{type: Step, height: 1 rad}}
  control:
    type: PID
    proportional_gain: 4 A/rad
    derivative_gain: 0.4 A.s/rad
    derivative_corner: 200 rad/s
    unit: A
    period: {period}
  amplifier: {{type: Gain, gain: 0.1 N.m/A, unit: N.m}}
  motor: {{type: Torque}}
  rotor: {{type: Inertia, inertia: 1 g.m2}}
  bearing: {{type: BearingFriction, viscous_friction: 1 mN.m.s/rad, coulomb_friction: {friction}}}
  encoder: {{type: Encoder, counts_per_revolution: 65536, rounding: {rounding}, period: {period}}}
connect:
  - [reference.out, control.reference]
  - [encoder.out, control.measurement]
  - [control.out, amplifier.in]
  - [amplifier.out, motor.torque]
  - [motor.shaft, rotor.shaft, bearing.shaft, encoder.shaft]
"""
VALUES = {"rotor.inertia": 1e-3, "control.proportional_gain": 4.0, "amplifier.gain": 0.1}


@pytest.mark.parametrize("rounding", ["none", "floor", "round"])
@pytest.mark.parametrize("period", ["0 s", "1 ms"])
@pytest.mark.parametrize("friction", ["0 N.m", "20 mN.m"])
def test_a_loop_that_an_encoder_closes_has_the_slopes_of_runs_that_differ(
    tmp_path: Path, rounding: str, period: str, friction: str
) -> None:
    path = tmp_path / "servo.yaml"
    path.write_text(SERVO.format(rounding=rounding, period=period, friction=friction), encoding="utf-8")
    model = load(path).build(outputs=["encoder.out", "rotor.shaft.angle"])
    found = tangents(model, 0.5, 1e-3, wrt=list(VALUES)).values
    for k, (name, value) in enumerate(VALUES.items()):
        # Far enough for many steps of the encoder, of 1e-4 rad.
        high, low = (simulate(model, 0.5, 1e-3, parameters={name: value * f}).values for f in (1.05, 0.95))
        slope = (high - low) / (0.1 * value)
        assert np.abs(found[:, :, k] - slope).max() < 0.01 * np.abs(slope).max()


def test_only_what_is_moved_is_read_by_a_line() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    rows = ca.vertcat(ca.floor(3 * x) + ca.floor(2 * u), x * ca.floor(5 * u), ca.ceil(x * u))
    slopes: Any = ca.Function("slopes", [x, u], [jacobian(rows, ca.vertcat(x, u), x), jacobian(rows, ca.vertcat(x, u))])
    kept, every = (np.asarray(m) for m in slopes(0.7, 0.5))
    assert kept == pytest.approx(np.array([[3.0, 0.0], [2.0, 0.0], [0.5, 0.7]]))
    assert every == pytest.approx(np.array([[3.0, 2.0], [2.0, 3.5], [0.5, 0.7]]))


@pytest.mark.parametrize(("rounding", "below"), [("floor", 0.5), ("round", 0.0), ("none", 0.0)])
def test_beside_recordings_an_encoder_tells_the_line_through_its_steps(
    tmp_path: Path, rounding: str, below: float
) -> None:
    path = tmp_path / "servo.yaml"
    path.write_text(SERVO.format(rounding=rounding, period="0 s", friction="0 N.m"), encoding="utf-8")
    model = load(path).build(outputs=["encoder.out", "encoder.count", "rotor.shaft.angle"], smooth_readings=True)
    run = simulate(model, 0.5, 1e-3)
    assert np.ptp(run["encoder.count"]) > 1e4
    step = 2 * np.pi / 65536
    assert run["encoder.out"] == pytest.approx(run["rotor.shaft.angle"] - below * step, abs=1e-12)
    assert run["encoder.count"] == pytest.approx(run["encoder.out"] / step)
