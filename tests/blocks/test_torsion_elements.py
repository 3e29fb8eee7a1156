"""Springs with hysteresis, hardening and structural damping, and a spring to the ground: closed forms and energy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special

from blocks.actuators.bouc_wen import BoucWenSpring
from blocks.actuators.effort import Torque
from blocks.actuators.ground_spring import GroundSpring
from blocks.actuators.hardening_spring import HardeningSpring
from blocks.actuators.prescribed_motion import PrescribedMotion
from blocks.actuators.spring_damper import SpringDamper
from blocks.actuators.structural_spring import StructuralSpring
from blocks.links.fixed import Fixed
from blocks.links.inertia import Inertia
from blocks.sources.sine import Sine
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Result
from tests.blocks.assembly import linear, run
from tests.blocks.test_drive_train import balance


def twisted(spring: Block, amplitude: float, frequency: float, cycles: float = 1.0) -> Result:
    """A spring against a wall, its other end moved to and fro."""
    parts: dict[str, Block] = {
        "course": Sine(amplitude=f"{amplitude} rad", frequency=frequency),
        "motion": PrescribedMotion(),
        "shaft": Inertia(inertia=1e-6),
        "spring": spring,
        "wall": Fixed(),
    }
    wires = ["course.out motion.angle", "motion.shaft shaft.shaft spring.a", "spring.b wall.shaft"]
    step = 1e-3 / frequency
    return run(parts, *wires, stop=cycles / frequency, step=step, internal_step=step / 4)


K, ZY, RESIDUAL = 40.0, 0.02, 0.1


def expected_torque(e: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    return RESIDUAL * K * e + (1 - RESIDUAL) * K * z


def bouc_wen(**rest: float) -> BoucWenSpring:
    return BoucWenSpring(stiffness=K, residual_share=RESIDUAL, yield_twist=ZY, **rest)


@pytest.mark.parametrize(("sharpness", "curve"), [(1.0, lambda x: 1 - np.exp(-x)), (2.0, np.tanh)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_bouc_wen_loads_along_its_closed_form(sharpness: float, curve: object, sign: float) -> None:
    """From rest dz/de = 1 - (z / zy)^p: an exponential for p = 1, a hyperbolic tangent for p = 2."""
    result = twisted(bouc_wen(sharpness=sharpness), sign * 0.06, 0.5)
    first = result.time <= 0.5
    e = result["spring.twist"][first]
    z = sign * ZY * curve(np.abs(e) / ZY)  # type: ignore[operator]
    np.testing.assert_allclose(result["spring.torque"][first], expected_torque(e, z), rtol=0, atol=1e-9)
    assert balance(result) < 1e-7


@pytest.mark.parametrize(("share", "slope"), [(0.5, 0.0), (0.8, 0.6)])
def test_bouc_wen_unloads(share: float, slope: float) -> None:
    """Going back, with p = 1: dz/de = 1 + (2 b - 1) z / zy until z = 0; the full stiffness for b = 1/2."""
    result = twisted(bouc_wen(unloading_share=share), 0.06, 0.5)
    e, torque = result["spring.twist"], result["spring.torque"]
    z = (torque - RESIDUAL * K * e) / ((1 - RESIDUAL) * K)
    back = (result.time > 0.5) & (z > 0) & (result.time < 1.0)
    top = ZY * (1 - np.exp(-3.0))
    turned = e[back] - 0.06
    exact = top + turned if slope == 0 else (top + ZY / slope) * np.exp(slope * turned / ZY) - ZY / slope
    np.testing.assert_allclose(z[back], exact, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("load", "share"), [(-0.4, 1.0), (0.5, 0.7)])
def test_bouc_wen_that_yields_less_or_stiffens(load: float, share: float) -> None:
    """With p = 1: loading dz/de = 1 - c z / zy, and going back dz/de = 1 + (2 b - c) z / zy until z = 0."""
    result = twisted(bouc_wen(unloading_share=share, loading_share=load), 0.06, 0.5)
    e, torque = result["spring.twist"], result["spring.torque"]
    z = (torque - RESIDUAL * K * e) / ((1 - RESIDUAL) * K)
    first = result.time <= 0.5
    np.testing.assert_allclose(z[first], ZY / load * (1 - np.exp(-load * e[first] / ZY)), rtol=0, atol=1e-9)
    back = (result.time > 0.5) & (z > 0) & (result.time < 1.0)
    top, slope = ZY / load * (1 - np.exp(-load * 0.06 / ZY)), 2 * share - load
    exact = (top + ZY / slope) * np.exp(slope * (e[back] - 0.06) / ZY) - ZY / slope
    np.testing.assert_allclose(z[back], exact, rtol=0, atol=1e-9)
    assert balance(result) < 1e-7


def test_bouc_wen_that_stiffens_takes_energy_over_a_cycle() -> None:
    """Its loop is still a little larger in the third cycle than in the second, so that some of it is stored."""
    result = twisted(bouc_wen(unloading_share=1.0, loading_share=-0.4), 0.05, 1.0, 3)
    cycle = slice(1000, 3001)
    loop = np.trapezoid(result["spring.torque"][cycle], result["spring.twist"][cycle])
    lost, stored = (float(np.ptp(result[f"energy.{name}"][[1000, 3000]])) for name in ("dissipated", "stored"))
    assert lost > 0.9 * loop > 0
    assert abs(loop - lost) == pytest.approx(stored, rel=1e-2)


def test_bouc_wen_does_not_depend_on_the_rate_and_loses_its_loop() -> None:
    slow, fast = (twisted(bouc_wen(sharpness=1.5, unloading_share=0.7), 0.05, f, 3) for f in (0.1, 30.0))
    np.testing.assert_allclose(slow["spring.torque"], fast["spring.torque"], rtol=0, atol=1e-7)
    cycle = slice(1000, 3001)
    loop = np.trapezoid(slow["spring.torque"][cycle], slow["spring.twist"][cycle])
    lost = slow["energy.dissipated"][cycle]
    assert lost[-1] - lost[0] == pytest.approx(loop, rel=1e-5)
    assert (np.diff(slow["energy.dissipated"]) >= -1e-15).all()


def test_bouc_wen_is_smooth_at_rest_for_any_knee() -> None:
    """Its linear model at rest is the spring k, also for the knee p = 1, whose power has no slope at zero."""
    parts: dict[str, Block] = {"body": Inertia(inertia=0.1), "spring": bouc_wen(sharpness=1.0), "wall": Fixed()}
    found = linear(parts, "body.shaft spring.a", "spring.b wall.shaft")
    assert np.abs(found.poles()).max() == pytest.approx(np.sqrt(K / 0.1), rel=1e-9)


def test_hardening_spring_swings_as_an_elliptic_cosine() -> None:
    """J x'' + k x + k3 x^3 = 0 from rest at A: x = A cn(W t | m), W^2 = (k + k3 A^2) / J, m = k3 A^2 / (2 J W^2)."""
    inertia, k, k3, start = 0.02, 3.0, 80.0, 0.4
    parts: dict[str, Block] = {
        "wall": Fixed(),
        "spring": HardeningSpring(stiffness=k, cubic_stiffness=k3, rest_angle=0.1),
        "body": Inertia(inertia=inertia),
    }
    wires = ["wall.shaft spring.a", "spring.b body.shaft"]
    result = run(parts, *wires, stop=2.0, internal_step=2e-4, initial={"body.shaft.angle": start - 0.1})
    rate = np.sqrt((k + k3 * start**2) / inertia)
    cn = special.ellipj(rate * result.time, k3 * start**2 / (2 * inertia * rate**2))[1]
    np.testing.assert_allclose(result["body.shaft.angle"], -0.1 + start * cn, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result["spring.twist"], -start * cn, rtol=0, atol=1e-6)
    assert result["energy.stored"][0] == pytest.approx(k * start**2 / 2 + k3 * start**4 / 4, rel=1e-14)
    assert balance(result) < 1e-8


def test_hardening_spring_without_hardening_is_the_spring() -> None:
    curves = []
    for spring in (
        HardeningSpring(stiffness=3.0, cubic_stiffness=0.0, damping=0.01),
        SpringDamper(stiffness=3.0, damping=0.01),
    ):
        parts: dict[str, Block] = {"wall": Fixed(), "spring": spring, "body": Inertia(inertia=0.02)}
        wires = ["wall.shaft spring.a", "spring.b body.shaft"]
        curves.append(run(parts, *wires, stop=1.0, initial={"body.shaft.angle": 0.3})["body.shaft.angle"])
    np.testing.assert_allclose(curves[0], curves[1], rtol=0, atol=1e-14)


BAND = {"lowest_frequency": 1.0, "highest_frequency": 1e4}


def dynamic_stiffness(spring: StructuralSpring, frequencies: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Torque over twist, from the response of a body on the spring."""
    parts: dict[str, Block] = {"torque": Torque(), "body": Inertia(inertia=0.01), "spring": spring, "wall": Fixed()}
    found = linear(
        parts,
        "torque.shaft body.shaft spring.a",
        "spring.b wall.shaft",
        inputs=["torque.torque"],
        outputs=["body.shaft.angle"],
    )
    return np.array([1 / found.gain(w)[0, 0] + 0.01 * w**2 for w in frequencies])


