"""Pulley, rack and pinion, screw: closed forms, losses both ways, self-locking, and the energy balance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from blocks.actuators.effort import Force, Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.pulley import Pulley
from blocks.actuators.rack_and_pinion import RackAndPinion
from blocks.actuators.screw import Screw
from blocks.links.inertia import Inertia, Mass
from blocks.sources.constant import Constant
from engine.block import Block
from engine.errors import ConnectionProblem, ParameterError
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance

J, M = 2e-4, 3.0
WIRES = ("drive.shaft rotor.shaft", "rotor.shaft part.shaft", "part.slide cart.flange")
RATIOS = [
    (Pulley, {"radius": 0.02}, 0.02),
    (Pulley, {"radius": -0.02}, -0.02),
    (RackAndPinion, {"pitch_radius": 0.015}, 0.015),
    (Screw, {"lead": 0.01}, 0.01 / (2 * math.pi)),
    (Screw, {"lead": -0.01}, -0.01 / (2 * math.pi)),
]


def axis(part: Block, torque: float = 0.0, force: float = 0.0) -> dict[str, Block]:
    return {
        "command": Constant(value=torque),
        "drive": Torque(),
        "rotor": Inertia(inertia=J),
        "part": part,
        "cart": Mass(mass=M),
        "weight": Constant(value=force),
        "load": Force(),
    }


LOADED = (*WIRES, "command.out drive.torque", "weight.out load.force", "load.flange cart.flange")


@pytest.mark.parametrize(("kind", "given", "h"), RATIOS)
@pytest.mark.parametrize("efficiency", [1.0, 0.8])
def test_a_rigid_part_accelerates_as_the_reduced_inertia_says(
    kind: type[Block], given: dict[str, float], h: float, efficiency: float
) -> None:
    """w' = T / (J + m h^2 / eta), from T - J w' at the shaft and eta of its power at the slide."""
    torque, stop = 0.05, 0.2
    part = kind(**given, efficiency=efficiency, inertia=1e-4)
    result = run(axis(part, torque), *LOADED, stop=stop)
    speed = torque / (J + 1e-4 + M * h**2 / efficiency) * result.time
    np.testing.assert_allclose(result["rotor.shaft.speed"], speed, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result["cart.flange.speed"], h * speed, rtol=1e-9, atol=1e-12)
    assert balance(result) < 1e-9


@pytest.mark.parametrize(("kind", "given", "h"), RATIOS)
def test_an_elastic_part_rings_at_its_closed_form(kind: type[Block], given: dict[str, float], h: float) -> None:
    k = 2e5
    poles = linear(axis(kind(**given, stiffness=k)), *LOADED).poles()
    ringing = max(poles.imag)
    assert ringing == pytest.approx(math.sqrt(k * (1 / M + h**2 / J)), rel=1e-9)


@pytest.mark.parametrize(("kind", "given", "h"), RATIOS)
@pytest.mark.parametrize(("up", "backdriving"), [(True, 0.7), (False, 0.7), (True, -0.3), (False, -0.3)])
def test_moving_a_load_takes_the_torque_of_its_direction(
    kind: type[Block], given: dict[str, float], h: float, up: bool, backdriving: float
) -> None:
    """At constant speed w the motor gives B w and F h / eta while it drives, or eta_b F h while the load does.

    The rotor is heavy, J + eta_b M h^2 > 0: else a part that locks itself jams and lets go by turns.
    """
    weight, eta, viscous, rotor = 40.0, 0.9, 2e-2, 2e-3
    speed = math.copysign(30.0, h) * (1 if up else -1)
    torque = viscous * speed + weight * h * (1 / eta if up else backdriving)
    part = kind(**given, stiffness=4e5, damping=1500.0, efficiency=eta, backdriving_efficiency=backdriving)
    parts = axis(part, torque, -weight) | {
        "bearing": BearingFriction(viscous_friction=viscous),
        "rotor": Inertia(inertia=rotor),
    }
    start = {
        "rotor.shaft.speed": 0.9 * speed,
        "cart.flange.speed": 0.9 * speed * h,
        "cart.flange.position": weight / 4e5,
    }
    lag = (rotor + M * h**2) / viscous
    wires = (*LOADED, "bearing.shaft rotor.shaft")
    result = run(parts, *wires, stop=round(15 * lag, 2), step=0.01, initial=start, internal_step=1e-4)
    assert result["rotor.shaft.speed"][-1] == pytest.approx(speed, rel=1e-5)
    assert balance(result) < 1e-6


@pytest.mark.parametrize("backdriving", [-0.25, 0.0, 0.6])
def test_a_load_turns_a_screw_unless_that_locks_itself(backdriving: float) -> None:
    force, k = -200.0, 1e6
    screw = Screw(lead=0.005, stiffness=k, damping=400.0, efficiency=0.4, backdriving_efficiency=backdriving)
    result = run(axis(screw, 0, force), *LOADED, stop=0.3, internal_step=1e-4)
    if backdriving <= 0:
        assert np.all(result["rotor.shaft.angle"] == 0.0)
        assert result["cart.flange.position"][-1] == pytest.approx(force / k, rel=1e-6)
    else:
        h = 0.005 / (2 * math.pi)
        speed = force * h * backdriving / (J + M * h**2 * backdriving) * result.time[-1]
        assert result["rotor.shaft.speed"][-1] == pytest.approx(speed, rel=2e-3)
    assert balance(result) < 1e-6


def test_both_runtimes_agree_on_a_screw_that_locks_and_lets_go() -> None:
    screw = Screw(lead=0.005, stiffness=1e6, damping=400.0, efficiency=0.4, backdriving_efficiency=-0.2)
    parts = axis(screw, 0.8, -200.0)
    parts["bearing"] = BearingFriction(viscous_friction=1e-3)
    wires = (*LOADED, "bearing.shaft rotor.shaft")
    made = run(parts, *wires, stop=0.05, internal_step=1e-4)
    other = run(parts, *wires, stop=0.05, internal_step=1e-4, backend="interpreter")
    np.testing.assert_allclose(made["cart.flange.position"], other["cart.flange.position"], rtol=0, atol=1e-12)
    assert made["rotor.shaft.angle"][-1] > 0.1


def test_losses_that_need_elasticity_say_so() -> None:
    with pytest.raises(ParameterError, match="backdriving_efficiency is for an elastic Screw") as caught:
        Screw(lead=0.005, backdriving_efficiency=-0.2)
    assert "stiffness" in caught.value.remedy


def test_the_error_between_rotation_and_translation_names_the_parts() -> None:
    with pytest.raises(ConnectionProblem) as caught:
        model({"rotor": Inertia(inertia=J), "cart": Mass(mass=M)}, "rotor.shaft cart.flange")
    assert "Pulley, RackAndPinion or Screw" in caught.value.remedy
