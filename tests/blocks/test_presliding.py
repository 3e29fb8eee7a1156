"""LuGre, elasto-plastic and smoothed friction: steady sliding, presliding, creep, energy, independent integrations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.effort import Torque
from blocks.actuators.elasto_plastic import ElastoPlasticFriction, ElastoPlasticJointFriction
from blocks.actuators.lugre import LuGreFriction, LuGreJointFriction
from blocks.actuators.prescribed_motion import PrescribedMotion
from blocks.actuators.regularised_friction import RegularisedFriction
from blocks.links.inertia import Inertia
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Drive, Result
from tests.blocks.assembly import run
from tests.blocks.test_drive_train import balance

J = 2e-3
LEVELS = {"coulomb_friction": 0.03, "static_friction": 0.05, "stribeck_velocity": 0.2, "viscous_friction": 0.02}
BRISTLE = {**LEVELS, "bristle_stiffness": 50.0, "bristle_damping": 0.05}


def steady(v: float) -> float:
    return 0.03 + 0.02 * float(np.exp(-((v / 0.2) ** 2))) + 0.02 * v


def pushed(friction: Block, drive: Drive, stop: float, step: float = 1e-4, **rest: Any) -> Result:
    parts: dict[str, Block] = {"torque": Torque(), "body": Inertia(inertia=J), "friction": friction}
    wires = "torque.shaft body.shaft friction.shaft"
    return run(parts, wires, inputs=["torque.torque"], drive=drive, stop=stop, internal_step=step, **rest)


FRICTIONS = [
    LuGreFriction(**BRISTLE),
    ElastoPlasticFriction(**BRISTLE),
    RegularisedFriction(**LEVELS, creep_velocity=1e-3),
]


@pytest.mark.parametrize("friction", FRICTIONS, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("torque", [0.06, -0.08])
def test_steady_sliding(friction: Block, torque: float) -> None:
    """Sliding at the speed v where g(v) + B v is the torque."""
    result = pushed(friction, Drive([0.0], [[torque]]), 4.0)
    v = abs(result["body.shaft.speed"][-1])
    assert steady(v) == pytest.approx(abs(torque), rel=1e-6)
    assert np.sign(result["body.shaft.speed"][-1]) == np.sign(torque)
    assert result["friction.friction"][-1] == pytest.approx(torque, rel=1e-6)
    assert balance(result) < 1e-6


def imposed(friction: Block, amplitude: float, frequency: float, cycles: int) -> Result:
    """Friction force on a shaft that is moved to and fro."""
    parts: dict[str, Block] = {
        "course": Sine(amplitude=f"{amplitude} rad", frequency=frequency),
        "motion": PrescribedMotion(),
        "body": Inertia(inertia=J),
        "friction": friction,
    }
    wires = ["course.out motion.angle", "motion.shaft body.shaft friction.shaft"]
    return run(parts, *wires, stop=cycles / frequency, step=1e-3 / frequency, internal_step=2e-5)


def elasto_plastic_rate(z: float, v: float) -> float:
    full, begin = (steady(abs(v)) - 0.02 * abs(v)) / 50, 0.7 * 0.03 / 50
    if z * v <= 0 or abs(z) <= begin:
        return v
    rise = 0.5 * np.sin(np.pi * (abs(z) - (full + begin) / 2) / (full - begin)) + 0.5
    return v * (1 - (1 if abs(z) >= full else rise) * abs(z) / full)


def lugre_rate(z: float, v: float) -> float:
    return v - 50 * abs(v) * z / (steady(abs(v)) - 0.02 * abs(v))


@pytest.mark.parametrize(
    ("friction", "rate"),
    [(LuGreFriction(**BRISTLE), lugre_rate), (ElastoPlasticFriction(**BRISTLE), elasto_plastic_rate)],
    ids=["lugre", "elasto-plastic"],
)
def test_imposed_motion_against_an_independent_integration(friction: Block, rate: Any) -> None:
    amplitude, frequency = 2e-3, 5.0
    result = imposed(friction, amplitude, frequency, 2)
    w = 2 * np.pi * frequency

    def law(t: float, z: Any) -> list[float]:
        return [rate(float(z[0]), amplitude * w * np.cos(w * t))]

    found = integrate.solve_ivp(law, (0, 0.4), [0.0], t_eval=result.time, rtol=1e-9, atol=1e-13, max_step=1e-4)
    v = amplitude * w * np.cos(w * result.time)
    rates = np.array([rate(float(z), float(s)) for z, s in zip(found.y[0], v, strict=True)])
    force = 50 * found.y[0] + 0.05 * rates + 0.02 * v
    np.testing.assert_allclose(result["friction.friction"], force, rtol=0, atol=2e-6)
    reaction = force - J * amplitude * w**2 * np.sin(w * result.time)
    np.testing.assert_allclose(result["motion.torque"], reaction, rtol=0, atol=2e-6)
    assert balance(result) < 1e-5


def test_small_motion_is_the_spring_of_the_bristle() -> None:
    """Half the elastic range: elasto-plastic friction is exactly sigma0 x + sigma1 x' + B x'."""
    result = imposed(ElastoPlasticFriction(**BRISTLE), 2e-4, 2.0, 1)
    w = 4 * np.pi
    x, v = 2e-4 * np.sin(w * result.time), 2e-4 * w * np.cos(w * result.time)
    np.testing.assert_allclose(result["friction.friction"], 50 * x + 0.07 * v, rtol=0, atol=1e-10)


def crept(friction: Block, step: float) -> float:
    """Angle gained from the second to the last swing of a load of 0.012 +- 0.008 N.m, over 20 s."""
    parts: dict[str, Block] = {
        "load": Sine(amplitude="0.008 N.m", frequency=10, offset="0.012 N.m"),
        "torque": Torque(),
        "body": Inertia(inertia=J),
        "friction": friction,
    }
    wires = ["load.out torque.torque", "torque.shaft body.shaft friction.shaft"]
    result = run(parts, *wires, stop=20.0, step=0.01, internal_step=step)
    cycle = result["body.shaft.angle"].reshape(-1)[1:].reshape(-1, 10).mean(axis=1)
    return float(cycle[-1] - cycle[50])


def test_creep_under_a_swinging_load_tells_the_laws_apart() -> None:
    """Two thirds of the elastic limit at most: elasto-plastic stays to rounding, LuGre and the smoothed law do not."""
    damped = {**BRISTLE, "bristle_damping": 0.3}
    assert abs(crept(ElastoPlasticFriction(**damped), 1e-3)) < 1e-12
    assert crept(LuGreFriction(**damped), 1e-3) > 1e-5
    smoothed = crept(RegularisedFriction(**LEVELS, creep_velocity=0.05), 1e-3)
    assert smoothed > 0.1


def test_smoothed_friction_creeps_at_its_closed_form() -> None:
    """Below v0: T = (g / v0 + B) v."""
    result = pushed(
        RegularisedFriction(coulomb_friction=0.03, viscous_friction=2e-3, creep_velocity=0.02),
        Drive([0.0], [[0.015]]),
        1.0,
        2e-5,
    )
    v = 0.015 / (0.03 / 0.02 + 2e-3)
    rate = (0.03 / 0.02 + 2e-3) / J
    np.testing.assert_allclose(result["body.shaft.speed"], v * (1 - np.exp(-rate * result.time)), rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("shaft", "joint"),
    [
        (LuGreFriction(**BRISTLE), LuGreJointFriction(**BRISTLE)),
        (ElastoPlasticFriction(**BRISTLE), ElastoPlasticJointFriction(**BRISTLE)),
    ],
    ids=["lugre", "elasto-plastic"],
)
def test_joint_friction_acts_between_two_shafts(shaft: Block, joint: Block) -> None:
    """Two bodies slow each other as one of the reduced inertia slows against the ground; momentum stays."""
    j1, j2 = 3e-3, 6e-3
    pair: dict[str, Block] = {"one": Inertia(inertia=j1), "two": Inertia(inertia=j2), "friction": joint}
    start = {"one.shaft.speed": 3.0, "two.shaft.speed": -1.0}
    wires = ["one.shaft friction.a", "two.shaft friction.b"]
    both = run(pair, *wires, stop=0.5, internal_step=2e-5, initial=start)
    single: dict[str, Block] = {"body": Inertia(inertia=j1 * j2 / (j1 + j2)), "friction": shaft}
    alone = run(single, "body.shaft friction.shaft", stop=0.5, internal_step=2e-5, initial={"body.shaft.speed": 4.0})
    relative = both["one.shaft.speed"] - both["two.shaft.speed"]
    np.testing.assert_allclose(relative, alone["body.shaft.speed"], rtol=0, atol=1e-9)
    momentum = j1 * both["one.shaft.speed"] + j2 * both["two.shaft.speed"]
    np.testing.assert_allclose(momentum, j1 * 3.0 - j2, rtol=1e-12)
    assert balance(both) < 1e-6


def test_static_friction_below_sliding_friction_is_refused() -> None:
    for law in (LuGreFriction, ElastoPlasticFriction):
        with pytest.raises(
            ParameterError, match=r"static_friction = 0.01 N.m is less than coulomb_friction = 0.03 N.m"
        ):
            law(coulomb_friction=0.03, static_friction=0.01, bristle_stiffness=10)
    with pytest.raises(ParameterError, match=r"static_friction = 0\.01 N\.m is less"):
        RegularisedFriction(coulomb_friction=0.03, static_friction=0.01, creep_velocity=1e-3)
