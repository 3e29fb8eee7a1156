"""Inverse dynamics against the plant it inverts, and against the corrected [Gao J. n.d., eqs. 2.16, 2.21]."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.actuators.spring_damper import SpringDamper
from blocks.controllers.inverse_dynamics import InverseDynamics
from blocks.controllers.rigid_feedforward import RigidFeedForward
from blocks.controllers.three_mass_feedforward import ThreeMassFeedForward
from blocks.controllers.two_mass_feedforward import TwoMassFeedForward
from blocks.links.inertia import Inertia
from blocks.registry import find
from blocks.sources.trajectory import Trajectory
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Result
from tests.blocks.assembly import linear, run, switches

R, KT, KM, ETA, JM, BM = 2.6, 7.68e-3, 8.1e-3, 0.69, 4.606e-7, 1.26e-6
MOTOR = {
    "resistance": R,
    "torque_constant": KT,
    "back_emf_constant": KM,
    "efficiency": ETA,
    "rotor_inertia": JM,
    "viscous_friction": BM,
}
N = 14.0
JA, BA, KA, DA = 2.4e-3, 3.3e-4, 2.3, 5.9e-3
JL, BL, KL, DL = 5.1e-3, 1.9e-4, 60.0, 0.03
SPRING = {"stiffness": KA, "damping": DA}
LOAD = {"load_inertia": JA, "load_viscous_friction": BA}
LINK = {"link_inertia": JL, "link_viscous_friction": BL, "link_stiffness": KL, "link_damping": DL}
ORDERS = ("position", "velocity", "acceleration", "jerk", "snap")
KINDS: dict[int, type[InverseDynamics]] = {1: RigidFeedForward, 2: TwoMassFeedForward, 3: ThreeMassFeedForward}
MOVE = {"end_position": 2.4, "velocity_limit": 2.4, "acceleration_limit": 4.8, "jerk_limit": 19.2, "snap_limit": 76.8}


def tracked(masses: int, forward: dict[str, Any], plant: dict[str, Block], wires: list[str], **rest: Any) -> Result:
    """The plant driven by the feed-forward alone."""
    parts: dict[str, Block] = {
        "move": Trajectory(**MOVE, start=0.1),
        "ff": KINDS[masses](ratio=N, **MOTOR, **forward),
        "motor": DCMotor(**MOTOR),
        "gear": Gear(ratio=N),
        **plant,
    }
    signals = [f"move.{order} ff.{order}" for order in ORDERS]
    every = [*signals, "ff.voltage motor.voltage", *wires]
    return run(parts, *every, stop=2.5, step=0.005, internal_step=5e-4, energy=False, **rest)


PLANTS: dict[int, tuple[dict[str, Any], dict[str, Block], list[str], str]] = {
    1: (
        LOAD,
        {"load": Inertia(inertia=JA), "bearing": BearingFriction(viscous_friction=BA)},
        ["motor.shaft gear.input", "gear.output load.shaft bearing.shaft"],
        "load",
    ),
    2: (
        LOAD | SPRING,
        {
            "spring": SpringDamper(**SPRING),
            "load": Inertia(inertia=JA),
            "bearing": BearingFriction(viscous_friction=BA),
        },
        ["motor.shaft gear.input", "gear.output spring.a", "spring.b load.shaft bearing.shaft"],
        "load",
    ),
    3: (
        LOAD | SPRING | LINK,
        {
            "spring": SpringDamper(**SPRING),
            "load": Inertia(inertia=JA),
            "bearing": BearingFriction(viscous_friction=BA),
            "flex": SpringDamper(stiffness=KL, damping=DL),
            "link": Inertia(inertia=JL),
            "far": BearingFriction(viscous_friction=BL),
        },
        [
            "motor.shaft gear.input",
            "gear.output spring.a",
            "spring.b load.shaft bearing.shaft flex.a",
            "flex.b link.shaft far.shaft",
        ],
        "link",
    ),
}


@pytest.mark.parametrize("masses", PLANTS)
def test_the_plant_follows_its_inverse_without_feedback(masses: int) -> None:
    forward, plant, wires, last = PLANTS[masses]
    result = tracked(masses, forward, plant, wires)
    np.testing.assert_allclose(result[f"{last}.shaft.angle"], result["move.position"], rtol=0, atol=2e-8)
    np.testing.assert_allclose(result[f"{last}.shaft.speed"], result["move.velocity"], rtol=0, atol=2e-7)
    np.testing.assert_allclose(result["motor.shaft.angle"], result["ff.motor.angle"], rtol=0, atol=5e-7)
    np.testing.assert_allclose(result["motor.shaft.speed"], result["ff.motor.speed"], rtol=0, atol=5e-6)
    assert result["move.position"][-1] == pytest.approx(2.4, abs=1e-12)


def test_an_undamped_spring_needs_the_snap() -> None:
    forward, plant, wires, _ = PLANTS[2]
    plant = plant | {"spring": SpringDamper(stiffness=KA)}
    result = tracked(2, forward | {"damping": 0.0}, plant, wires)
    np.testing.assert_allclose(result["load.shaft.angle"], result["move.position"], rtol=0, atol=1e-7)


def test_a_model_with_too_few_masses_does_not_follow() -> None:
    _, plant, wires, _ = PLANTS[2]
    rigid = tracked(1, LOAD, plant, wires)
    error = np.abs(rigid["load.shaft.angle"] - rigid["move.position"]).max()
    assert error > 1e-3


def test_dry_friction_is_compensated_while_the_reference_moves() -> None:
    """The load still arrives; the friction's voltage is on while the reference moves, and off before and after."""
    level = 2.25e-4
    forward, plant, wires, _ = PLANTS[2]
    plant = plant | {"dry": BearingFriction(coulomb_friction=level)}
    wires = ["motor.shaft gear.input dry.shaft", *wires[1:]]
    result = tracked(2, forward | {"coulomb_friction": level}, plant, wires)
    assert np.abs(result["load.shaft.angle"] - result["move.position"]).max() < 1e-4
    assert switches(result, "ff.direction") == [1, 0]
    assert result["ff.voltage"][0] == 0
    assert abs(result["ff.voltage"][-1]) < 1e-6
    without = tracked(2, forward, plant, wires)
    assert np.abs(without["load.shaft.angle"] - without["move.position"]).max() > 0.1


