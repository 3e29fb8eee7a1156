"""Losses of an elastic gear and load-dependent friction: closed forms both ways, self-locking, stick, an own solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from blocks.actuators.effort import Torque
from blocks.actuators.friction import BearingFriction
from blocks.actuators.gear import Gear
from blocks.actuators.load_dependent_friction import LoadDependentFriction
from blocks.controllers.gain import Gain
from blocks.links.inertia import Inertia
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import FlexarmError, ParameterError
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_drive_train import balance

JM, JL, K, D = 2e-4, 0.05, 4e3, 20.0
WIRES = (
    "push.out drive.torque",
    "drive.shaft rotor.shaft gear.input",
    "pull.out weight.torque",
    "gear.output load.shaft weight.shaft",
)


def geared(gear: Gear, push: float | Block, pull: float = 0.0, rotor: float = JM) -> dict[str, Block]:
    return {
        "push": push if isinstance(push, Block) else Constant(value=push),
        "drive": Torque(),
        "rotor": Inertia(inertia=rotor),
        "gear": gear,
        "load": Inertia(inertia=JL),
        "pull": Constant(value=pull),
        "weight": Torque(),
    }


@pytest.mark.parametrize("n", [20.0, -20.0])
@pytest.mark.parametrize(("eta", "eta_b"), [(0.8, 0.6), (0.6, 0.1)])
@pytest.mark.parametrize(
    ("push", "pull", "driving"), [(0.3, -2.0, True), (-0.3, 2.0, True), (-0.02, 6.0, False), (0.02, -6.0, False)]
)
def test_power_either_way_gives_the_accelerations_of_pelchen(
    n: float, eta: float, eta_b: float, push: float, pull: float, driving: bool
) -> None:
    """[Pelchen 2002]: torque in = tau / (n eta) while the input drives, eta_b tau / n while the output does.

    With T and P at the shafts, tau = Jl a - P and T - torque in = n Jm a give the acceleration a of the load.
    """
    push = push * np.sign(n)
    share = 1 / eta if driving else eta_b
    exact = (n * push + share * pull) / (n**2 * JM + share * JL)
    gear = Gear(ratio=n, stiffness=K, damping=D, efficiency=eta, backdriving_efficiency=eta_b)
    # The load starts wound up as it will be, so that nothing swings.
    tau = JL * exact - pull
    start = {"load.shaft.angle": -tau / K}
    result = run(geared(gear, push, pull), *WIRES, stop=0.3, initial=start, internal_step=1e-4)
    np.testing.assert_allclose(result["load.shaft.speed"], exact * result.time, rtol=1e-6, atol=1e-9)
    assert result["gear.torque"][-1] == pytest.approx(tau, rel=1e-6)
    assert (np.sign(result["gear.torque"][-1] * result["load.shaft.speed"][-1]) > 0) == driving
    assert balance(result) < 1e-7


@pytest.mark.parametrize("eta_b", [0.0, -0.4])
def test_a_gear_that_locks_itself_holds_any_load_exactly(eta_b: float) -> None:
    gear = Gear(ratio=40, stiffness=K, damping=D, efficiency=0.45, backdriving_efficiency=eta_b)
    result = run(geared(gear, 0.0, 30.0), *WIRES, stop=1.0, internal_step=1e-4)
    assert np.all(result["rotor.shaft.angle"] == 0.0)
    assert result["load.shaft.angle"][-1] == pytest.approx(30.0 / K, rel=1e-4)
    assert balance(result) < 1e-7


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_stuck_input_lets_go_at_the_level_of_its_load(share: float) -> None:
    """At rest under a weight P the input holds T between eta_b P / n and P / (n eta)."""
    n, eta, eta_b, weight = 20.0, 0.8, 0.6, 5.0
    gear = Gear(ratio=n, stiffness=K, damping=D, efficiency=eta, backdriving_efficiency=eta_b)
    for torque, moves in (
        (weight / (n * eta) * share, share > 1),
        (weight * eta_b / n / share, share > 1),
    ):
        start = {"load.shaft.angle": -weight / K}
        result = run(geared(gear, torque, -weight), *WIRES, stop=0.3, initial=start, internal_step=1e-4)
        assert (np.abs(result["rotor.shaft.angle"]).max() > 0) == moves
        if moves:
            up = torque > weight / n
            assert np.sign(result["load.shaft.speed"][-1]) == (1 if up else -1)


def test_a_lossy_gear_with_bearing_friction_follows_an_independent_solution() -> None:
    """Mesh loss and bearing friction of the input under a swinging torque: hand-written equations and their stops."""
    n, eta, eta_b, dry, viscous = 20.0, 0.7, 0.5, 0.02, 1e-3

    def friction(side: float, tau: float) -> float:
        loss = (1 / eta - 1) if tau / n * side > 0 else (1 - eta_b)
        return dry + abs(tau / n) * loss

    def slope(t: float, x: np.ndarray, side: float) -> list[float]:
        a, b, va, vb = x
        tau = K * (a / n - b) + D * (va / n - vb)
        torque = 0.4 * np.sin(2 * np.pi * 3 * t) - tau / n - viscous * va - (side * friction(side, tau) if side else 0)
        return [va, vb, torque / JM if side else 0.0, tau / JL]

    def pulled(t: float, x: np.ndarray) -> float:
        tau = K * (x[0] / n - x[1]) + D * (x[2] / n - x[3])
        rest = 0.4 * np.sin(2 * np.pi * 3 * t) - tau / n
        return float(rest - np.sign(rest) * friction(np.sign(rest), tau))

    time, state, now, side, stop = [0.0], [np.zeros(4)], 0.0, 0.0, 0.6
    while now < stop:
        if side:
            event = lambda t, x, side: x[2]  # noqa: E731
            event.direction = -side  # type: ignore[attr-defined]
        else:

            def event(t: float, x: np.ndarray, side: float) -> float:
                tau = K * (x[0] / n - x[1]) + D * (x[2] / n - x[3])
                rest = 0.4 * np.sin(2 * np.pi * 3 * t) - tau / n
                return float(abs(rest) - friction(np.sign(rest), tau))

            event.direction = 1  # type: ignore[attr-defined]
        event.terminal = True  # type: ignore[attr-defined]
        part = solve_ivp(
            slope, (now, stop), state[-1], args=(side,), events=event, rtol=1e-10, atol=1e-12, max_step=1e-3
        )
        time += list(part.t[1:])
        state += list(part.y.T[1:])
        now = part.t[-1]
        if now >= stop:
            break
        if side:
            state[-1] = state[-1] * [1, 1, 0, 1]
            side = 0.0
        rest = pulled(now, state[-1])
        tau = K * (state[-1][0] / n - state[-1][1]) + D * (state[-1][2] / n - state[-1][3])
        total = 0.4 * np.sin(2 * np.pi * 3 * now) - tau / n
        if rest * total >= -1e-12:
            side = float(np.sign(total))
    parts = geared(
        Gear(ratio=n, stiffness=K, damping=D, efficiency=eta, backdriving_efficiency=eta_b),
        Sine(amplitude=0.4, frequency=3),
    )
    parts["bearing"] = BearingFriction(coulomb_friction=dry, viscous_friction=viscous)
    result = run(parts, *WIRES, "bearing.shaft rotor.shaft", stop=stop, internal_step=2e-5)
    exact = np.interp(result.time, time, np.array(state)[:, 0])
    assert np.ptp(exact) > 1.0
    np.testing.assert_allclose(result["rotor.shaft.angle"], exact, atol=2e-5 * np.ptp(exact))
    assert balance(result) < 1e-6


def test_both_runtimes_agree_on_losses() -> None:
    parts = geared(
        Gear(ratio=20, stiffness=K, damping=D, efficiency=0.6, backdriving_efficiency=-0.1),
        Sine(amplitude=0.5, frequency=4),
        1.0,
    )
    made = run(parts, *WIRES, stop=0.3, internal_step=1e-4)
    other = run(parts, *WIRES, stop=0.3, internal_step=1e-4, backend="interpreter")
    np.testing.assert_allclose(made["rotor.shaft.angle"], other["rotor.shaft.angle"], rtol=0, atol=1e-11)
    assert len(made.events) > 4


def test_an_elastic_gear_without_losses_swings_as_two_masses_do() -> None:
    poles = linear(geared(Gear(ratio=20, stiffness=K, inertia=0.01), 0.0), *WIRES).poles()
    assert max(poles.imag) == pytest.approx(np.sqrt(K * (1 / (JL + 0.01) + 1 / (20**2 * JM))), rel=1e-9)


def test_losses_of_direction_need_elasticity() -> None:
    with pytest.raises(ParameterError, match="backdriving_efficiency is for an elastic Gear"):
        Gear(ratio=20, backdriving_efficiency=0.2)


# -- friction that reads its load --------------------------------------------------------------------------------------

LOADED = ("push.out drive.torque friction.load", "drive.shaft body.shaft friction.shaft")


def loaded(push: float | Block, **given: float) -> dict[str, Block]:
    return {
        "push": push if isinstance(push, Block) else Constant(value=push),
        "drive": Torque(),
        "body": Inertia(inertia=0.02),
        "friction": LoadDependentFriction(**given),
    }


@pytest.mark.parametrize("speed", [3.0, -3.0])
@pytest.mark.parametrize(("torque", "square"), [(0.4, 0.0), (-0.4, 0.0), (0.4, 0.6), (-0.4, 0.6)])
def test_the_share_depends_on_who_drives(speed: float, torque: float, square: float) -> None:
    """J v' = T - sign(v) (mu |T| + q T^2), with the mu of its direction, until the body stops."""
    parts = loaded(torque, coefficient=0.2, opposing_coefficient=0.5, quadratic_coefficient=square)
    result = run(parts, *LOADED, stop=0.08, initial={"body.shaft.speed": speed})
    mu = (0.2 if speed * torque > 0 else 0.5) + square * abs(torque)
    rate = (torque - np.sign(speed) * mu * abs(torque)) / 0.02
    np.testing.assert_allclose(result["body.shaft.speed"], speed + rate * result.time, rtol=1e-10)
    lost = mu * abs(torque) * abs(result["body.shaft.angle"][-1])
    assert result["energy.dissipated"][-1] == pytest.approx(lost, rel=1e-9)
    assert balance(result) < 1e-9


