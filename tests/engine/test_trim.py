"""Equilibria against closed forms, and the errors where there is none, or more than one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.errors import ParameterError
from engine.linearise import linearise
from engine.model import Model
from engine.trim import TrimError, trim
from scenarios.load import load

MASS, RADIUS, GRAVITY = 0.147755, 0.147585, 9.81


def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Model:
    text = """\
schema: 1
name: swing
blocks:
  drive: {type: Torque}
  arm: {type: Inertia, inertia: 3.3e-3 kg.m2}
  weight: {type: GravityTorque, mass: 0.147755 kg, radius: 0.147585 m}
connect:
  - [drive.shaft, arm.shaft, weight.shaft]
"""
    path = tmp_path_factory.mktemp("trim") / "swing.yaml"
    path.write_text(text)
    return load(path).build(["drive.torque"], ["arm.shaft.angle"])


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Model:
    return pendulum(tmp_path_factory)


@pytest.fixture(scope="module")
def bare() -> Model:
    return load("srv02-bare").build(["motor.voltage"], ["motor.shaft.speed", "motor.current"])


def motor_volts(speed: float, dry: float = 2.25e-4) -> float:
    """Gao, equations 2.6 and 2.10 at steady speed."""
    return 2.6 / (0.69 * 7.68e-3) * (1.26e-6 * speed + dry * math.copysign(1, speed)) + 7.68e-3 * speed


def test_a_torque_holds_a_pendulum_aside(swing: Model) -> None:
    found = trim(swing, fix={"arm.shaft.angle": 0.5}, free=["drive.torque"])
    assert found.inputs["drive.torque"] == pytest.approx(MASS * GRAVITY * RADIUS * math.sin(0.5), rel=1e-9)
    held = trim(swing, inputs={"drive.torque": 0.1})
    assert held.states["drive.shaft.angle"] == pytest.approx(math.asin(0.1 / (MASS * GRAVITY * RADIUS)), rel=1e-8)
    up = math.pi - math.asin(0.1 / (MASS * GRAVITY * RADIUS))
    assert [other["drive.shaft.angle"] % (2 * math.pi) for other in held.others] == pytest.approx([up], rel=1e-8)
    linear = linearise(swing, **held.arguments())
    assert not linear.moving
    assert linear.poles()[0].imag == pytest.approx(
        -math.sqrt(MASS * GRAVITY * RADIUS * math.cos(held.states["drive.shaft.angle"]) / 3.3e-3), rel=1e-8
    )


def test_a_start_without_a_direction_is_left(swing: Model) -> None:
    """Half way between hanging and standing the gravity torque has no slope."""
    found = trim(swing, at={"arm.shaft.angle": math.pi / 2})
    assert math.sin(found.states["drive.shaft.angle"]) == pytest.approx(0.0, abs=1e-9)


def test_too_large_a_torque_has_no_equilibrium(swing: Model) -> None:
    with pytest.raises(TrimError, match=r"no equilibrium: the rate of 'drive.shaft.speed'") as error:
        trim(swing, inputs={"drive.torque": 0.3})
    assert "--free drive.torque" in error.value.remedy


def test_what_nothing_says_is_named(swing: Model) -> None:
    with pytest.raises(TrimError, match=r"not unique: .*'drive.shaft.angle'"):
        trim(swing, free=["drive.torque"], at={"arm.shaft.angle": 0.3})


@pytest.mark.parametrize("speed", [100.0, -40.0])
def test_a_motor_that_turns_steadily(bare: Model, speed: float) -> None:
    found = trim(bare, fix={"motor.shaft.speed": speed}, free=["motor.voltage"])
    assert found.inputs["motor.voltage"] == pytest.approx(motor_volts(speed), rel=1e-9)
    assert found.turning == {"motor.shaft.angle": pytest.approx(speed)}
    assert found.modes == {"friction": "sliding forward" if speed > 0 else "sliding backward"}
    assert found.kept == {"motor.shaft.angle": "indifferent"}
    assert not linearise(bare, **found.arguments()).moving


def test_stuck_and_sliding_are_solved_apart(bare: Model) -> None:
    breakaway = motor_volts(1e-300)
    stuck = trim(bare, inputs={"motor.voltage": 0.99 * breakaway})
    assert stuck.modes == {"friction": "stuck"}
    assert stuck.kept == {"motor.shaft.angle": "stuck"}
    slides = trim(bare, inputs={"motor.voltage": 1.01 * breakaway})
    assert slides.modes == {"friction": "sliding forward"}
    assert motor_volts(slides.states["motor.shaft.speed"]) == pytest.approx(1.01 * breakaway, rel=1e-9)
    level = trim(bare, modes={"friction": "sliding forward"}, fix={"motor.shaft.speed": 0}, free=["motor.voltage"])
    assert level.inputs["motor.voltage"] == pytest.approx(breakaway, rel=1e-9)


def test_a_contact_closes_under_a_drive() -> None:
    """The load's bearing takes the contact's torque, by which the gap is closed and the spring pressed."""
    model = load("srv02-backlash").build(["motor.voltage"], ["motor.shaft.speed", "load.shaft.speed"])
    found = trim(model, fix={"load.shaft.speed": 50}, free=["motor.voltage"])
    assert found.modes == {"friction": "sliding forward", "contact.contact": "positive face"}
    assert set(found.turning) == {"motor.shaft.angle", "contact.b.angle"}
    twist = found.states["motor.shaft.angle"] - found.states["contact.b.angle"]
    assert twist == pytest.approx(0.03 + 1.98e-6 * 50 / 0.013, rel=1e-8)
    assert found.inputs["motor.voltage"] == pytest.approx(
        2.6 / (0.69 * 7.68e-3) * ((1.26e-6 + 1.98e-6) * 50 + 2.25e-4) + 7.68e-3 * 50, rel=1e-9
    )
    assert not linearise(model, **found.arguments()).moving


def test_memories_of_a_sampled_loop_settle(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A sampled integrator holds what the gravity torque takes."""
    text = """\
schema: 1
name: held
blocks:
  reference: {type: Constant, value: 0.5 rad}
  error: {type: Sum, signs: "+-"}
  control: {type: DiscreteStateSpace, A: [[1]], B: [[0.01]], C: [[2]], D: [[0.1]], period: 10 ms, unit: N.m}
  drive: {type: Torque}
  arm: {type: Inertia, inertia: 3.3e-3 kg.m2}
  weight: {type: GravityTorque, mass: 0.147755 kg, radius: 0.147585 m}
connect:
  - [reference.out, error.a]
  - [arm.shaft.angle, error.b]
  - [error.out, control.in]
  - [control.out, drive.torque]
  - [drive.shaft, arm.shaft, weight.shaft]
"""
    path = tmp_path_factory.mktemp("trim") / "held.yaml"
    path.write_text(text)
    model = load(path).build(["error.a"], ["arm.shaft.angle", "control.out"])
    found = trim(model, inputs={"error.a": 0.5})
    torque = MASS * GRAVITY * RADIUS * math.sin(0.5)
    assert found.outputs["arm.shaft.angle"] == pytest.approx(0.5, rel=1e-9)
    assert found.outputs["control.out"] == pytest.approx(torque, rel=1e-9)
    assert found.states["control.x1"] == pytest.approx(torque / 2, rel=1e-9)