# [Gao J. n.d., eqs. 2.15 to 2.21] corrected (docs/errata.md), motor-referred.


def impedances(s: complex, masses: int) -> tuple[complex, complex]:
    """Motor speed over voltage, and motor angle over the angle of the last mass, from impedances."""
    a, w = ETA * KT / R, BM + ETA * KT / R * KM
    ja, ba, ka, da, jl, bl, kl, dl = (value / N**2 for value in (JA, BA, KA, DA, JL, BL, KL, DL))
    if masses == 1:
        return a / (JM * s + w + ja * s + ba), 1.0
    z = da + ka / s
    if masses == 2:
        load = ja * s + ba
        return a / (JM * s + w + z * load / (z + load)), (ja * s**2 + (da + ba) * s + ka) / (da * s + ka)
    link, zl = jl * s + bl, dl + kl / s
    load = ja * s + ba + zl * link / (zl + link)
    outer = (jl * s**2 + (dl + bl) * s + kl) / (dl * s + kl)
    inner = (ja * s**2 + (da + dl + ba) * s + ka + kl) * outer / (da * s + ka) - (dl * s + kl) / (da * s + ka)
    return a / (JM * s + w + z * load / (z + load)), inner


@pytest.mark.parametrize("masses", PLANTS)
@pytest.mark.parametrize("w", [0.3, 5.0, 40.0, 300.0])
def test_the_corrected_formulas(masses: int, w: float) -> None:
    forward = PLANTS[masses][0]
    parts: dict[str, Block] = {"ff": KINDS[masses](ratio=N, **MOTOR, **forward)}
    found = linear(
        parts, inputs=[f"ff.{o}" for o in ORDERS], outputs=["ff.voltage", "ff.motor.angle", "ff.motor.speed"]
    )
    s = 1j * w
    voltage, angle, speed = found.gain(w) @ s ** np.arange(5)
    gain, ratio = impedances(s, masses)
    assert angle == pytest.approx(N * ratio, rel=1e-9)
    assert speed == pytest.approx(s * N * ratio, rel=1e-9)
    assert voltage == pytest.approx(s * N * ratio / gain, rel=1e-9)


