"""The motor against its law and its energy, and what a diagnosis tries beside it."""

import numpy as np
import pytest

import flexarm
from flexarm.effects import possible_effects

CONSTANT, SATURATION, INERTIA = 0.1, 12.0, 1e-3
SCENARIO = """\
schema: 1
name: spin-up
blocks:
  current: {type: Sine, amplitude: 20 A, frequency: 5 rad/s}
  motor: {type: TorqueMotor, torque_constant: 0.1 N.m/A, saturation_current: 12 A, rotor_inertia: 1e-3 kg.m2}
connect:
  - [current.out, motor.current]
simulate: {stop: 1 s, step: 1 ms, record: [motor.torque, motor.shaft.speed, motor.shaft.acceleration]}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The rotor alone, driven far into saturation."""
    path = tmp_path_factory.mktemp("motor") / "spin-up.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return flexarm.simulate(flexarm.load(path))


def test_the_iron_saturates(run):
    """kt i / sqrt(1 + (i / is)^2), and the rotor takes all of it."""
    i = 20 * np.sin(5 * run.time)
    expected = CONSTANT * i / np.sqrt(1 + (i / SATURATION) ** 2)
    np.testing.assert_allclose(run["motor.torque"], expected, atol=1e-12)
    np.testing.assert_allclose(run["motor.shaft.acceleration"], expected / INERTIA, atol=1e-8)
    assert np.abs(expected).max() < CONSTANT * SATURATION


def test_a_joint_may_hang_on_the_motor(rig):
    """`cut_after` lets a diagnosis try what a joint behind the shaft may lack."""
    keys = {c.key for c in possible_effects(rig)}
    place = "motor.shaft -> bearing.shaft"
    assert {f"{e} at {place}" for e in ("joint_flexibility", "backlash", "hardening_spring", "hysteresis")} <= keys
