"""Synchronous motor and its control, limits of drives, bridge, supply, heat: closed forms, own solvers, energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from blocks.actuators.brake_chopper import BrakeChopper
from blocks.actuators.bridge import Bridge
from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.effort import Torque
from blocks.actuators.pmsm import PMSM
from blocks.actuators.supply import Supply
from blocks.actuators.thermal_dc_motor import ThermalDCMotor
from blocks.controllers.current_limiter import CurrentLimiter
from blocks.controllers.dead_time import DeadTime
from blocks.controllers.duty_servo import DutyServo
from blocks.controllers.field_oriented_controller import FieldOrientedController
from blocks.controllers.gain import Gain
from blocks.controllers.sum import Sum
from blocks.controllers.torque_envelope import TorqueEnvelope
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import FlexarmError, ParameterError
from tests.blocks.assembly import instants, linear, model, run, switches
from tests.blocks.test_drive_train import balance

Array = NDArray[np.float64]

MACHINE = {"pole_pairs": 3, "resistance": 0.8, "d_inductance": 2e-3, "q_inductance": 3.5e-3, "flux_linkage": 0.05}
P, R, LD, LQ, PSI = MACHINE.values()
J = 4e-4


HELD_SPEED = PMSM(**MACHINE, rotor_inertia=1e7)
"""A rotor too heavy to change its speed."""


def machine(**changes: float) -> PMSM:
    return PMSM(**(MACHINE | changes), rotor_inertia=J, viscous_friction=1e-3)


# -- PMSM -------------------------------------------------------------------------------------------------------------


def test_a_salient_machine_is_that_of_its_fluxes_in_the_stator() -> None:
    """The same machine in stator coordinates: fluxes l' = v - R i, l = L(angle) i + psi, torque 3/2 p l x i."""

    def turned(angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])

    def currents(flux: Array, angle: float) -> Array:
        own = turned(angle).T @ flux - [PSI, 0]
        return turned(angle) @ (own / [LD, LQ])

    def voltages(t: float) -> Array:
        return np.array([3 * math.sin(30 * t), 10 * math.cos(9 * t)])

    def slope(t: float, x: Array) -> Array:
        flux, angle, w = x[:2], P * x[2], x[3]
        i = currents(flux, angle)
        torque = 1.5 * P * (flux[0] * i[1] - flux[1] * i[0])
        return np.array([*(turned(angle) @ voltages(t) - R * i), w, (torque - 1e-3 * w) / J])

    parts: dict[str, Block] = {
        "motor": machine(),
        "vd": Sine(amplitude=3, frequency=30 / (2 * math.pi)),
        "vq": Sine(amplitude=10, frequency=9 / (2 * math.pi), phase=math.pi / 2),
    }
    result = run(parts, "vd.out motor.d_voltage", "vq.out motor.q_voltage", stop=0.5, internal_step=1e-4)
    exact = solve_ivp(slope, (0, 0.5), [PSI, 0, 0, 0], t_eval=result.time, rtol=1e-10, atol=1e-12).y
    assert np.ptp(exact[2]) > 3
    np.testing.assert_allclose(result["motor.shaft.angle"], exact[2], atol=1e-6)
    np.testing.assert_allclose(result["motor.shaft.speed"], exact[3], atol=1e-5 * np.ptp(exact[3]))
    for k in (100, 333, 500):
        own = turned(P * exact[2, k]).T @ currents(exact[:2, k], P * exact[2, k])
        assert (result["motor.d_current"][k], result["motor.q_current"][k]) == pytest.approx(tuple(own), abs=1e-5)
    assert balance(result) < 1e-8