@pytest.mark.parametrize("loss", [0.02, 0.1])
def test_structural_spring_has_the_same_loss_at_all_frequencies(loss: float) -> None:
    """Within the inner half of the band; rising stiffness is that of Kramers and Kronig, 2 eta / pi per ln w."""
    spring = StructuralSpring(stiffness=50.0, loss_factor=loss, elements=9, **BAND)
    w = np.geomspace(10.0, 1e3, 41)
    found = dynamic_stiffness(spring, w)
    rates = np.geomspace(1.0, 1e4, 9)
    part = 2 * loss * 50.0 * np.log(1e4) / 8 / np.pi
    exact = 50.0 - 4.5 * part + part * np.sum(1j * w[:, None] / (rates + 1j * w[:, None]), axis=1)
    np.testing.assert_allclose(found, exact, rtol=1e-6)
    np.testing.assert_allclose(found.imag / 50.0, loss, rtol=0.04)
    ends = dynamic_stiffness(spring, np.array([1.0, 1e4]))
    np.testing.assert_allclose(ends.imag / 50.0, loss * 2 / 3, rtol=0.05)
    np.testing.assert_allclose(found.real, 50.0 * (1 + 2 * loss / np.pi * np.log(w / 100.0)), rtol=0.02 * loss)
    assert dynamic_stiffness(spring, np.array([100.0]))[0].real == pytest.approx(50.0, rel=1e-9)


