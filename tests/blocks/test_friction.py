"""Dry friction: closed forms, an independent integration, and a stick that does not creep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.effort import Force, Torque
from blocks.actuators.friction import (
    BearingFriction,
    JointFriction,
    TranslationalBearingFriction,
    TranslationalJointFriction,
)
from blocks.actuators.spring_damper import SpringDamper
from blocks.controllers.low_pass import LowPass
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia, Mass
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import StructureError
from engine.simulate import Drive, Result
from tests.blocks.assembly import instants, model, run, switches
from tests.blocks.test_drive_train import balance

J = 2e-3


def coast(friction: Block, speed: float, stop: float = 1.0) -> Result:
    parts: dict[str, Block] = {"body": Inertia(inertia=J), "friction": friction}
    return run(parts, "body.shaft friction.shaft", stop=stop, initial={"body.shaft.speed": speed})


@pytest.mark.parametrize(("speed", "level"), [(5.0, 0.03), (-5.0, 0.02)])
def test_coasting_to_rest_against_coulomb_friction(speed: float, level: float) -> None:
    result = coast(BearingFriction(coulomb_friction=0.03, coulomb_friction_backward=0.02), speed)
    rest = J * abs(speed) / level
    assert instants(result, "friction") == pytest.approx([rest], rel=1e-11)
    assert result["body.shaft.angle"][-1] == pytest.approx(speed * rest / 2, rel=1e-11)
    assert result["body.shaft.speed"][-1] == 0.0
    assert result["energy.dissipated"][-1] == pytest.approx(J * speed**2 / 2, rel=1e-9)
    assert balance(result) < 1e-9


def test_coasting_with_viscous_friction_too() -> None:
    b, level, speed = 0.01, 0.03, 5.0
    result = coast(BearingFriction(coulomb_friction=level, viscous_friction=b), speed)
    rest = J / b * np.log(1 + b * speed / level)
    assert instants(result, "friction") == pytest.approx([rest], rel=1e-8)
    assert result["body.shaft.angle"][-1] == pytest.approx((J * speed - level * rest) / b, rel=1e-8)
    assert balance(result) < 1e-8


def test_viscous_friction_alone_never_sticks() -> None:
    result = coast(BearingFriction(viscous_friction=0.01), 5.0)
    np.testing.assert_allclose(result["body.shaft.speed"], 5 * np.exp(-5 * result.time), rtol=0, atol=1e-9)
    assert result.event_count == 0
    assert result.model.modes == ()


def test_stribeck_against_an_independent_integration() -> None:
    fc, fs, vs, b, speed = 0.03, 0.05, 0.8, 0.004, 5.0
    friction = BearingFriction(coulomb_friction=fc, static_friction=fs, stribeck_velocity=vs, viscous_friction=b)
    result = coast(friction, speed)

    def slowing(_: float, y: Any) -> list[float]:
        v = y[1]
        return [v, -(fc + (fs - fc) * np.exp(-((v / vs) ** 2)) + b * v) / J]

    stopped: Any = lambda t, y: y[1]  # noqa: E731
    stopped.terminal = True
    found = integrate.solve_ivp(slowing, (0, 1), [0, speed], events=stopped, rtol=1e-12, atol=1e-14)
    assert instants(result, "friction") == pytest.approx(list(found.t_events[0]), rel=1e-8)
    assert result["body.shaft.angle"][-1] == pytest.approx(found.y[0, -1], rel=1e-8)
    assert balance(result) < 1e-8


def ramp(friction: Block, rate: float, stop: float = 1.0) -> Result:
    parts: dict[str, Block] = {"torque": Torque(), "body": Inertia(inertia=J), "friction": friction}
    drive = Drive([0.0, stop], [[0.0], [rate * stop]], "linear")
    wires = "torque.shaft body.shaft friction.shaft"
    return run(parts, wires, stop=stop, inputs=["torque.torque"], drive=drive)


@pytest.mark.parametrize(("rate", "level"), [(0.1, 0.05), (-0.1, 0.04)])
def test_breakaway_at_the_static_level(rate: float, level: float) -> None:
    friction = BearingFriction(
        coulomb_friction=0.03, static_friction=0.05, static_friction_backward=0.04, stribeck_velocity=1e-3
    )
    result = ramp(friction, rate)
    assert switches(result, "friction") == [np.sign(rate)]
    assert instants(result, "friction") == pytest.approx([level / abs(rate)], rel=1e-9)
    assert (result["body.shaft.angle"][result.time < level / abs(rate)] == 0.0).all()


def test_amplitude_falls_by_four_fc_over_k_per_cycle() -> None:
    k, level, start = 2.0, 0.03, 0.5
    parts: dict[str, Block] = {
        "wall": Fixed(),
        "spring": SpringDamper(stiffness=k),
        "body": Inertia(inertia=J),
        "friction": BearingFriction(coulomb_friction=level),
    }
    wires = ["wall.shaft spring.a", "spring.b body.shaft friction.shaft"]
    result = run(parts, *wires, stop=2.0, initial={"body.shaft.angle": start}, internal_step=2e-4)
    half = np.pi * np.sqrt(J / k)
    turns = []
    amplitude = start
    while amplitude > level / k:
        amplitude -= 2 * level / k
        turns.append(amplitude)
    stops = [t for t, name, value in result.events if name == "friction" and value == 0.0]
    assert stops == pytest.approx([half * (i + 1) for i in range(len(turns))], rel=1e-9)
    rest = abs(turns[-1]) * (1 if len(turns) % 2 == 0 else -1) * np.sign(turns[-1])
    assert result["body.shaft.angle"][-1] == pytest.approx(rest, abs=1e-8)
    assert result["body.shaft.speed"][-1] == 0.0
    assert balance(result) < 1e-8


# -- stick -------------------------------------------------------------------------------------------------------------


def constant(_: float) -> float:
    return 1.0


def sampled_jumps(t: float) -> float:
    return float(np.random.default_rng(round(t * 1000)).choice([-1.0, 1.0]))


HISTORIES: list[Callable[[float], float]] = [constant, sampled_jumps]


def hold(
    parts: dict[str, Block], wires: list[str], inputs: dict[str, float], history: Callable[[float], float]
) -> Result:
    """Ten seconds under torques of the given size, changed every millisecond by the history."""
    time = 1e-3 * np.arange(10_000)
    shape = np.array([history(t) for t in time])
    drive = Drive(time, np.outer(shape, list(inputs.values())))
    return run(parts, *wires, inputs=list(inputs), drive=drive, stop=10.0, step=0.01)


@pytest.mark.parametrize("history", HISTORIES)
def test_no_drift_of_one_element(history: Callable[[float], float]) -> None:
    parts: dict[str, Block] = {
        "torque": Torque(),
        "body": Inertia(inertia=J),
        "friction": BearingFriction(coulomb_friction=0.03, static_friction=0.05),
    }
    result = hold(parts, ["torque.shaft body.shaft friction.shaft"], {"torque.torque": 0.04}, history)
    assert np.ptp(result["body.shaft.angle"]) == 0.0
    assert result.event_count == 0


@pytest.mark.parametrize("history", HISTORIES)
def test_no_drift_of_two_elements_on_one_shaft(history: Callable[[float], float]) -> None:
    parts: dict[str, Block] = {
        "torque": Torque(),
        "body": Inertia(inertia=J),
        "one": BearingFriction(coulomb_friction=0.03, static_friction=0.05),
        "two": BearingFriction(coulomb_friction=0.02),
    }
    wires = ["torque.shaft body.shaft one.shaft two.shaft"]
    result = hold(parts, wires, {"torque.torque": 0.8 * 0.07}, history)
    assert np.ptp(result["body.shaft.angle"]) == 0.0
    assert result.event_count == 0


@pytest.mark.parametrize("history", HISTORIES)
def test_no_drift_between_two_moving_shafts(history: Callable[[float], float]) -> None:
    """The joint carries what accelerates the second body: J2 / (J1 + J2) of the torque, 80 % of its level."""
    j1, j2, level = 2e-3, 3e-3, 0.05
    push = 0.8 * level * (j1 + j2) / j2
    parts: dict[str, Block] = {
        "torque": Torque(),
        "first": Inertia(inertia=j1),
        "second": Inertia(inertia=j2),
        "joint": JointFriction(coulomb_friction=0.03, static_friction=level),
    }
    wires = ["torque.shaft first.shaft joint.a", "joint.b second.shaft"]
    result = hold(parts, wires, {"torque.torque": push}, history)
    assert np.ptp(result["first.shaft.angle"] - result["second.shaft.angle"]) == 0.0
    assert np.abs(result["second.shaft.angle"]).max() > 0.01
    assert result.event_count == 0
    if history is constant:
        np.testing.assert_allclose(result["first.shaft.speed"], push / (j1 + j2) * result.time, rtol=1e-9)


def test_no_drift_behind_a_sampled_filter() -> None:
    """A 1 kHz filter jumps at its instants while the joint holds."""
    parts: dict[str, Block] = {
        "noise": Sine(amplitude="0.04 N.m", frequency=77),
        "filter": LowPass(corner_frequency="400 Hz", period=1e-3),
        "torque": Torque(),
        "body": Inertia(inertia=J),
        "friction": BearingFriction(coulomb_friction=0.03, static_friction=0.05),
    }
    wires = ["noise.out filter.in", "filter.out torque.torque", "torque.shaft body.shaft friction.shaft"]
    result = run(parts, *wires, stop=10.0, step=0.01)
    assert np.abs(result["filter.out"]).max() > 0.02
    assert np.ptp(result["body.shaft.angle"]) == 0.0


def test_a_jump_beyond_breakaway_slips_and_sticks_again() -> None:
    """A sampled pulse of 10 ms above the level: closed form of the slide and of the stop."""
    level, push, width = 0.05, 0.08, 0.01
    parts: dict[str, Block] = {
        "torque": Torque(),
        "body": Inertia(inertia=J),
        "friction": BearingFriction(coulomb_friction=level),
    }
    drive = Drive([0.0, 0.1, 0.1 + width], [[0.04], [push], [0.04]])
    wires = ["torque.shaft body.shaft friction.shaft"]
    result = run(parts, *wires, inputs=["torque.torque"], drive=drive, stop=0.5)
    top = (push - level) * width / J
    slide = top * width / 2 + top**2 * J / (2 * (level - 0.04))
    assert switches(result, "friction") == [1, 0]
    assert instants(result, "friction") == pytest.approx([0.1, 0.1 + width + top * J / (level - 0.04)], rel=1e-10)
    assert result["body.shaft.angle"][-1] == pytest.approx(slide, rel=1e-10)
    assert balance(result) < 1e-9


def test_slip_between_two_shafts_exchanges_momentum() -> None:
    """A clutch: the free pair ends at the common speed, and half of the rest became heat."""
    j1, j2, level, speed = 2e-3, 3e-3, 0.05, 10.0
    parts: dict[str, Block] = {
        "first": Inertia(inertia=j1),
        "second": Inertia(inertia=j2),
        "joint": JointFriction(coulomb_friction=level),
    }
    wires = ["first.shaft joint.a", "joint.b second.shaft"]
    result = run(parts, *wires, stop=1.0, initial={"first.shaft.speed": speed, "second.shaft.speed": 0.0})
    common = j1 * speed / (j1 + j2)
    assert instants(result, "joint") == pytest.approx([speed * j1 * j2 / (j1 + j2) / level], rel=1e-10)
    assert result["first.shaft.speed"][-1] == pytest.approx(common, rel=1e-10)
    heat = j1 * j2 / (j1 + j2) * speed**2 / 2
    assert result["energy.dissipated"][-1] == pytest.approx(heat, rel=1e-9)


def test_translational_twins() -> None:
    parts: dict[str, Block] = {
        "force": Force(),
        "sled": Mass(mass=2.0),
        "rider": Mass(mass=1.0),
        "snow": TranslationalBearingFriction(coulomb_friction=3.0),
        "seat": TranslationalJointFriction(coulomb_friction=1.5),
    }
    wires = ["force.flange sled.flange snow.slide seat.a", "seat.b rider.flange"]
    drive = Drive([0.0, 1.0, 2.0], [[2.4], [6.0], [12.0]])
    result = run(parts, *wires, inputs=["force.force"], drive=drive, stop=3.0)
    v1, v2, t = result["sled.flange.speed"], result["rider.flange.speed"], result.time
    first, second, third = t < 1, (t >= 1) & (t < 2), t >= 2
    assert (v1[first] == 0).all()
    assert (v2[first] == 0).all()
    np.testing.assert_allclose(v1[second], (t[second] - 1) * 3 / 3, rtol=0, atol=1e-11)
    assert (v1[second] == v2[second]).all()
    np.testing.assert_allclose(v1[third], 1 + (t[third] - 2) * (12 - 3 - 1.5) / 2, rtol=1e-10)
    np.testing.assert_allclose(v2[third], 1 + (t[third] - 2) * 1.5, rtol=1e-10)
    assert balance(result) < 1e-9


def test_friction_in_a_loop_is_refused() -> None:
    parts: dict[str, Block] = {
        "first": Inertia(inertia=1),
        "second": Inertia(inertia=1),
        "one": BearingFriction(coulomb_friction=1),
        "two": BearingFriction(coulomb_friction=1),
        "joint": JointFriction(coulomb_friction=1),
    }
    with pytest.raises(StructureError, match=r"friction 'joint' closes a loop with one, two"):
        model(parts, "first.shaft one.shaft joint.a", "second.shaft two.shaft joint.b")


@pytest.mark.parametrize("backend", ["c", "interpreter"])
@pytest.mark.parametrize("level", [1e3, 1e12, 1e20, 1e26, 1e30, 1e100, 1e300])
def test_a_stop_shorter_than_any_step_goes_no_further_than_it_should(level: float, backend: str) -> None:
    """x = m v^2 / 2 F; the far side of the located instant was at -1e267 m with 1e300 N."""
    parts: dict[str, Block] = {"body": Mass(mass=2.0), "friction": TranslationalBearingFriction(coulomb_friction=level)}
    result = run(
        parts,
        "body.flange friction.slide",
        stop=0.01,
        initial={"body.flange.speed": 3.0},
        backend=backend,
        energy=False,
    )
    assert result["body.flange.position"][-1] == pytest.approx(9.0 / level, rel=1e-9, abs=1e-15)
    assert result["body.flange.speed"][-1] == 0
    assert switches(result, "friction") == [0]


def test_a_stop_shorter_than_any_step_keeps_the_momentum() -> None:
    """Of a joint between two bodies, which go on together."""
    parts: dict[str, Block] = {
        "first": Mass(mass=2.0),
        "second": Mass(mass=1.0),
        "joint": TranslationalJointFriction(coulomb_friction=1e300),
    }
    wires = ["first.flange joint.a", "joint.b second.flange"]
    result = run(
        parts, *wires, stop=0.01, initial={"first.flange.speed": 3.0, "second.flange.speed": 0.0}, energy=False
    )
    for name in ("first", "second"):
        np.testing.assert_allclose(result[f"{name}.flange.speed"][1:], 2.0, rtol=1e-12)
        np.testing.assert_allclose(result[f"{name}.flange.position"], 2.0 * result.time, atol=1e-12)