def test_saliency_makes_torque_of_a_negative_d_current() -> None:
    """A held rotor: i = v / R at last, torque 3/2 p (psi iq + (Ld - Lq) id iq)."""
    parts = {"motor": machine(), "wall": Fixed(), "vd": Constant(value=-8), "vq": Constant(value=4)}
    wires = ("vd.out motor.d_voltage", "vq.out motor.q_voltage", "motor.shaft wall.shaft")
    result = run(parts, *wires, stop=0.2, internal_step=1e-4)
    assert result["motor.torque"][-1] == pytest.approx(1.5 * P * (PSI * 5 + (LD - LQ) * -10 * 5), rel=1e-9)
    np.testing.assert_allclose(result["motor.d_current"], -10 * (1 - np.exp(-R / LD * result.time)), atol=1e-7)


def test_a_machine_at_constant_speed_draws_what_its_phasors_say() -> None:
    speed, v = 120.0, np.array([-4.0, 22.0])
    parts = {"motor": HELD_SPEED, "vd": Constant(value=v[0]), "vq": Constant(value=v[1])}
    wires = ("vd.out motor.d_voltage", "vq.out motor.q_voltage")
    we = P * speed
    exact = np.linalg.solve([[R, -we * LQ], [we * LD, R]], v - [0, we * PSI])
    result = run(parts, *wires, stop=0.2, internal_step=1e-4, initial={"motor.shaft.speed": speed})
    assert result["motor.d_current"][-1] == pytest.approx(exact[0], rel=1e-6)
    assert result["motor.q_current"][-1] == pytest.approx(exact[1], rel=1e-6)


# -- its control ------------------------------------------------------------------------------------------------------

FOC = (
    "control.d_voltage motor.d_voltage",
    "control.q_voltage motor.q_voltage",
    "motor.d_current control.d_current",
    "motor.q_current control.q_current",
    "motor.shaft.speed control.speed",
    "bus.out control.bus_voltage",
    "asked.out control.q_reference",
)


def controlled(asked: float, bus: float = 48.0, **given: float | bool) -> dict[str, Block]:
    control = {"bandwidth": 1500.0, "current_limit": 20.0} | MACHINE | given
    return {
        "asked": Step(height=asked),
        "bus": Constant(value=bus),
        "control": FieldOrientedController(**control),
        "motor": machine(),
    }


def test_currents_follow_as_a_lag_of_the_bandwidth() -> None:
    """PI with kp = wb L and ki = wb R cancels the winding's pole, at any speed: iq = i (1 - exp(-wb t)), id = 0."""
    result = run(controlled(3.0, bus=200.0), *FOC, stop=0.02, step=1e-4, internal_step=2e-5)
    np.testing.assert_allclose(result["motor.q_current"], 3 * (1 - np.exp(-1500 * result.time)), atol=1e-6)
    np.testing.assert_allclose(result["motor.d_current"], 0, atol=1e-9)
    assert result["motor.shaft.speed"][-1] > 20
    assert balance(result) < 1e-6


def test_it_linearises_to_the_lag() -> None:
    for weakening in (False, True):
        parts = {k: v for k, v in controlled(0.0, field_weakening=weakening).items() if k != "asked"}
        parts["wall"] = Fixed()
        found = linear(
            parts, *FOC[:-1], "motor.shaft wall.shaft", inputs=["control.q_reference"], outputs=["motor.q_current"]
        )
        for w in (100.0, 1500.0):
            assert complex(found.gain(w)[0, 0]) == pytest.approx(1500 / (1j * w + 1500), rel=1e-9)


@pytest.mark.parametrize("weakening", [False, True])
def test_the_voltage_ends_the_torque_and_weakening_goes_beyond(weakening: bool) -> None:
    """Run up without load: the speed ends where the voltage does, V / (p psi) at no current; weakened, far above."""
    parts = controlled(15.0, field_weakening=weakening, bandwidth=2000.0)
    parts["motor"] = PMSM(**MACHINE, rotor_inertia=J)
    result = run(parts, *FOC, stop=1.0, internal_step=2e-5)
    most = 48 / math.sqrt(3)
    size = np.hypot(result["control.d_voltage"], result["control.q_voltage"])
    assert size.max() <= most * (1 + 1e-9)
    assert np.hypot(result["motor.d_current"], result["motor.q_current"]).max() < 20 * 1.02
    idle = most / (P * PSI)
    if weakening:
        assert result["motor.shaft.speed"][-1] > 1.5 * idle
    else:
        assert result["motor.shaft.speed"][-1] == pytest.approx(idle, rel=2e-3)
    assert balance(result) < 1e-6