def test_load_side_values_are_motor_side_values_times_the_ratio_squared() -> None:
    """(Ja, da, ka, Ba) / n^2 and a reference n times larger give the same voltage."""
    near = {name: value / N**2 for name, value in (LOAD | SPRING).items()}
    gains = []
    for ratio, values in ((N, LOAD | SPRING), (1.0, near)):
        block = TwoMassFeedForward(ratio=ratio, **MOTOR, **values)
        found = linear({"ff": block}, inputs=[f"ff.{order}" for order in ORDERS], outputs=["ff.voltage"])
        gains.append(found.gain(11.0)[0] * (1.0 if ratio == N else N))
    np.testing.assert_allclose(gains[0], gains[1], rtol=1e-12)


@pytest.mark.parametrize("masses", KINDS)
def test_a_block_that_is_not_active_gives_the_rigid_reference_and_no_voltage(masses: int) -> None:
    block = KINDS[masses](ratio=N, active=False, **MOTOR, **PLANTS[masses][0])
    parts: dict[str, Block] = {"move": Trajectory(**MOVE), "ff": block}
    result = run(parts, *[f"move.{o} ff.{o}" for o in ORDERS], stop=2.0, step=0.01, energy=False)
    assert not result["ff.voltage"].any()
    np.testing.assert_allclose(result["ff.motor.speed"], N * result["move.velocity"], rtol=1e-12)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (RigidFeedForward, {}, "RigidFeedForward needs 'load_inertia'"),
        (TwoMassFeedForward, LOAD, "TwoMassFeedForward needs 'stiffness'"),
        (TwoMassFeedForward, LOAD | SPRING | {"stiffness": 0.0}, "0.0 is out of range: stiffness must be > 0"),
        (ThreeMassFeedForward, LOAD | LINK | {"stiffness": KA}, "ThreeMassFeedForward needs 'damping'"),
        (ThreeMassFeedForward, LOAD | LINK | SPRING | {"link_damping": 0.0}, "out of range: link_damping must be > 0"),
    ],
)
def test_refusals(kind: type[InverseDynamics], values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        kind(**MOTOR, **values)


def test_a_rigid_model_needs_no_jerk() -> None:
    parts: dict[str, Block] = {"move": Trajectory(**MOVE), "ff": RigidFeedForward(ratio=N, **MOTOR, **LOAD)}
    with_jerk, without = [
        run(parts, *[f"move.{o} ff.{o}" for o in orders], stop=2.0, step=0.01, energy=False)["ff.voltage"]
        for orders in (ORDERS, ORDERS[:3])
    ]
    np.testing.assert_array_equal(with_jerk, without)


def test_a_reversing_gear_turns_the_motor_the_other_way() -> None:
    """The plant behind a gear of -14 follows the same trajectory without feedback."""
    forward, plant, wires, last = PLANTS[2]
    parts: dict[str, Block] = {
        "move": Trajectory(**MOVE, start=0.1),
        "ff": TwoMassFeedForward(ratio=-N, **MOTOR, **forward),
        "motor": DCMotor(**MOTOR),
        "gear": Gear(ratio=-N),
        **plant,
    }
    signals = [f"move.{order} ff.{order}" for order in ORDERS]
    every = [*signals, "ff.voltage motor.voltage", *wires]
    result = run(parts, *every, stop=2.5, step=0.005, internal_step=5e-4, energy=False)
    np.testing.assert_allclose(result[f"{last}.shaft.angle"], result["move.position"], rtol=0, atol=2e-8)
    assert result["motor.shaft.angle"][-1] == pytest.approx(-N * 2.4, abs=1e-5)


def test_the_block_of_earlier_versions_is_named_with_its_successors() -> None:
    with pytest.raises(ParameterError) as caught:
        find("FeedForward")
    for said in ("RigidFeedForward", "TwoMassFeedForward", "ThreeMassFeedForward", "active: false"):
        assert said in str(caught.value)
