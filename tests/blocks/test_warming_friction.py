"""Friction that warms its own oil: closed forms, scipy, what is lost and where it goes, and a stick that lets go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from blocks.actuators.effort import Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.warming_friction import WarmingFriction
from blocks.links.inertia import Inertia
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from engine.block import Block
from engine.simulate import Result
from tests.blocks.assembly import linear, run, switches
from tests.blocks.test_drive_train import balance

J = 2e-3
HEAT: dict[str, Any] = {"heat_capacity": 0.02, "thermal_resistance": 30.0}
PUSHED = ("push.out drive.torque", "drive.shaft body.shaft friction.shaft")


def pushed(push: float | Block, friction: Block) -> dict[str, Block]:
    source = push if isinstance(push, Block) else Constant(value=push)
    return {"push": source, "drive": Torque(), "body": Inertia(inertia=J), "friction": friction}


def test_at_one_speed_oil_that_keeps_its_heat_thins_as_a_hyperbola() -> None:
    """C T' = B w^2 exp(-b T) has exp(b T) = 1 + t / tau, tau = C / (b B w^2): the friction halves in tau."""
    b, B, w, C = 0.04, 0.01, 8.0, 0.5
    friction = WarmingFriction(viscous_friction=B, temperature_coefficient=b, heat_capacity=C, thermal_resistance=1e12)
    parts: dict[str, Block] = {"flywheel": Inertia(inertia=1e9), "friction": friction}
    wire, start = "flywheel.shaft friction.shaft", {"flywheel.shaft.speed": w}
    result = run(parts, wire, stop=40.0, step=0.1, internal_step=0.05, initial=start)
    tau = C / (b * B * w**2)
    thinner = np.log1p(result.time / tau)
    assert result.time[-1] > 2 * tau
    np.testing.assert_allclose(result["friction.temperature"], 293.15 + thinner / b, rtol=1e-8)
    np.testing.assert_allclose(result["energy.dissipated"], B * w**2 * tau * thinner, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("speed", [40.0, -40.0])
def test_it_coasts_to_rest_as_scipy_says(speed: float) -> None:
    """Coulomb, Stribeck and viscous friction, both coefficients, both directions, and heat that leaves."""
    fc, back, fs, vs, B, b, c = 0.03, 0.02, 0.05, 0.5, 1e-3, 0.05, 0.02
    friction = WarmingFriction(
        coulomb_friction=fc, coulomb_friction_backward=back, static_friction=fs, static_friction_backward=fs,
        stribeck_velocity=vs, viscous_friction=B, temperature_coefficient=b, dry_temperature_coefficient=c,
        ambient_temperature=290.0, reference_temperature=293.15, start_temperature=300.0, **HEAT,
    )  # fmt: skip
    level = fc if speed > 0 else back

    def slope(t: float, x: np.ndarray) -> list[float]:
        v, rise = x[0], x[1] - 293.15
        dry = (level + (fs - level) * np.exp(-((v / vs) ** 2))) * np.exp(-c * rise)
        torque = np.sign(speed) * dry + B * v * np.exp(-b * rise)
        return [-torque / J, (torque * v - (x[1] - 290.0) / 30.0) / 0.02]

    def rests(t: float, x: np.ndarray) -> float:
        return float(x[0])

    rests.terminal = True  # type: ignore[attr-defined]
    parts: dict[str, Block] = {"body": Inertia(inertia=J), "friction": friction}
    result = run(parts, "body.shaft friction.shaft", stop=4.0, initial={"body.shaft.speed": speed}, internal_step=2e-4)
    exact = solve_ivp(slope, (0, 4), [speed, 300.0], rtol=1e-11, atol=1e-11, events=rests, dense_output=True)
    rest = float(exact.t_events[0][0])
    sliding = result.time < rest
    assert 0.5 < rest < 3.5
    v, temperature = exact.sol(result.time[sliding])
    assert temperature.max() > 310
    np.testing.assert_allclose(result["body.shaft.speed"][sliding], v, atol=2e-6 * abs(speed))
    np.testing.assert_allclose(result["friction.temperature"][sliding], temperature, atol=1e-5)
    assert np.all(result["body.shaft.speed"][~sliding] == 0.0)
    # At rest nothing rubs any more, and the joint cools as a body of one temperature does.
    left = 290.0 + (exact.y[1, -1] - 290.0) * np.exp(-(result.time[~sliding] - rest) / (0.02 * 30.0))
    np.testing.assert_allclose(result["friction.temperature"][~sliding], left, atol=1e-4)
    assert balance(result) < 1e-7


def test_what_is_lost_is_the_heat_of_the_joint() -> None:
    """Insulated, C times the rise is the energy that the friction took, through reversals and stops."""
    friction = WarmingFriction(
        coulomb_friction=0.03, viscous_friction=1e-3, heat_capacity=0.02, thermal_resistance=1e12
    )
    result = run(pushed(Sine(amplitude=0.1, frequency=3), friction), *PUSHED, stop=2.0, internal_step=1e-4)
    assert len(switches(result, "friction")) > 4
    lost = result["energy.dissipated"]
    assert lost[-1] > 0.05
    np.testing.assert_allclose(0.02 * (result["friction.temperature"] - 293.15), lost, atol=1e-6 * lost[-1])
    assert balance(result) < 1e-7


@pytest.mark.parametrize(("share", "holds"), [(1.01, True), (0.99, False)])
def test_a_load_that_a_cold_joint_holds_moves_a_warm_one(share: float, holds: bool) -> None:
    """At rest exactly until less than the load is left of the static level: T - T0 = ln(Fs / load) / c."""
    load, fs, c = 0.03, 0.05, 0.02
    warm = 293.15 + np.log(fs / (share * load)) / c
    friction = WarmingFriction(
        coulomb_friction=0.04, static_friction=fs, dry_temperature_coefficient=c,
        ambient_temperature=warm, reference_temperature=293.15, **HEAT,
    )  # fmt: skip
    result = run(pushed(load, friction), *PUSHED, stop=0.5)
    assert bool(np.all(result["body.shaft.angle"] == 0.0)) == holds
    if not holds:
        assert result["body.shaft.speed"][-1] > 0


def test_without_coefficients_it_is_the_friction_that_it_is_a_kind_of() -> None:
    given = {"coulomb_friction": 0.03, "static_friction": 0.05, "stribeck_velocity": 0.2, "viscous_friction": 1e-3}
    made = [
        run(pushed(Sine(amplitude=0.1, frequency=3), friction), *PUSHED, stop=1.0, internal_step=1e-4)
        for friction in (WarmingFriction(temperature_coefficient=0, **given, **HEAT), BearingFriction(**given))
    ]
    np.testing.assert_allclose(made[0]["body.shaft.angle"], made[1]["body.shaft.angle"], rtol=0, atol=1e-10)


def test_warm_it_is_linear_with_less_damping() -> None:
    """About rest the viscous part damps with B exp(-b (T - T0)), and the joint cools with C G."""
    friction = WarmingFriction(viscous_friction=1e-3, temperature_coefficient=0.05, ambient_temperature=313.15, **HEAT)
    parts: dict[str, Block] = {"body": Inertia(inertia=J), "friction": friction}
    poles = np.sort(linear(parts, "body.shaft friction.shaft").poles().real)
    assert poles == pytest.approx(np.sort([0.0, -1e-3 * np.exp(-1.0) / J, -1 / (0.02 * 30)]), rel=1e-6, abs=1e-9)


def test_both_runtimes_agree() -> None:
    def made(backend: str) -> Result:
        friction = WarmingFriction(coulomb_friction=0.03, viscous_friction=1e-3, **HEAT)
        return run(
            pushed(Sine(amplitude=0.1, frequency=3), friction), *PUSHED, stop=0.5, internal_step=1e-4, backend=backend
        )

    one, other = made("c"), made("interpreter")
    np.testing.assert_allclose(one["body.shaft.angle"], other["body.shaft.angle"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(one["friction.temperature"], other["friction.temperature"], rtol=1e-12)
