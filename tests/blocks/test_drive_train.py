"""Motor, gear, spring-damper: closed forms, published numbers and the energy balance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.effort import Force, Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.actuators.spring_damper import SpringDamper, TranslationalSpringDamper
from blocks.links.fixed import Fixed, TranslationalFixed
from blocks.links.inertia import Inertia, Mass
from blocks.links.rigid_link import RigidLink
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ParameterError, SimulationError, StructureError
from engine.simulate import Result
from engine.tangent import tangents
from tests.blocks.assembly import linear, model, run

SRV02 = {
    "resistance": 2.6,
    "torque_constant": 7.68e-3,
    "efficiency": 0.69,
    "rotor_inertia": 4.606e-7,
    "viscous_friction": 1.26e-6,
}


def balance(result: Result) -> float:
    """How far the energy books are off, as a share of what went through them."""
    residual = result["energy.residual"]
    through = max(np.ptp(result["energy.supplied"]), result["energy.stored"].max(), np.ptp(result["energy.dissipated"]))
    return float(np.abs(residual - residual[0]).max() / through)


def test_bare_srv02_motor() -> None:
    """[Gao J. n.d., eq. 2.10]: gain, corner and DC gain."""
    found = linear({"motor": DCMotor(**SRV02)}, inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
    gain = abs(complex(found.gain(1e-6)[0, 0]))
    assert gain == pytest.approx(120.508, abs=5e-4)
    assert 20 * np.log10(gain) == pytest.approx(41.620, abs=5e-4)
    assert found.poles()[-1].real == pytest.approx(-36.72, abs=5e-3)
    assert found.B[-1, 0] * 4.606e-7 == pytest.approx(2.038154e-3, rel=1e-6)


def test_locked_motor_current_rises_with_l_over_r() -> None:
    parts: dict[str, Block] = {
        "motor": DCMotor(resistance=2.0, inductance=0.05, torque_constant=0.1, rotor_inertia=1e-4),
        "supply": Constant(value=12),
        "wall": Fixed(),
    }
    result = run(parts, "supply.out motor.voltage", "motor.shaft wall.shaft", stop=0.2, internal_step=2e-4)
    current = 6 * (1 - np.exp(-40 * result.time))
    np.testing.assert_allclose(result["motor.current"], current, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["motor.torque"], 0.1 * current, rtol=0, atol=1e-10)
    assert balance(result) < 1e-9


def test_an_inductance_that_is_there_can_be_tuned_and_fitted() -> None:
    """A locked rotor: i = V/R (1 - exp(-R t/L)), so di/dL = -V t/L^2 exp(-R t/L); where L = 0 there is no parameter."""
    parts: dict[str, Block] = {
        "motor": DCMotor(resistance=2.0, inductance=0.05, torque_constant=0.1, rotor_inertia=1e-4),
        "supply": Constant(value=12),
        "wall": Fixed(),
    }
    wires = ("supply.out motor.voltage", "motor.shaft wall.shaft")
    made = model(parts, *wires)
    column = [v.name for v in made.outputs].index("motor.current")
    tuned = {"motor.inductance": 0.08}
    found = tangents(made, 0.2, 1e-3, wrt=["motor.inductance"], parameters=tuned, internal_step=2e-4)
    time, decay = found.result.time, np.exp(-2.0 / 0.08 * found.result.time)
    np.testing.assert_allclose(found.result["motor.current"], 6 * (1 - decay), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.values[:, column, 0], -12 * time / 0.08**2 * decay, rtol=0, atol=1e-6)
    without = model({**parts, "motor": DCMotor(resistance=2.0, torque_constant=0.1, rotor_inertia=1e-4)}, *wires)
    assert "motor.inductance" not in {p.name for p in without.parameters}
    with pytest.raises(SimulationError, match=r"rate of state 'motor.winding.current' is not finite"):
        tangents(made, 0.2, 1e-3, wrt=["motor.inductance"], parameters={"motor.inductance": 0.0})


def test_motor_without_inductance_is_the_limit() -> None:
    def speed(inductance: float) -> Any:
        parts: dict[str, Block] = {"motor": DCMotor(**SRV02, inductance=inductance), "supply": Step(height=2)}
        return run(parts, "supply.out motor.voltage", stop=0.1)["motor.shaft.speed"]

    without = speed(0.0)
    time = 1e-3 * np.arange(101)
    rate = (1.26e-6 + 0.69 * 7.68e-3**2 / 2.6) / 4.606e-7
    exact = 2 * 0.69 * 7.68e-3 / 2.6 / (4.606e-7 * rate) * (1 - np.exp(-rate * time))
    np.testing.assert_allclose(without, exact, rtol=0, atol=1e-5)
    lag = np.abs(speed(1e-4) - without).max()
    assert lag == pytest.approx(1e-4 / 2.6 * 2 * 0.69 * 7.68e-3 / 2.6 / 4.606e-7, rel=0.1)
    assert np.abs(speed(1e-5) - without).max() == pytest.approx(lag / 10, rel=0.1)


@pytest.mark.parametrize("inductance", [0.0, 5e-3])
def test_motor_energy_balance(inductance: float) -> None:
    """With unequal constants and an efficiency, supply = winding, bearing and conversion losses + stored."""
    parts: dict[str, Block] = {
        "motor": DCMotor(**SRV02, inductance=inductance, back_emf_constant=9e-3),
        "supply": Sine(amplitude=4, frequency=3),
    }
    result = run(parts, "supply.out motor.voltage", stop=1.0, internal_step=2e-4)
    assert balance(result) < 1e-7
    lossless = DCMotor(resistance=2.6, torque_constant=7.68e-3, rotor_inertia=4.6e-7, inductance=inductance)
    result = run({**parts, "motor": lossless}, "supply.out motor.voltage", stop=1.0, internal_step=2e-4)
    heat = np.trapezoid(2.6 * result["motor.current"] ** 2, result.time)
    assert result["energy.dissipated"][-1] == pytest.approx(heat, rel=1e-3)


def geared(eta: float, inertia: float = 0.02, ratio: float = 14) -> Result:
    parts: dict[str, Block] = {
        "push": Constant(value="0.3 N.m"),
        "torque": Torque(),
        "rotor": Inertia(inertia=1e-4),
        "gear": Gear(ratio=ratio, efficiency=eta, inertia=0.005),
        "load": Inertia(inertia=inertia),
    }
    wires = ["push.out torque.torque", "torque.shaft rotor.shaft gear.input", "gear.output load.shaft"]
    return run(parts, *wires, stop=0.5)


@pytest.mark.parametrize("eta", [1.0, 0.9, 0.5])
def test_gear_reflects_the_rotor(eta: float) -> None:
    """Jeq = eta n^2 Jm + Jl, driven by eta n tau."""
    result = geared(eta)
    rate = eta * 14 * 0.3 / (eta * 14**2 * 1e-4 + 0.025)
    np.testing.assert_allclose(result["load.shaft.speed"], rate * result.time, rtol=1e-12)
    np.testing.assert_array_equal(result["rotor.shaft.speed"], 14 * result["load.shaft.speed"])
    arriving = 0.3 - 1e-4 * 14 * rate
    lost = (1 - eta) * arriving * result["rotor.shaft.angle"][-1]
    assert result["energy.dissipated"][-1] == pytest.approx(lost, rel=1e-9, abs=1e-12)
    assert balance(result) < 1e-9


@pytest.mark.parametrize("eta", [1.0, 0.9])
def test_a_gear_that_reverses(eta: float) -> None:
    """n < 0: the load turns the other way, Jeq = eta n^2 Jm + Jl, and the loss is positive while the motor drives."""
    result = geared(eta, ratio=-14)
    rate = -eta * 14 * 0.3 / (eta * 14**2 * 1e-4 + 0.025)
    np.testing.assert_allclose(result["load.shaft.speed"], rate * result.time, rtol=1e-12)
    np.testing.assert_array_equal(result["rotor.shaft.speed"], -14 * result["load.shaft.speed"])
    entering = (0.3 - 1e-4 * -14 * rate) * result["rotor.shaft.angle"][-1]
    assert entering > 0
    assert result["energy.dissipated"][-1] == pytest.approx((1 - eta) * entering, rel=1e-9, abs=1e-12)
    assert balance(result) < 1e-9


@pytest.mark.parametrize("ratio", [14.0, -14.0])
def test_dry_friction_behind_a_gear_opposes_the_motion(ratio: float) -> None:
    """Against friction Tc at the load the motor sticks while |n| T < Tc; beyond, the load gains |n| T - Tc."""
    parts: dict[str, Block] = {
        "torque": Torque(),
        "rotor": Inertia(inertia=1e-4),
        "gear": Gear(ratio=ratio),
        "load": Inertia(inertia=0.02),
        "dry": BearingFriction(coulomb_friction=1.4),
    }
    wires = ["torque.shaft rotor.shaft gear.input", "gear.output load.shaft dry.shaft"]
    for push, expected in ((0.09, 0.0), (0.3, (14 * 0.3 - 1.4) / (0.02 + 14**2 * 1e-4))):
        result = run({**parts, "push": Constant(value=push)}, "push.out torque.torque", *wires, stop=0.2)
        rate = np.sign(ratio) * expected
        np.testing.assert_allclose(result["load.shaft.speed"], rate * result.time, rtol=1e-9, atol=1e-12)
        lost = 1.4 * abs(result["load.shaft.angle"][-1])
        assert result["energy.dissipated"][-1] == pytest.approx(lost, rel=1e-9, abs=1e-12)


def test_a_ratio_is_not_zero_and_a_model_keeps_its_sign() -> None:
    with pytest.raises(ParameterError, match="0 is out of range: ratio must be other than 0"):
        Gear(ratio=0)
    for ratio, other, limit in ((14.0, -14.0, "> 0"), (-14.0, 14.0, "< 0")):
        parts: dict[str, Block] = {"a": Inertia(inertia=1), "gear": Gear(ratio=ratio), "b": Inertia(inertia=1)}
        made = model(parts, "a.shaft gear.input", "gear.output b.shaft", energy=False)
        with pytest.raises(ParameterError, match=f"ratio must be {limit}"):
            made.parameter_vector({"gear.ratio": other})


def test_motor_gear_and_link_of_the_quanser_arm() -> None:
    """[Gao X. n.d., text below eq. 11]: the motor constant and the back-emf damping at the link."""
    motor = {k: v for k, v in SRV02.items() if k not in ("rotor_inertia", "viscous_friction")}
    parts: dict[str, Block] = {
        "motor": DCMotor(**motor),
        "gear": Gear(ratio=70, efficiency=0.9),
        "arm": RigidLink(length=0.419, mass=0.065, hub_inertia=2.08e-3),
    }
    wires = ["motor.shaft gear.input", "gear.output arm.hub"]
    found = linear(parts, *wires, inputs=["motor.voltage"], outputs=["arm.hub.speed", "arm.tip.position"])
    inertia = 2.08e-3 + 0.065 * 0.419**2 / 3
    assert inertia == pytest.approx(5.8838e-3, rel=1e-4)
    assert found.B[-1, 0] * inertia == pytest.approx(0.1284037, rel=1e-6)
    assert -found.A[-1, -1] * inertia == pytest.approx(0.0690298, rel=1e-6)


def test_rigid_link_with_payload() -> None:
    parts: dict[str, Block] = {
        "push": Constant(value=1),
        "torque": Torque(),
        "arm": RigidLink(length=0.5, mass=0.3, payload=0.2, hub_inertia=0.01),
    }
    result = run(parts, "push.out torque.torque", "torque.shaft arm.hub", stop=1.0)
    inertia = 0.01 + 0.3 * 0.25 / 3 + 0.2 * 0.25
    np.testing.assert_allclose(result["arm.hub.speed"], result.time / inertia, rtol=1e-12)
    np.testing.assert_allclose(result["arm.tip.position"], 0.5 * result["arm.hub.angle"], rtol=1e-14)


def test_spring_damper_swings_as_it_should() -> None:
    k, d, inertia, rest, start = 3.0, 0.05, 0.02, 0.1, 0.4
    parts: dict[str, Block] = {
        "wall": Fixed(),
        "spring": SpringDamper(stiffness=k, damping=d, rest_angle=rest),
        "body": Inertia(inertia=inertia),
    }
    wires = ["wall.shaft spring.a", "spring.b body.shaft"]
    result = run(parts, *wires, stop=2.0, initial={"body.shaft.angle": start}, internal_step=2e-4)
    w, decay = np.sqrt(k / inertia), d / (2 * inertia)
    wd = np.sqrt(w**2 - decay**2)
    t, amplitude = result.time, start + rest
    angle = -rest + amplitude * np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t))
    np.testing.assert_allclose(result["body.shaft.angle"], angle, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["spring.twist"], -angle - rest, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["spring.torque"], inertia * result["body.shaft.acceleration"], atol=1e-12)
    assert result["energy.stored"][0] == pytest.approx(k * amplitude**2 / 2, rel=1e-14)
    assert balance(result) < 1e-9


def test_translational_twin() -> None:
    parts: dict[str, Block] = {
        "push": Constant(value="2 N"),
        "force": Force(),
        "cart": Mass(mass=0.5),
        "spring": TranslationalSpringDamper(stiffness=40, damping=2),
        "wall": TranslationalFixed(),
    }
    wires = ["push.out force.force", "force.flange cart.flange spring.a", "spring.b wall.flange"]
    result = run(parts, *wires, stop=1.0, internal_step=2e-4)
    wd, decay, t = np.sqrt(80 - 4), 2.0, result.time
    position = 0.05 * (1 - np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t)))
    np.testing.assert_allclose(result["cart.flange.position"], position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["spring.compression"], position, rtol=0, atol=1e-9)
    assert balance(result) < 1e-8


def test_two_mass_antiresonance_and_resonance() -> None:
    """[Gao J. n.d., Table B.3]: undamped 16.27 and 168.8 rad/s."""
    parts: dict[str, Block] = {
        "torque": Torque(),
        "rotor": Inertia(inertia=4.606e-7),
        "spring": SpringDamper(stiffness=0.013),
        "load": Inertia(inertia=4.91e-5),
    }
    wires = ["torque.shaft rotor.shaft spring.a", "spring.b load.shaft"]
    found = linear(parts, *wires, inputs=["torque.torque"], outputs=["rotor.shaft.angle"])
    assert np.abs(found.zeros())[-1] == pytest.approx(16.27, rel=1e-3)
    assert np.abs(found.poles())[-1] == pytest.approx(168.8, rel=1e-3)


def test_a_shaft_without_inertia_is_refused() -> None:
    parts: dict[str, Block] = {"motor": DCMotor(resistance=1, torque_constant=1), "supply": Constant(value=1)}
    with pytest.raises(StructureError, match=r"motor.shaft has no inertia"):
        model(parts, "supply.out motor.voltage")


def test_two_gears_in_a_loop_are_refused() -> None:
    parts: dict[str, Block] = {"one": Gear(ratio=2), "two": Gear(ratio=2), "load": Inertia(inertia=1)}
    with pytest.raises(StructureError, match=r"tied already"):
        model(parts, "one.input two.input", "one.output two.output load.shaft")