def test_the_bus_gives_what_the_machine_takes() -> None:
    """A sagging supply behind the bridge: its energy is that of winding, shaft and wires; the books close."""
    parts = controlled(12.0) | {"bus": Supply(source_voltage=60, resistance=0.3, capacitance=1e-3)}
    wires = [wire.replace("bus.out", "bus.voltage") for wire in FOC]
    result = run(parts, *wires, "control.bus_current bus.current", stop=0.1, internal_step=2e-5)
    drawn = result["bus.voltage"] * result["control.bus_current"]
    taken = 1.5 * (
        result["control.d_voltage"] * result["motor.d_current"]
        + result["control.q_voltage"] * result["motor.q_current"]
    )
    np.testing.assert_allclose(drawn, taken, rtol=1e-12, atol=1e-12)
    assert result["bus.voltage"].min() < 59
    assert balance(result) < 1e-6


def test_weakened_the_machine_stays_on_its_voltage_ellipse() -> None:
    """At a held speed they solve we^2 ((psi + Ld id)^2 + (Lq iq)^2) = (s V - R I)^2 and the circle of the current."""
    for speed in (90.0, 120.0, 200.0):
        parts = controlled(30.0, field_weakening=True) | {"motor": HELD_SPEED}
        result = run(parts, *FOC, stop=0.05, internal_step=2e-5, initial={"motor.shaft.speed": speed})
        d, q = result["control.d_target"][-1], result["control.q_target"][-1]
        flux = math.hypot(PSI + LD * d, LQ * q)
        room = (0.95 * 48 / math.sqrt(3) - R * 20) / (P * speed)
        assert flux == pytest.approx(room, rel=1e-6)
        assert math.hypot(d, q) == pytest.approx(20, rel=1e-6)
        # No other current within both limits gives more, but by the saliency; a grid of currents knows.
        grid = np.linspace(-20, 0, 4001)
        most = np.minimum(np.sqrt(400 - grid**2), np.sqrt(np.maximum(room**2 - (PSI + LD * grid) ** 2, 0)) / LQ)
        best = (1.5 * P * (PSI + (LD - LQ) * grid) * most).max()
        assert 1.5 * P * (PSI + (LD - LQ) * d) * q == pytest.approx(best, rel=0.01)
        assert (result["motor.d_current"][-1], result["motor.q_current"][-1]) == pytest.approx((d, q), rel=0.02)


# -- limits of drives -------------------------------------------------------------------------------------------------


def test_a_limited_current_accelerates_evenly_until_the_back_emf_takes_over() -> None:
    """w = kt I t / J while limited, then J w' = kt (V - k w) / R from the instant at which V - k w = R I."""
    k, r, volts, most, inertia = 0.05, 1.0, 20.0, 4.0, 1e-3
    parts: dict[str, Block] = {
        "command": Constant(value=volts),
        "limit": CurrentLimiter(current_limit=most, resistance=r, back_emf_constant=k),
        "motor": DCMotor(resistance=r, torque_constant=k, rotor_inertia=inertia),
    }
    wires = ("command.out limit.in", "motor.shaft.speed limit.speed", "limit.out motor.voltage")
    result = run(parts, *wires, stop=3.0)
    corner = (volts - r * most) / k
    then = corner * inertia / (k * most)
    rate = k * k / (r * inertia)
    exact = np.where(
        result.time < then,
        k * most * result.time / inertia,
        volts / k - (volts / k - corner) * np.exp(-rate * (result.time - then)),
    )
    np.testing.assert_allclose(result["motor.shaft.speed"], exact, rtol=1e-8, atol=1e-9)
    assert instants(result, "limit.limit")[-1] == pytest.approx(then, rel=1e-9)
    off = run(parts | {"off": Constant(value=0)}, *wires, "off.out limit.enable", stop=0.5,
              initial={"motor.shaft.speed": 50.0})  # fmt: skip
    np.testing.assert_allclose(off["motor.current"], 0, atol=1e-12)
    np.testing.assert_allclose(off["motor.shaft.speed"], 50.0, rtol=1e-12)


