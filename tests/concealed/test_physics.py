"""The truth generator against closed forms, energy and other integrators. Nothing of flexarm takes part."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from benchmarks.concealed import beam, native
from benchmarks.concealed.effects import Concealed
from benchmarks.concealed.mechanism import Mechanism, Readout, Whirl
from benchmarks.concealed.plants import PLANTS
from benchmarks.concealed.plants.base import LinkOptions
from benchmarks.concealed.simulator import InputChain, SensorChain, Simulator
from benchmarks.concealed.truth import MAXWELL_BAND, MAXWELL_PER_DECADE, Truth, _structural, simulator

DT, STEP = 1e-3, 2e-5


def body(inertia: float = 1.0, substeps: int = 50, **chains: Any) -> tuple[Any, Any, Callable[..., Any]]:
    """An inertia under the commanded torque; elements are added by the caller before it is discretised."""
    m = Mechanism()
    shaft = m.coordinate("body")
    m.inertia(shaft, inertia)
    m.torque(shaft)
    sensors = [Readout(shaft.sense), Readout(shaft.sense, 1), Readout(shaft.sense, 2)]
    return m, shaft, lambda: Simulator(m, sensors, DT, substeps, **chains)


# -- the arm ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tip_mass", [0.0, 0.02, 0.3])
def test_clamped_frequencies_are_those_of_the_transcendental_equation(tip_mass: float) -> None:
    """1 + cos b cosh b + mu b (cos b sinh b - sin b cosh b) = 0 with mu = tip mass / mass of the arm."""
    length, mass, rigidity = 0.419, 0.065, 0.1374
    mu = tip_mass / mass

    def characteristic(b: Any) -> Any:
        return 1 / math.cosh(b) + math.cos(b) + mu * b * (math.cos(b) * math.tanh(b) - math.sin(b))

    grid = np.linspace(0.1, 12, 4000)
    signs = np.sign([characteristic(b) for b in grid])
    roots = [brentq(characteristic, grid[i], grid[i + 1]) for i in np.flatnonzero(np.diff(signs))][:3]
    expected = np.array(roots) ** 2 * math.sqrt(rigidity / (mass * length**3))
    found = beam.modes(length, mass, rigidity, tip_mass, 3).frequency
    assert found == pytest.approx(expected, rel=1e-5)


def test_shapes_have_the_published_integrals() -> None:
    """[Blevins 1979, Table 8-1], for Q with int Q^2 = L: here modes of mass 1, so everything carries 1 / sqrt(m)."""
    length, mass = 0.33, 0.06
    made = beam.modes(length, mass, 0.4, count=2)
    beta = np.array([1.8751040687, 4.6940911330])
    scale = math.sqrt(mass)
    upward = np.array([1, -1])  # the tips of our modes move up, that of Q_2 moves down
    assert upward * made.coupling == pytest.approx(scale * length * 2 / beta**2, rel=1e-6)
    assert made.tip * scale == pytest.approx([2, 2], rel=1e-6)
    assert upward * made.curvature * scale == pytest.approx(2 * beta**2 / length**2, rel=1e-5)
    assert np.diag(made.stiffening) == pytest.approx([1.19334, 6.47822], rel=1e-5)
    assert abs(made.stiffening[0, 1]) == pytest.approx(0.68586, rel=1e-4)
    assert made.inertia == pytest.approx(mass * length**2 / 3, rel=1e-12)


def test_a_tip_mass_counts_in_inertia_coupling_and_tension() -> None:
    length, mass, tip_mass = 0.8, 0.234, 0.05
    made = beam.modes(length, mass, 1.42, tip_mass, 1)
    assert made.inertia == pytest.approx(mass * length**2 / 3 + tip_mass * length**2)
    x = np.linspace(0, length, 20001)
    # static deflection under a load at the tip is a good first mode; Rayleigh's quotient bounds the frequency above
    w = 3 * length * x**2 - x**3
    kinetic = mass / length * np.trapezoid(w**2, x) + tip_mass * w[-1] ** 2
    potential = 1.42 * np.trapezoid((6 * length - 6 * x) ** 2, x)
    bound = math.sqrt(potential / kinetic)
    assert 0.985 * bound < made.frequency[0] < bound


def test_independent_values_of_the_quanser_arm() -> None:
    """Notes 1.4, set A: angle one second after a step of 1 V for 1 s, without structural damping."""
    plant = PLANTS["srv02-flexible"]
    p = plant.nominal() | {"gear.inertia": 2.08e-3 - 0.9 * 70**2 * 4.606e-7, "link.damping_ratio": 0.0}
    made = simulator(Truth(plant, p), ["link.hub.angle"], DT)
    made.mechanism.spring(plant.assemble(p, {}, LinkOptions(), 0.0).ports["link.hub"], 0.0, 0.004)
    run = Simulator(made.mechanism, made.readouts, DT, 1).run(np.where(np.arange(2001) < 1000, 1.0, 0.0))
    assert math.degrees(run.clean[2000, 0]) == pytest.approx(100.741, abs=0.05)


# -- integration ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(PLANTS))
def test_runs_agree_with_scipy(name: Any) -> None:
    """The bare plant, and the voltage plants with inductance, against an adaptive integrator."""
    plant = PLANTS[name]
    concealed = (Concealed("inductance", "motor", {"inductance": 4e-3}),) if plant.inductance else ()
    made = simulator(Truth(plant, plant.nominal(), concealed), [s.signal for s in plant.sensors], DT)
    command = np.repeat([1.0, -0.7, 0.3], 60) * plant.excitation.amplitude
    run = made.run(command, states=True)
    sense, _, kind, parameters = made.mechanism.rows(made.A, made.B)

    def slope(t: Any, x: Any) -> Any:
        f = np.zeros(made.B.shape[1])
        f[0] = command[min(int(t / DT + 1e-9), len(command) - 1)]
        for j, k in enumerate(kind):
            assert k == native.GRAVITY
            f[1 + j] = -parameters[j, 0] * math.sin(sense[j] @ x)
        return made.A @ x + made.B @ f

    x = np.zeros(len(made.A))
    for k in range(len(command) - 1):
        assert run.states is not None
        assert run.states[k] == pytest.approx(x, rel=1e-6, abs=1e-7)
        x = solve_ivp(slope, (k * DT, (k + 1) * DT - 1e-12), x, rtol=1e-10, atol=1e-13).y[:, -1]


def test_a_free_pendulum_keeps_its_energy_and_period() -> None:
    plant = PLANTS["pendulum"]
    made = simulator(Truth(plant, plant.nominal()), ["arm.shaft.angle", "arm.shaft.speed"], DT)
    start = 1.0
    y = made.run(np.zeros(4000), initial=made.at(start)).clean
    inertia, moment = 6.5e-3 + 100 * 8e-6, 0.18 * 9.81 * 0.165
    energy = inertia * y[:, 1] ** 2 / 2 + moment * (1 - np.cos(y[:, 0]))
    assert np.ptp(energy) < 1e-7 * energy[0]
    crossings = np.flatnonzero((y[:-1, 0] > 0) & (y[1:, 0] <= 0))
    when = [(k + y[k, 0] / (y[k, 0] - y[k + 1, 0])) * DT for k in crossings]
    k2 = math.sin(start / 2) ** 2
    quarter = quad(lambda a: 1 / math.sqrt(1 - k2 * math.sin(a) ** 2), 0, math.pi / 2)[0]
    assert np.mean(np.diff(when)) == pytest.approx(4 * math.sqrt(inertia / moment) * quarter, rel=1e-5)


def test_whirling_arm_keeps_energy_and_angular_momentum() -> None:
    """Without torque and damping, T = 1/2 w^2 (J + a'Ha) + w c'a' + a''/2 ... : energy and dT/dw are constant."""
    made = beam.modes(0.8, 0.234, 1.42, count=2)
    m = Mechanism()
    hub, inertia = m.coordinate("hub"), made.inertia + 0.01
    m.inertia(hub, inertia)
    modes = [m.coordinate("a1"), m.coordinate("a2")]
    for i, mode in enumerate(modes):
        m.inertia(mode, 1.0)
        m.couple(hub, mode, float(made.coupling[i]))
        m.spring(mode, float(made.frequency[i] ** 2))
    H = made.softening - made.stiffening
    m.whirl = Whirl(hub, modes, H)
    start = np.array([0.0, 0.02, 0.0, 8.0, 0.0, 0.1])
    x = Simulator(m, [Readout(hub.sense)], DT, 50).run(np.zeros(2000), initial=start, states=True).states
    assert x is not None
    a, w, v = x[:, 1:3], x[:, 3], x[:, 4:6]
    added = np.einsum("ti,ij,tj->t", a, H, a)
    momentum = (inertia + added) * w + v @ made.coupling
    energy = (inertia + added) * w**2 / 2 + w * (v @ made.coupling) + (v**2).sum(1) / 2
    energy += (a**2 * made.frequency**2).sum(1) / 2
    assert np.ptp(added) > 1e-6
    assert np.ptp(momentum) < 1e-6 * momentum[0]
    assert np.ptp(energy) < 1e-6 * energy[0]


# -- laws -------------------------------------------------------------------------------------------------------------


def test_sliding_friction_stops_where_energy_says_and_holds_for_ever() -> None:
    """1/2 J w^2 = Fc d; then no creep at all under a torque below the level."""
    m, shaft, made = body(2.0)
    m.add(native.FRICTION, shaft, 0.5, 0.5, 0.5, 0.5, 1.0, 0.0, 1.0)
    torque = np.where(np.arange(6000) < 4500, 0.0, 0.49)
    y = made().run(torque, initial=np.array([0.0, 0.7])).clean
    assert y[4000, 0] == pytest.approx(2.0 * 0.7**2 / 2 / 0.5, rel=1e-6)
    assert np.argmax(y[:, 1] == 0) * DT == pytest.approx(2.0 * 0.7 / 0.5, abs=1.1e-3)
    assert np.ptp(y[3000:, 0]) < 1e-15


def test_levels_differ_by_direction_and_static_friction_must_be_overcome() -> None:
    m, shaft, made = body(1.0)
    m.add(native.FRICTION, shaft, 0.2, 0.3, 0.4, 0.6, 0.05, 0.0, 1.0)
    ramp = np.concatenate([np.linspace(0, 1, 5000), np.zeros(15000), -np.linspace(0, 1, 5000)])
    y = made().run(ramp).clean
    forward = np.argmax(y[:, 0] > 1e-12)
    assert ramp[forward] == pytest.approx(0.4, abs=2e-3)
    rest = y[19999, 0]
    assert y[19999, 1] == 0
    backward = 20000 + np.argmax(y[20000:, 0] < rest - 1e-12)
    assert ramp[backward] == pytest.approx(-0.6, abs=2e-3)


def test_stribeck_stop_distance_is_the_integral_over_the_curve() -> None:
    """d = int_0^w0 J w dw / F(w)."""
    coulomb, peak, velocity = 0.3, 0.9, 0.2
    m, shaft, made = body(1.0)
    m.add(native.FRICTION, shaft, coulomb, coulomb, peak, peak, velocity, 0.0, 1.0)
    y = made().run(np.zeros(4000), initial=np.array([0.0, 0.8])).clean
    expected = quad(lambda w: w / (coulomb + (peak - coulomb) * math.exp(-((w / velocity) ** 2))), 0, 0.8)[0]
    assert y[-1, 1] == 0
    assert y[-1, 0] == pytest.approx(expected, rel=1e-5)


def test_a_stray_spring_pulls_to_where_it_is_at_rest() -> None:
    plant = PLANTS["srv02-flexible"]
    spring = Concealed("stray_spring", "motor.shaft", {"stiffness": 1e-3, "rest_angle": -0.4})
    made = simulator(Truth(plant, plant.nominal(), concealed=(spring,)), ["link.hub.angle"], DT)
    run = Simulator(made.mechanism, made.readouts, DT, 1).run(np.zeros(20_001))
    assert run.clean[-1, 0] == pytest.approx(-0.4 / 70, rel=1e-3)


def test_two_frictions_on_one_spring_stick_together() -> None:
    """Two bodies on a spring, both rubbing: the wound spring is held as long as neither level is exceeded."""
    m = Mechanism()
    a, b = m.coordinate("a"), m.coordinate("b")
    m.inertia(a, 1.0)
    m.inertia(b, 1.0)
    m.spring(a.against(b), 10.0)
    m.torque(a)
    for port in (a, b):
        m.add(native.FRICTION, port, 0.5, 0.5, 0.5, 0.5, 1.0, 0.0, 1.0)
    y = Simulator(m, [Readout(a.sense), Readout(b.sense)], DT, 50).run(
        np.zeros(500), initial=np.array([0.049, 0, 0, 0])
    )
    assert np.abs(y.clean - y.clean[0]).max() < 1e-15
    y = Simulator(m, [Readout(a.sense), Readout(b.sense)], DT, 50).run(np.zeros(500), initial=np.array([0.06, 0, 0, 0]))
    assert y.clean[-1, 0] < 0.0599
    assert y.clean[-1, 1] > 1e-6


def test_contact_bounces_as_the_damped_half_wave_says() -> None:
    """Free flight over the gap, then p = v/wd exp(-z w t) sin wd t until k p + d p' = 0, then free flight back."""
    stiffness, damping, gap, speed = 400.0, 3.0, 0.01, 0.5
    m, shaft, made = body(1.0, substeps=100)
    m.add(native.CONTACT, shaft, stiffness, damping, gap)
    y = made().run(np.zeros(400), initial=np.array([0.0, speed])).clean
    omega, decay = math.sqrt(stiffness - damping**2 / 4), damping / 2

    def penetration(t: Any) -> Any:
        return speed / omega * math.exp(-decay * t) * math.sin(omega * t)

    def rate(t: Any) -> Any:
        return speed * math.exp(-decay * t) * (math.cos(omega * t) - decay / omega * math.sin(omega * t))

    away = brentq(lambda t: stiffness * penetration(t) + damping * rate(t), 0.5 * math.pi / omega, math.pi / omega)
    after = int((gap / speed + away) / DT) + 2
    assert y[10, 1] == speed
    assert y[after, 1] == pytest.approx(rate(away), rel=2e-5)


def test_bouc_wen_follows_its_first_loading() -> None:
    """Sharpness 1: z = zy (1 - exp(-e / zy)) while e grows; the torque balance is read off the motion."""
    m, shaft, made = body(1e-3)
    stiffness, share, twist = 5.0, 0.3, 0.02
    m.spring(shaft, share * stiffness, 0.05)
    m.add(native.BOUC_WEN, shaft, (1 - share) * stiffness, twist, 1.0, 0.5)
    torque = np.linspace(0, 0.2, 4000)
    y = made().run(torque).clean
    law = share * stiffness * y[:, 0] + (1 - share) * stiffness * twist * (1 - np.exp(-y[:, 0] / twist))
    assert y[-1, 0] > 2 * twist
    assert law + 0.05 * y[:, 1] + 1e-3 * y[:, 2] == pytest.approx(torque, abs=1e-6)


def test_structural_damping_has_a_constant_loss_factor() -> None:
    m, shaft, _ = body(1.0)
    _structural(m, shaft, 7.0, 0.1)
    A, B = m.state_space()
    edge = 10 ** (0.5 / MAXWELL_PER_DECADE)  # an element stands for half the way to its neighbours
    for omega in (3.0, 16.0, 60.0, 130.0):
        assert MAXWELL_BAND[0] * 10 <= omega <= MAXWELL_BAND[1] / 10
        response = np.linalg.solve(1j * omega * np.eye(len(A)) - A, B[:, 0])[0]
        dynamic = 1 / response + omega**2
        spread = math.atan(omega / MAXWELL_BAND[0] * edge) - math.atan(omega / MAXWELL_BAND[1] / edge)
        assert dynamic.imag / 7.0 == pytest.approx(0.1 * 2 / math.pi * spread, rel=5e-3)
        assert dynamic.imag / 7.0 == pytest.approx(0.1, rel=0.06)


def test_drag_gravity_ripple_cubic_and_warm_up() -> None:
    """Each force at a known state, from the acceleration of the first step."""
    e, w = 0.3, -0.8
    cases = {
        native.DRAG: ((2.0,), 2.0 * w * w),
        native.GRAVITY: ((1.5, 0.2), -1.5 * math.sin(e - 0.2)),
        native.RIPPLE: ((0.4, 3.0, 0.5), 0.4 * math.sin(3 * e + 0.5)),
        native.CUBIC: ((6.0,), -6.0 * e**3),
        native.WARM_UP: ((0.7, 20.0), -0.7 * math.exp(-5 / 20) * w),
        native.VIBRATION: ((0.3, 40.0, 0.9), 0.3 * math.sin(0.9)),
    }
    for kind, (parameters, force) in cases.items():
        m, shaft, made = body(1.0)
        m.add(kind, shaft, *parameters)
        y = made().run(np.zeros(2), initial=np.array([e, w]), start=5.0).clean
        assert y[0, 2] == pytest.approx(force, rel=1e-12), kind


def test_oil_that_warms_damps_less_as_scipy_says() -> None:
    """A body that coasts: m v' = -B exp(-b T) v, C T' = B exp(-b T) v^2 - T / G; cold, the matrices damp with B."""
    B, b, C, G, start = 0.8, 0.05, 0.05, 30.0, 3.0
    m, shaft, made = body(1.0, substeps=10)
    m.spring(shaft, 0.0, B)
    m.add(native.OILED, shaft, B, b, C, G)
    y = made().run(np.zeros(3000), initial=np.array([0.0, start])).clean

    def slope(t: float, x: Any) -> list[float]:
        damping = B * math.exp(-b * x[1])
        return [-damping * x[0], (damping * x[0] ** 2 - x[1] / G) / C]

    t = np.arange(3000) * DT
    exact = solve_ivp(slope, (0, t[-1]), [start, 0.0], t_eval=t, rtol=1e-11, atol=1e-11).y
    assert exact[1].max() > 25
    assert y[:, 1] == pytest.approx(exact[0], abs=1e-6)


def test_a_belt_without_pretension_is_a_spring_of_one_strand() -> None:
    """Half of the stiffness and of the damping, whichever strand pulls: where it always hangs, nobody can tell."""
    outcomes = []
    for slack in (True, False):
        m = Mechanism()
        rim, carriage = m.coordinate("rim"), m.coordinate("carriage")
        m.inertia(rim, 0.3)
        m.inertia(carriage, 1.5)
        m.torque(rim)
        between = rim.against(carriage)
        if slack:
            m.add(native.STRANDS, between, 800.0, 2.0, 0.0)
        else:
            m.spring(between, 400.0, 1.0)
        push = 5 * np.sin(2 * math.pi * 4 * DT * np.arange(1000))
        outcomes.append(Simulator(m, [Readout(between.sense), Readout(carriage.sense)], DT, 200).run(push).clean)
    assert np.ptp(outcomes[1][:, 0]) > 0.01
    assert outcomes[0] == pytest.approx(outcomes[1], abs=1e-6)


def meshed(stiffness: float, damping: float, waves: list[tuple[float, float, float]]) -> Mechanism:
    """A rotor and a load on either side of an elastic gear of ratio 20 that errs."""
    m = Mechanism()
    load, rotor = m.coordinate("load"), m.coordinate("rotor")
    m.inertia(load, 0.02)
    m.inertia(rotor, 1e-4)
    m.torque(rotor)
    twist = rotor.geared(1 / 20).against(load)
    m.spring(twist, stiffness, damping)
    law = [stiffness, damping, *(value for wave in waves for value in wave)]
    m.add(native.MESH, twist, *law)
    m.add(native.MESH_INPUT, rotor, *law)
    return m


WAVES = [(2e-3, 2.0, 0.7), (5e-4, 4.0, -1.9), (3e-3, 0.05, 2.0)]


def test_the_transmission_error_of_a_gear_agrees_with_scipy() -> None:
    """By the energy alone: torque on each shaft = -dU / d(angle), U = k e^2 / 2; and a damper on e'."""
    k, d = 90.0, 0.05
    m = meshed(k, d, WAVES)
    made = Simulator(m, [Readout({0: 1.0}), Readout({1: 1.0})], DT, 100)
    torque = 0.05 * np.sin(2 * math.pi * 3 * DT * np.arange(1500))

    def error(theta: float) -> float:
        return sum(a * (math.sin(n * theta + phi) - math.sin(phi)) for a, n, phi in WAVES)

    def slope(t: float, x: Any, u: float) -> list[float]:
        load, rotor, v, w = x
        share = 1 / 20 + sum(a * n * math.cos(n * rotor + phi) for a, n, phi in WAVES)
        tau = k * (rotor / 20 + error(rotor) - load) + d * (share * w - v)
        return [v, w, tau / 0.02, (u - share * tau) / 1e-4]

    x, rows = np.zeros(4), []
    for u in torque:
        rows.append(x[:2])
        x = solve_ivp(slope, (0, DT), x, args=(u,), rtol=1e-9, atol=1e-12).y[:, -1]
    exact = np.array(rows)
    assert np.ptp(exact[:, 1]) > 4 * math.pi  # several waves pass
    assert made.run(torque).clean == pytest.approx(exact, abs=2e-6)


def test_a_gear_that_errs_takes_no_power_and_is_at_rest_where_it_begins() -> None:
    k = 90.0
    m = meshed(k, 0.0, WAVES)
    made = Simulator(m, [Readout({0: 1.0})], DT, 200)
    assert not made.run(np.zeros(50)).clean.any()
    x = made.run(np.zeros(800), states=True, initial=np.array([0.0, 0.0, 0.0, 25.0])).states
    assert x is not None
    error = sum(a * (np.sin(n * x[:, 1] + phi) - math.sin(phi)) for a, n, phi in WAVES)
    twist = x[:, 1] / 20 + error - x[:, 0]
    energy = 0.5 * (0.02 * x[:, 2] ** 2 + 1e-4 * x[:, 3] ** 2 + k * twist**2)
    assert (0.5 * k * twist**2).max() > 0.01 * energy[0]
    assert energy == pytest.approx(energy[0], rel=1e-6)


def test_input_chain_delay_lag_and_limits() -> None:
    torque = np.where(np.arange(3000) < 1000, 0.0, 1.0)
    late = body(1.0, substeps=10, input=InputChain(delay=0.0123))[2]().run(torque).clean
    t = np.arange(3000) * DT
    assert late[:, 1] == pytest.approx(np.maximum(t - 1.0123, 0), abs=1e-11)
    slow = body(1.0, substeps=10, input=InputChain(lag=0.05))[2]().run(torque).clean
    s = np.maximum(t - 1, 0)
    assert slow[:, 1] == pytest.approx(s - 0.05 * (1 - np.exp(-s / 0.05)), abs=1e-9)
    chain = InputChain(forward=2.0, backward=3.0, offset=0.1, low=-1.0, high=0.8, dead_low=-0.3, dead_high=0.2)
    levels = {0.05: 0.0, 0.1: 0.1, 5.0: 0.6, -0.1: 0.0, -0.2: -0.2, -5.0: -0.7}
    for command, expected in levels.items():
        y = body(1.0, substeps=2, input=chain)[2]().run(np.full(3, command)).clean
        assert y[0, 2] == pytest.approx(expected, abs=1e-12), command


def test_sensor_chain() -> None:
    chains = [SensorChain(lag=0.02), SensorChain(scale=1.1, bias=0.3), SensorChain(rectified=True)]
    y = body(1.0, sensors=chains)[2]().run(np.full(500, -2.0)).clean
    plain = body(1.0)[2]().run(np.full(500, -2.0)).clean
    t = np.arange(500) * DT
    slow = -(t**2) + 2 * 0.02 * t - 2 * 0.02**2 * (1 - np.exp(-t / 0.02))
    assert y[:, 0] == pytest.approx(slow, abs=1e-7)
    assert y[:, 1] == pytest.approx(1.1 * plain[:, 1] + 0.3)
    assert y[:, 2] == pytest.approx(np.abs(plain[:, 2]))


def test_a_lossy_gear_weighs_the_rotor_with_its_efficiency() -> None:
    plant = PLANTS["srv02-flexible"]
    M = plant.assemble(plant.nominal(), {}, LinkOptions(), 0.0).mechanism.mass_matrix()
    arm = 0.065 * 0.419**2 / 3
    assert M[0, 0] == pytest.approx(0.9 * 70**2 * 4.606e-7 + 5.282e-5 + arm)


def test_discretisation_is_the_matrix_exponential() -> None:
    plant = PLANTS["geared-two-mass"]
    A, B = plant.assemble(plant.nominal(), {}, LinkOptions(), 1e-3).mechanism.state_space()
    made = simulator(
        Truth(plant, plant.nominal(), (Concealed("inductance", "motor", {"inductance": 1e-3}),)), ["tacho.out"], DT
    )
    states = made.run(np.full(200, 2.0), states=True).states
    assert states is not None
    steady = np.linalg.lstsq(A, -2.0 * B[:, 0], rcond=None)[0]
    assert len(states[0]) == len(steady) == 5
    block = np.zeros((6, 6))
    block[:5, :5], block[:5, 5:] = A, 2.0 * B
    assert states[100] == pytest.approx(expm(block * 0.1)[:5, 5], rel=1e-9)