def test_slow_sliding_takes_the_static_share_and_rest_holds_it() -> None:
    """Against a spring of torque the shaft stays at rest below r mu |T| and has the Stribeck curve above."""
    given = {"coefficient": 0.6, "static_ratio": 2.0, "stribeck_velocity": 2.0}
    still = run(loaded(0.4, **given), *LOADED, stop=0.3)
    assert np.all(still["body.shaft.angle"] == 0.0)  # 1.2 of the load holds the load

    def slope(t: float, v: np.ndarray) -> np.ndarray:
        return (0.4 - 0.4 * 0.6 * (1 + np.exp(-((v / 2.0) ** 2)))) / 0.02

    moving = run(loaded(0.4, **given), *LOADED, stop=0.3, initial={"body.shaft.speed": 3.0})
    exact = solve_ivp(slope, (0, 0.3), [3.0], t_eval=moving.time, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(moving["body.shaft.speed"], exact.y[0], rtol=1e-8)


def test_no_share_is_no_friction() -> None:
    made = run(loaded(Sine(amplitude=0.4, frequency=2), coefficient=0), *LOADED, stop=0.7)
    bare = run({k: v for k, v in loaded(Sine(amplitude=0.4, frequency=2)).items() if k != "friction"},
               "push.out drive.torque", "drive.shaft body.shaft", stop=0.7)  # fmt: skip
    np.testing.assert_allclose(made["body.shaft.angle"], bare["body.shaft.angle"], rtol=0, atol=1e-12)


def test_a_load_of_the_own_acceleration_is_refused() -> None:
    parts = loaded(0.1, coefficient=0.2)
    parts["inertial"] = Gain(gain="0.01 N.m.s2/rad", unit="N.m")
    wires = ("push.out drive.torque", LOADED[1], "body.shaft.acceleration inertial.in", "inertial.out friction.load")
    with pytest.raises(FlexarmError, match=r"algebraic loop: the accelerations of the mechanism <- friction\.load"):
        model(parts, *wires)