def test_a_drive_runs_up_along_its_envelope() -> None:
    """w = Tp t / J to the corner P / Tp, then J w^2 / 2 grows with P, and the speed ends at the limit."""
    inertia, peak, power, most = 0.01, 2.0, 200.0, 180.0
    parts: dict[str, Block] = {
        "asked": Constant(value=5.0),
        "drive": TorqueEnvelope(peak_torque=peak, peak_power=power, speed_limit=most, bandwidth=1e5),
        "motor": Torque(),
        "rotor": Inertia(inertia=inertia),
    }
    wires = (
        "asked.out drive.reference",
        "drive.out motor.torque",
        "motor.shaft rotor.shaft",
        "rotor.shaft.speed drive.speed",
    )
    result = run(parts, *wires, stop=1.5, internal_step=1e-5, step=1e-2)
    corner, then = power / peak, power / peak * inertia / peak
    at = result.time
    exact = np.where(
        at < then, peak * at / inertia, np.sqrt(corner**2 + 2 * power * np.maximum(at - then, 0) / inertia)
    )
    below = exact < 0.97 * most
    np.testing.assert_allclose(result["rotor.shaft.speed"][below], exact[below], rtol=2e-3, atol=0.01)
    assert result["rotor.shaft.speed"][-1] == pytest.approx(most, rel=2e-3)
    assert result["rotor.shaft.speed"].max() <= most
    # Braking keeps the peak torque at any speed.
    brake = run(parts | {"asked": Constant(value=-5.0)}, *wires, stop=0.1, internal_step=1e-5,
                initial={"rotor.shaft.speed": 170.0})  # fmt: skip
    assert brake["drive.out"][-1] == pytest.approx(-peak, rel=1e-9)


def test_an_envelope_linearises_to_its_lag() -> None:
    parts: dict[str, Block] = {"drive": TorqueEnvelope(peak_torque=2, bandwidth=500), "w": Constant(value=0)}
    found = linear(parts, "w.out drive.speed", inputs=["drive.reference"], outputs=["drive.out"])
    assert complex(found.gain(500.0)[0, 0]) == pytest.approx(1 / (1 + 1j), rel=1e-9)