def test_wrong_names_and_bounds(bare: Model) -> None:
    with pytest.raises(ParameterError, match=r"'motor.volts' is not an input that can be free"):
        trim(bare, free=["motor.volts"])
    with pytest.raises(ParameterError, match=r"'motor.shaft.sped' is no state"):
        trim(bare, fix={"motor.shaft.sped": 1.0})
    with pytest.raises(ParameterError, match="both fixed and free"):
        trim(bare, fix={"motor.voltage": 1.0}, free=["motor.voltage"])
    with pytest.raises(ParameterError, match="cannot be bounded") as error:
        trim(bare, bounds={"motor.voltage": (0.0, 1.0)})
    assert "name it as free" in error.value.remedy
    with pytest.raises(ParameterError, match="hold nothing"):
        trim(bare, free=["motor.voltage"], bounds={"motor.voltage": (2.0, 1.0)})
    with pytest.raises(TrimError, match="no equilibrium"):
        trim(bare, fix={"motor.shaft.speed": 100.0}, free=["motor.voltage"], bounds={"motor.voltage": (-0.5, 0.5)})


def test_the_same_search_gives_the_same_numbers(swing: Model) -> None:
    one, other = (trim(swing, inputs={"drive.torque": 0.1}) for _ in range(2))
    assert one.states == other.states
    assert one.others == other.others
    assert np.array_equal(one.point.x, other.point.x)
