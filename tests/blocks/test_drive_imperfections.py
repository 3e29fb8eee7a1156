"""Transmission error, cogging, slack belts, jitter: closed forms, own solvers, and the energy balance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from blocks.actuators.belt import Belt
from blocks.actuators.cogging import Cogging
from blocks.actuators.effort import Force, Torque
from blocks.actuators.gear import Gear
from blocks.actuators.harmonic_drive import HarmonicDrive
from blocks.controllers.jittered_sample import JitteredSample
from blocks.controllers.sample_hold import SampleHold
from blocks.links.fixed import TranslationalFixed
from blocks.links.inertia import Inertia, Mass
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from engine.block import Block
from engine.discretise import discretise
from engine.errors import ParameterError
from tests.blocks.assembly import instants, linear, model, run, switches
from tests.blocks.test_drive_train import balance

Array = NDArray[np.float64]

# -- transmission error -----------------------------------------------------------------------------------------------

WAVES = {"error_waves": 2, "error_amplitude": [4e-4, 1.5e-4], "error_order": [2, 4], "error_phase": [0.3, -1.0]}
KINDS: list[type[Block]] = [HarmonicDrive, Gear]


def error(theta: float) -> float:
    """Counted from where the gear is without twist."""
    return 4e-4 * (math.sin(2 * theta + 0.3) - math.sin(0.3)) + 1.5e-4 * (math.sin(4 * theta - 1.0) + math.sin(1.0))


def slope_of_error(theta: float) -> float:
    return 8e-4 * math.cos(2 * theta + 0.3) + 6e-4 * math.cos(4 * theta - 1.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [50.0, -50.0])
def test_a_shaken_load_follows_an_independent_solution(kind: type[Block], n: float) -> None:
    jm, jl, k, d, push = 3e-5, 0.08, 6e3, 4.0, 0.02

    def slope(t: float, x: Array) -> list[float]:
        share = 1 / n + slope_of_error(x[0])
        tau = k * (x[0] / n + error(x[0]) - x[1]) + d * (share * x[2] - x[3])
        return [x[2], x[3], (push - share * tau) / jm, tau / jl]

    parts: dict[str, Block] = {
        "push": Constant(value=push),
        "drive": Torque(),
        "rotor": Inertia(inertia=jm),
        "gear": kind(ratio=n, stiffness=k, damping=d, **WAVES),
        "load": Inertia(inertia=jl),
    }
    wires = ("push.out drive.torque", "drive.shaft rotor.shaft gear.input", "gear.output load.shaft")
    result = run(parts, *wires, stop=0.5, internal_step=5e-5)
    exact = solve_ivp(slope, (0, 0.5), np.zeros(4), t_eval=result.time, rtol=1e-10, atol=1e-13).y
    assert exact[0, -1] > 5 * 2 * math.pi
    np.testing.assert_allclose(result["rotor.shaft.angle"], exact[0], atol=1e-6)
    np.testing.assert_allclose(result["load.shaft.speed"], exact[3], atol=1e-6)
    assert balance(result) < 1e-7


@pytest.mark.parametrize("kind", KINDS)
def test_turned_slowly_the_output_errs_by_its_waves(kind: type[Block]) -> None:
    """With a heavy rotor of constant speed and a light damped load, angle out = angle in / n + the waves."""
    parts: dict[str, Block] = {
        "rotor": Inertia(inertia=1e6),
        "gear": kind(ratio=50, stiffness=1e4, damping=10, **WAVES),
        "load": Inertia(inertia=1e-3),
    }
    wires = ("rotor.shaft gear.input", "gear.output load.shaft")
    result = run(parts, *wires, stop=4.0, step=1e-2, initial={"rotor.shaft.speed": 2.0}, internal_step=5e-5)
    theta = result["rotor.shaft.angle"]
    expected = theta / 50 + [error(x) for x in theta]
    np.testing.assert_allclose(result["load.shaft.angle"][50:], expected[50:], atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_a_gear_at_rest_stays_where_it_is(kind: type[Block]) -> None:
    """Nothing drives: a wave of whatever phase must not twist the gear where it begins."""
    parts: dict[str, Block] = {
        "rotor": Inertia(inertia=3e-5),
        "gear": kind(ratio=50, stiffness=6e3, damping=4.0, **WAVES),
        "load": Inertia(inertia=0.08),
    }
    result = run(parts, "rotor.shaft gear.input", "gear.output load.shaft", stop=0.2)
    assert np.abs(result["gear.torque"]).max() < 1e-12
    assert np.abs(result["rotor.shaft.angle"]).max() < 1e-12


@pytest.mark.parametrize("loss", ["constant", "directed"])
def test_with_losses_the_books_still_close(loss: str) -> None:
    parts: dict[str, Block] = {
        "push": Sine(amplitude=0.1, frequency=3),
        "drive": Torque(),
        "rotor": Inertia(inertia=3e-5),
        "gear": HarmonicDrive(ratio=50, stiffness=6e3, damping=4.0, efficiency=0.8, loss=loss, **WAVES),
        "load": Inertia(inertia=0.08),
    }
    wires = ("push.out drive.torque", "drive.shaft rotor.shaft gear.input", "gear.output load.shaft")
    result = run(parts, *wires, stop=0.5, internal_step=2e-5)
    assert np.ptp(result["rotor.shaft.angle"]) > 2 * math.pi
    assert balance(result) < 1e-5


def test_a_rigid_gear_has_no_transmission_error() -> None:
    with pytest.raises(ParameterError, match="error_waves is for an elastic Gear"):
        Gear(ratio=50, **WAVES)


# -- cogging ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pole_pairs", "slots", "order"), [(2, 6, 12), (7, 12, 84), (4, 9, 72)])
def test_a_rotor_rests_in_the_notches_of_its_order(pole_pairs: int, slots: int, order: int) -> None:
    """Near a notch the torque is a spring of A N, and the rotor swings at sqrt(A N / J)."""
    parts: dict[str, Block] = {
        "cogging": Cogging(pole_pairs=pole_pairs, slots=slots, amplitude=0.02, phase=math.pi),
        "rotor": Inertia(inertia=1e-5),
    }
    poles = linear(parts, "cogging.shaft rotor.shaft").poles()
    assert max(poles.imag) == pytest.approx(math.sqrt(0.02 * order / 1e-5), rel=1e-9)


def test_a_fast_rotor_keeps_its_energy_over_the_notches() -> None:
    """J w^2 / 2 + potential is constant, harmonic by harmonic, at 1000 rad/s over 84 notches in a revolution."""
    j, a, phi = 2e-5, (0.3, 0.1), (0.4, 1.1)
    parts: dict[str, Block] = {
        "cogging": Cogging(pole_pairs=7, slots=12, harmonics=2, amplitude=list(a), phase=list(phi)),
        "rotor": Inertia(inertia=j),
    }
    result = run(
        parts, "cogging.shaft rotor.shaft", stop=0.05, initial={"rotor.shaft.speed": 1000.0}, internal_step=5e-7
    )
    q, w = result["rotor.shaft.angle"], result["rotor.shaft.speed"]
    work = sum(
        -x / (84 * k) * (np.cos(84 * k * q + p) - math.cos(p)) for k, (x, p) in enumerate(zip(a, phi, strict=True), 1)
    )
    np.testing.assert_allclose(j * (w**2 - 1000.0**2) / 2, work, atol=1e-7)
    assert np.ptp(work) > 5e-3
    assert balance(result) < 1e-6
    torque = sum(x * np.sin(84 * k * q + p) for k, (x, p) in enumerate(zip(a, phi, strict=True), 1))
    np.testing.assert_allclose(result["cogging.torque"], torque, atol=1e-12)


# -- belt -------------------------------------------------------------------------------------------------------------

K, D, PRE, M = 2e4, 8.0, 30.0, 1.5
BELTED = ("push.out force.force", "force.flange rim.flange belt.a", "belt.b carriage.flange")


def belted(push: float | Block, **given: float) -> dict[str, Block]:
    return {
        "push": push if isinstance(push, Block) else Constant(value=push),
        "force": Force(),
        "rim": Mass(mass=0.8),
        "belt": Belt(**({"stiffness": K, "damping": D} | given)),
        "carriage": Mass(mass=M),
    }


@pytest.mark.parametrize("pretension", [PRE, 0.0])
def test_a_belt_that_goes_slack_follows_an_independent_solution(pretension: float) -> None:
    """Each strand by itself: F0 +- (k e + d e') / 2 while it is stretched, else nothing."""

    def slope(t: float, x: Array) -> list[float]:
        e, rate = x[0] - x[1], x[2] - x[3]
        front = pretension + (K * e + D * rate) / 2 if pretension + K * e / 2 > 0 else 0.0
        rear = pretension - (K * e + D * rate) / 2 if pretension - K * e / 2 > 0 else 0.0
        push = 200 * math.sin(2 * math.pi * 5 * t)
        return [x[2], x[3], (push - front + rear) / 0.8, (front - rear) / M]

    result = run(belted(Sine(amplitude=200, frequency=5), pretension=pretension), *BELTED, stop=0.6, internal_step=2e-5)
    exact = solve_ivp(slope, (0, 0.6), np.zeros(4), t_eval=result.time, rtol=1e-9, atol=1e-11, max_step=1e-4).y
    np.testing.assert_allclose(result["carriage.flange.position"], exact[1], atol=2e-6)
    assert {-1.0, 1.0} <= set(switches(result, "belt.slack"))
    assert balance(result) < 1e-6


def test_statics_of_a_slack_belt() -> None:
    """Held, F = k e up to 2 F0 and F0 + k e / 2 beyond; the strand lets go where k e = 2 F0."""
    parts = belted(100.0, pretension=PRE, damping=300.0) | {"carriage": TranslationalFixed()}
    result = run(parts, *BELTED, stop=1.0, internal_step=5e-5)
    assert result["belt.force"][-1] == pytest.approx(100.0, rel=1e-6)
    assert result["belt.stretch"][-1] == pytest.approx((100.0 - PRE) * 2 / K, rel=1e-6)
    first = instants(result, "belt.slack")[0]
    at = float(np.interp(first, result.time, result["belt.stretch"]))
    assert at == pytest.approx(2 * PRE / K, rel=1e-3)


def test_a_belt_without_a_pretension_given_is_a_spring() -> None:
    poles = linear(belted(0.0), *BELTED).poles()
    inverse = 1 / 0.8 + 1 / M
    swing = math.sqrt(K * inverse - (D * inverse / 2) ** 2)
    assert max(poles.imag) == pytest.approx(swing, rel=1e-9)
    result = run(belted(500.0), *BELTED, stop=0.3, internal_step=5e-5)
    assert len(result.events) == 0
    assert balance(result) < 1e-8


# -- jitter -----------------------------------------------------------------------------------------------------------


def sampled(block: Block) -> tuple[Array, Array]:
    """Instants at which the output changes, and what it changes to, for a ramp of 1 per second."""
    parts: dict[str, Block] = {"rotor": Inertia(inertia=1.0), "sample": block}
    wires = ("rotor.shaft.angle sample.in",)
    result = run(parts, *wires, stop=8.0, step=5e-4, initial={"rotor.shaft.speed": 1.0})
    out = result["sample.out"]
    changes = np.flatnonzero(np.diff(out) != 0) + 1
    return result.time[changes], out[changes]


def test_samples_come_late_evenly_and_independently() -> None:
    period, jitter, slots = 0.01, 0.006, 20
    when, read = sampled(JitteredSample(period=period, jitter=jitter, slots=slots, seed=5))
    np.testing.assert_allclose(read, when, atol=1e-9)  # what is read is the ramp at that instant
    late = read - period * np.floor(read / period + 1e-9)
    count = round(jitter / period * slots) + 1
    assert late.max() == pytest.approx(jitter, abs=1e-9)
    places = np.round(late / (period / slots)).astype(int)
    np.testing.assert_allclose(late, places * period / slots, atol=1e-9)
    seen = np.bincount(places, minlength=count)
    assert len(seen) == count
    expected = len(places) / count
    assert ((seen - expected) ** 2 / expected).sum() < 29.6  # chi squared of 12, 0.3 %
    centred = late - late.mean()
    assert abs((centred[1:] * centred[:-1]).mean() / centred.var()) < 3.5 / math.sqrt(len(late))
    again = sampled(JitteredSample(period=period, jitter=jitter, slots=slots, seed=5))[1]
    other = sampled(JitteredSample(period=period, jitter=jitter, slots=slots, seed=6))[1]
    np.testing.assert_array_equal(read, again)
    assert not np.array_equal(read[: len(other)], other[: len(read)])


def test_no_jitter_is_a_sample_and_hold() -> None:
    np.testing.assert_array_equal(sampled(JitteredSample(period=0.01))[1], sampled(SampleHold(period=0.01))[1])


def test_both_runtimes_draw_the_same_delays() -> None:
    parts: dict[str, Block] = {
        "wave": Sine(amplitude=1, frequency=2),
        "sample": JitteredSample(period=0.01, jitter=0.005),
    }
    made = run(parts, "wave.out sample.in", stop=0.5)
    other = run(parts, "wave.out sample.in", stop=0.5, backend="interpreter")
    np.testing.assert_array_equal(made["sample.out"], other["sample.out"])


def test_in_linear_models_every_slot_samples() -> None:
    """Its counters are no poles: what is left is a sample and hold of a slot's length."""
    found = []
    for sample in (JitteredSample(period=0.01, jitter=0.005, slots=10), SampleHold(period=0.001)):
        parts: dict[str, Block] = {"sample": sample, "motor": Torque(), "body": Inertia(inertia=0.1)}
        wires = ("sample.out motor.torque", "motor.shaft body.shaft")
        made = model(parts, *wires, inputs=["sample.in"], outputs=["body.shaft.speed"], energy=False)
        found.append(discretise(made))
    np.testing.assert_allclose(found[0].gain(3.0), found[1].gain(3.0), rtol=1e-12)
    assert sum(np.abs(found[0].poles()) > 1e-9) == 2