# -- bridge and supply ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("duty", [0.002, 0.03, 0.4, -0.03])
def test_dead_time_takes_its_share_against_the_current(duty: float) -> None:
    """A held rotor: i = d V / (R + Ron + Vd / I0) within the ripple, (|d| V - Vd) / (R + Ron) beyond."""
    volts, r, ron, ripple, lost = 24.0, 2.0, 0.1, 0.05, 24.0 * 1e-6 / 50e-6
    parts: dict[str, Block] = {
        "duty": Constant(value=duty),
        "battery": Constant(value=volts),
        "bridge": Bridge(dead_time=1e-6, switching_period=50e-6, ripple_current=ripple, on_resistance=ron),
        "motor": DCMotor(resistance=r, inductance=2e-3, torque_constant=0.05, rotor_inertia=1e-4),
        "wall": Fixed(),
    }
    wires = (
        "duty.out bridge.duty",
        "battery.out bridge.supply",
        "motor.current bridge.current",
        "bridge.out motor.voltage",
        "motor.shaft wall.shaft",
    )
    within = duty * volts / (r + ron + lost / ripple)
    beyond = (duty * volts - math.copysign(lost, duty)) / (r + ron)
    result = run(parts, *wires, stop=0.05, internal_step=1e-5)
    assert result["motor.current"][-1] == pytest.approx(within if abs(within) < ripple else beyond, rel=1e-6)
    assert balance(result) < 1e-6


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_dead_time_before_a_motor_without_inductance_slows_what_drives_and_what_brakes_alike(sign: float) -> None:
    """A flywheel that brakes from k w = 14 V to 6 V: with e = 6 V - k w, tau e' = -(e + Vd) until e = -(Vd + R I0).

    From there tau e' = -e R I0 / (Vd + R I0): nothing drives it past e = 0, nor holds it at Vd.
    """
    k, r, inertia, lost, ripple = 0.05, 2.0, 1e-4, 0.8, 0.1
    tau, knee = inertia * r / k**2, r * ripple
    parts: dict[str, Block] = {
        "command": Constant(value=6.0 * sign),
        "bridge": DeadTime(lost_voltage=lost, ripple_current=ripple, resistance=r, back_emf_constant=k),
        "motor": DCMotor(resistance=r, torque_constant=k, rotor_inertia=inertia),
    }
    wires = ("command.out bridge.in", "motor.shaft.speed bridge.speed", "bridge.out motor.voltage")
    result = run(parts, *wires, stop=0.6, initial={"motor.shaft.speed": 14.0 / k * sign})
    then = tau * math.log((8.0 - lost) / knee)
    gone = result.time - then
    e = np.where(
        gone < 0,
        -lost - (8.0 - lost) * np.exp(-result.time / tau),
        -(lost + knee) * np.exp(-np.maximum(gone, 0) / tau * knee / (lost + knee)),
    )
    np.testing.assert_allclose(result["motor.shaft.speed"] * k, (6.0 - e) * sign, rtol=1e-8)
    assert instants(result, "bridge.dead_time")[-1] == pytest.approx(then, rel=1e-8)
    held = np.clip(result["motor.current"] / ripple, -1, 1)
    np.testing.assert_allclose(result["bridge.out"], 6.0 * sign - lost * held, rtol=1e-9)


def test_dead_time_goes_by_the_current_where_there_is_an_inductance() -> None:
    """As a whole bridge does; and with next to no inductance as the law without says."""
    r, k = 2.0, 0.05

    def speed(law: Block, inductance: float, *wires: str, step: float = 1e-5) -> Array:
        parts: dict[str, Block] = {
            "wave": Sine(amplitude=6.0, frequency=3.0),
            "law": law,
            "motor": DCMotor(resistance=r, torque_constant=k, rotor_inertia=1e-4, inductance=inductance),
        }
        if isinstance(law, Bridge):
            parts |= {"battery": Constant(value=24.0), "share": Gain(gain=1 / 24, unit="1")}
        made = run(parts, *wires, "law.out motor.voltage", stop=0.5, internal_step=step)
        return np.asarray(made["motor.shaft.speed"])

    given = {"lost_voltage": 0.48, "ripple_current": 0.05, "resistance": r, "back_emf_constant": k}
    seen = ("wave.out law.in", "motor.current law.current")
    bridge = Bridge(dead_time=1e-6, switching_period=50e-6, ripple_current=0.05)
    whole = speed(
        bridge, 4e-3, "wave.out share.in", "share.out law.duty", "battery.out law.supply", "motor.current law.current"
    )
    np.testing.assert_allclose(speed(DeadTime(**given, inductance=True), 4e-3, *seen), whole, atol=1e-9)
    quick = speed(DeadTime(**given, inductance=True), 1e-5, *seen, step=1e-6)
    at_once = speed(DeadTime(**given), 0.0, "wave.out law.in", "motor.shaft.speed law.speed")
    np.testing.assert_allclose(quick, at_once, atol=5e-4 * np.abs(at_once).max())
    assert np.abs(whole - at_once).max() > 0.02 * np.abs(at_once).max()