def test_structural_spring_damps_slow_and_fast_swings_alike() -> None:
    """A body rings down with the damping ratio eta / 2 whether it swings at 16 or at 316 rad/s."""
    ratios = []
    for inertia in (0.2, 0.005, 0.0005):
        spring = StructuralSpring(stiffness=50.0, loss_factor=0.04, elements=9, **BAND)
        parts: dict[str, Block] = {"body": Inertia(inertia=inertia), "spring": spring, "wall": Fixed()}
        poles = linear(parts, "body.shaft spring.a", "spring.b wall.shaft").poles()
        pole = poles[np.argmax(poles.imag)]
        ratios.append(-pole.real / abs(pole))
    np.testing.assert_allclose(ratios, 0.02, rtol=0.04)


def test_structural_spring_balances_and_never_gains() -> None:
    spring = StructuralSpring(stiffness=50.0, loss_factor=0.2, elements=6, **BAND)
    parts: dict[str, Block] = {"body": Inertia(inertia=0.02), "spring": spring, "wall": Fixed()}
    wires = ["body.shaft spring.a", "spring.b wall.shaft"]
    result = run(parts, *wires, stop=1.0, internal_step=2e-5, initial={"body.shaft.speed": 3.0})
    assert balance(result) < 1e-8
    assert (np.diff(result["energy.dissipated"]) >= 0).all()


def test_structural_spring_refuses_what_leaves_no_stiffness() -> None:
    with pytest.raises(ParameterError, match=r"leaves no stiffness at rest\n  give a loss factor below 0\.2"):
        StructuralSpring(stiffness=1, loss_factor=0.5, elements=8, **BAND)
    with pytest.raises(ParameterError, match=r"highest_frequency = 1 rad/s is not above lowest_frequency = 2 rad/s"):
        StructuralSpring(stiffness=1, loss_factor=0.1, lowest_frequency=2, highest_frequency=1)


def test_ground_spring_lifts_the_pole_at_zero() -> None:
    inertia, k, d, rest = 0.05, 0.8, 0.004, 0.2
    parts: dict[str, Block] = {
        "body": Inertia(inertia=inertia),
        "cable": GroundSpring(stiffness=k, damping=d, rest_angle=rest),
    }
    result = run(parts, "body.shaft cable.shaft", stop=3.0)
    decay = d / (2 * inertia)
    wd, t = np.sqrt(k / inertia - decay**2), result.time
    angle = rest * (1 - np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t)))
    np.testing.assert_allclose(result["body.shaft.angle"], angle, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["cable.torque"], inertia * result["body.shaft.acceleration"], rtol=0, atol=1e-14)
    assert balance(result) < 1e-8