def test_a_sagging_bus_and_its_capacitor() -> None:
    """C v' = (E - v) / R - i: v = E - R i (1 - exp(-t / (R C)))."""
    parts: dict[str, Block] = {
        "drawn": Constant(value=10),
        "bus": Supply(source_voltage=48, resistance=0.2, capacitance=0.01),
    }
    result = run(parts, "drawn.out bus.current", stop=0.02, internal_step=1e-4)
    closed_form = 48 - 2 * (1 - np.exp(-result.time / 2e-3))
    np.testing.assert_allclose(result["bus.voltage"], closed_form, atol=1e-6)
    parts["bus"] = Supply(source_voltage=48, resistance=0.2, time_constant=2e-3)
    told = run(parts, "drawn.out bus.current", stop=0.02, internal_step=1e-4)
    np.testing.assert_allclose(told["bus.voltage"], closed_form, atol=1e-6)
    assert balance(told) == pytest.approx(balance(result), abs=1e-9)
    parts["bus"] = Supply(source_voltage=48, resistance=0.2)
    assert run(parts, "drawn.out bus.current", stop=0.01)["bus.voltage"][-1] == pytest.approx(46)


def braking(**chopper: float) -> tuple[dict[str, Block], tuple[str, ...]]:
    """A flywheel that its drive brakes into the bus."""
    parts: dict[str, Block] = {
        "bus": Supply(source_voltage=48, resistance=0.1, capacitance=2e-3, returns=False),
        "duty": Constant(value=0.2),
        "bridge": Bridge(),
        "motor": DCMotor(resistance=0.3, inductance=1e-3, torque_constant=0.1, rotor_inertia=4e-3),
        "drawn": Sum(),
        "chopper": BrakeChopper(**chopper),
    }
    return parts, (
        "duty.out bridge.duty",
        "bus.voltage bridge.supply chopper.voltage",
        "motor.current bridge.current",
        "bridge.out motor.voltage",
        "bridge.supply_current drawn.a",
        "chopper.current drawn.b",
        "drawn.out bus.current",
    )


def test_braking_charges_the_bus_until_the_chopper_takes_it() -> None:
    """With the chopper the bus stays between its voltages; without, the capacitor takes all that the winding leaves."""
    start = {"motor.shaft.speed": 350.0}
    parts, wires = braking(resistance=4.0, switch_on=60.0, switch_off=55.0)
    result = run(parts, *wires, stop=0.5, initial=start, internal_step=2e-5)
    assert result["bus.voltage"].max() == pytest.approx(60, abs=0.5)
    assert switches(result, "chopper.chopper")[0] == 1
    assert balance(result) < 1e-5
    parts, wires = braking(resistance=4.0, switch_on=1e4, switch_off=1e3)
    free = run(parts, *wires, stop=0.5, initial=start, internal_step=2e-5)
    assert free["bus.source_current"].min() == 0.0
    assert free["bus.voltage"].max() > 70
    assert balance(free) < 1e-5


def test_the_chopper_switches_when_its_closed_form_says() -> None:
    """Fed by a constant current i: v rises by i / C to the upper voltage, then C v' = i - v / R to the lower."""
    c, i, r = 1e-3, 2.0, 10.0
    parts: dict[str, Block] = {
        "drawn": Sum(),
        "feed": Constant(value=-i),
        "bus": Supply(source_voltage=48, resistance=1.0, capacitance=c, returns=False),
        "chopper": BrakeChopper(resistance=r, switch_on=60, switch_off=50),
    }
    wires = ("feed.out drawn.a", "chopper.current drawn.b", "drawn.out bus.current", "bus.voltage chopper.voltage")
    result = run(parts, *wires, stop=0.05, internal_step=1e-4)
    up = c * (60 - 48) / i
    down = -r * c * math.log((50 - i * r) / (60 - i * r))
    again = c * (60 - 50) / i
    found = instants(result, "chopper.chopper")[:3]
    assert found == pytest.approx([up, up + down, up + down + again], rel=1e-7)


def test_what_a_supply_cannot_be() -> None:
    with pytest.raises(ParameterError, match="needs a resistance"):
        Supply(source_voltage=48, capacitance=1e-3)
    with pytest.raises(ParameterError, match="needs a resistance"):
        Supply(source_voltage=48, time_constant=1e-3)
    with pytest.raises(ParameterError, match="say the same in two ways"):
        Supply(source_voltage=48, resistance=0.1, capacitance=1e-3, time_constant=1e-3)
    with pytest.raises(ParameterError, match="needs a capacitance"):
        Supply(source_voltage=48, resistance=0.1, returns=False)
    parts, wires = braking(resistance=4.0, switch_on=60.0, switch_off=55.0)
    parts["bus"] = Supply(source_voltage=48, resistance=0.1)
    with pytest.raises(FlexarmError, match="algebraic loop"):
        model(parts, *wires)


# -- heat -------------------------------------------------------------------------------------------------------------

WARM = {
    "winding_heat_capacity": 8.0,
    "housing_heat_capacity": 60.0,
    "winding_thermal_resistance": 3.0,
    "housing_thermal_resistance": 6.0,
}


def heated(**given: float) -> dict[str, Block]:
    return {
        "command": Constant(value=12),
        "motor": ThermalDCMotor(resistance=2.0, torque_constant=0.05, rotor_inertia=1e-4, **(WARM | given)),
        "load": Fixed(),
    }


HEATED = ("command.out motor.voltage", "motor.shaft load.shaft")


def test_two_masses_warm_up_as_their_matrix_says() -> None:
    """Without coefficients the heat is V^2 / R, and the temperatures are those of a linear network."""
    result = run(heated(resistance_coefficient=0, magnet_coefficient=0), *HEATED, stop=600, step=5, internal_step=1.0)
    cw, ch, gw, gh = WARM.values()
    A = np.array([[-1 / (gw * cw), 1 / (gw * cw)], [1 / (gw * ch), -(1 / gw + 1 / gh) / ch]])
    b = np.array([72 / cw, 0])
    settled = -np.linalg.solve(A, b)
    assert settled == pytest.approx([72 * (gw + gh), 72 * gh])
    for k in (1, 30, 120):
        exact = settled - expm(A * result.time[k]) @ settled
        got = [result[f"motor.{part}_temperature"][k] - 293.15 for part in ("winding", "housing")]
        assert got == pytest.approx(list(exact), rel=1e-6)


@pytest.mark.parametrize("inductance", [0.0, 4e-3])
def test_a_warm_motor_follows_an_independent_solution(inductance: float) -> None:
    a, b = 0.0039, -0.002
    cw, ch, gw, gh = (WARM | {"winding_heat_capacity": 0.05, "housing_heat_capacity": 0.2}).values()

    def slope(t: float, x: Array) -> list[float]:
        w, tw, th, i = x
        r, k = 2 * (1 + a * (tw - 293.15)), 0.05 * (1 + b * (th - 293.15))
        if not inductance:
            i = (12 - k * w) / r
        inward, outward = (tw - th) / gw, (th - 300) / gh
        rise = (12 - r * i - k * w) / inductance if inductance else 0.0
        return [(k * i - 2e-4 * w) / 1e-3, (r * i * i - inward) / cw, (inward - outward) / ch, rise]

    parts = heated(
        resistance_coefficient=a, magnet_coefficient=b, inductance=inductance, viscous_friction=2e-4,
        winding_heat_capacity=0.05, housing_heat_capacity=0.2, ambient_temperature=300.0,
    )  # fmt: skip
    parts["load"] = Inertia(inertia=9e-4)
    result = run(parts, *HEATED, stop=2.0, internal_step=2e-4)
    exact = solve_ivp(slope, (0, 2), [0, 300, 300, 0], t_eval=result.time, rtol=1e-10, atol=1e-10).y
    assert exact[1].max() > 380
    np.testing.assert_allclose(result["motor.shaft.speed"], exact[0], rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(result["motor.winding_temperature"], exact[1], rtol=1e-7)
    assert balance(result) < 1e-7


def test_cold_it_is_the_dc_motor() -> None:
    warm = run(
        heated(resistance_coefficient=0, magnet_coefficient=0) | {"load": Inertia(inertia=1e-3)}, *HEATED, stop=0.5
    )
    parts = {"motor": DCMotor(resistance=2.0, torque_constant=0.05, rotor_inertia=1e-4), "load": Inertia(inertia=1e-3)}
    cold = run({"command": Constant(value=12), **parts}, *HEATED, stop=0.5)
    np.testing.assert_allclose(warm["motor.shaft.speed"], cold["motor.shaft.speed"], rtol=1e-12)


# -- servo ------------------------------------------------------------------------------------------------------------

SERVO = (
    "asked.out servo.reference",
    "motor.shaft.angle servo.measurement",
    "motor.shaft.speed servo.speed",
    "servo.out motor.voltage",
)


def servo(asked: float, **given: float) -> dict[str, Block]:
    return {
        "asked": Step(height=asked),
        "servo": DutyServo(**({"proportional_gain": 3.0, "derivative_gain": 0.05, "supply_voltage": 7.4} | given)),
        "motor": DCMotor(resistance=3.0, torque_constant=0.4, rotor_inertia=5e-3),
    }


def test_a_servo_swings_as_its_second_order_says() -> None:
    """J q'' = k (d V - k q') / R with d = kp e - kd q': its poles, by hand."""
    parts = {k: v for k, v in servo(0.0).items() if k != "asked"}
    found = linear(parts, *SERVO[1:], inputs=["servo.reference"], outputs=["motor.shaft.angle"])
    spring, damping = 0.4 * 3.0 * 7.4 / 3, (0.4 * 0.05 * 7.4 + 0.4**2) / 3
    np.testing.assert_allclose(np.sort_complex(found.poles()), np.sort_complex(np.roots([5e-3, damping, spring])))


def test_a_servo_at_full_duty_follows_an_independent_solution() -> None:
    def slope(t: float, x: Array) -> list[float]:
        duty = min(max(3 * (1.5 - x[0]) - 0.05 * x[1], -1), 1)
        return [x[1], 0.4 * (duty * 7.4 - 0.4 * x[1]) / 3 / 5e-3]

    result = run(servo(1.5), *SERVO, stop=1.0, internal_step=2e-4)
    exact = solve_ivp(slope, (0, 1), [0, 0], t_eval=result.time, rtol=1e-10, atol=1e-12, max_step=1e-3).y[0]
    np.testing.assert_allclose(result["motor.shaft.angle"], exact, atol=1e-8)
    assert result["servo.duty"].max() == 1.0


def test_a_sampled_servo_is_its_recursion() -> None:
    """Between samples of 10 ms the voltage is held: the motor's exact step, in plain Python."""
    rate, period = 0.4**2 / (3 * 5e-3), 0.01
    fade, q, w, angles = math.exp(-rate * period), 0.0, 0.0, []
    for _ in range(100):
        angles.append(q)
        volts = 7.4 * min(max(3 * (1.5 - q) - 0.05 * w, -1), 1)
        end = volts / 0.4
        q, w = q + end * period + (w - end) * (1 - fade) / rate, end + (w - end) * fade
    result = run(servo(1.5, period=period), *SERVO, stop=1.0, internal_step=1e-3)
    np.testing.assert_allclose(result["motor.shaft.angle"][:1000:10], angles, atol=1e-9)
