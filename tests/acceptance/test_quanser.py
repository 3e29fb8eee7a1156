"""[Gao X. n.d., eq. 11]: values computed independently from the corrected equations, and physics the paper implies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import flexarm
from engine.linearise import linearise
from scenarios.load import load

NAME = "quanser-single-link-no-dead-zone"
SETS = {
    "A": (),
    "A, stronger damping": ("bearing.viscous_friction=0.015 N.m.s/rad",),
    "B": ("link.length=0.381 m", "link.flexural_rigidity=0.10332 N.m2"),
}
POLES = {
    "A": [0, -17.489, -7.917 - 24.785j, -7.917 + 24.785j],
    "A, stronger damping": [0, -22.740, -7.802 - 23.200j, -7.802 + 23.200j],
    "B": [0, -20.416, -6.602 - 23.270j, -6.602 + 23.270j],
}
TORQUE_POLES = {
    "A": [0, -0.680, -0.572 - 30.868j, -0.572 + 30.868j],
    "A, stronger damping": [0, -2.579, -2.133 - 30.633j, -2.133 + 30.633j],
    "B": [0, -0.766, -0.538 - 29.216j, -0.538 + 29.216j],
}
# M1, M2, M4, K4 (computed independently; tolerance 1e-4 relative)
MATRICES = {
    "A": (5.8838e-3, 1.54920e-2, 6.5000e-2, 23.0949),
    "A, stronger damping": (5.8838e-3, 1.54920e-2, 6.5000e-2, 23.0949),
    "B": (5.2252e-3, 1.40870e-2, 6.5000e-2, 23.0949),
}


def _plant(which: Any, *more: Any, outputs: Any = ("link.hub.angle",)) -> Any:
    return load(NAME, [*SETS[which], *more]).build(["motor.voltage"], outputs)


def _sorted(values: Any) -> list[Any]:
    return sorted(np.asarray(values, dtype=complex), key=lambda z: (round(abs(z), 3), z.imag))


@pytest.mark.parametrize("which", SETS)
def test_poles_of_angle_over_voltage(which: Any) -> None:
    found = _sorted(linearise(_plant(which)).poles())
    for pole, expected in zip(found, POLES[which], strict=True):
        assert abs(pole - expected) < 1e-3 * max(abs(expected), 1.0)


@pytest.mark.parametrize("which", SETS)
def test_zeros_are_the_clamped_mode(which: Any) -> None:
    zeros = linearise(_plant(which)).zeros()
    assert len(zeros) == 2
    rigidity = 0.10332 if which == "B" else 0.137422
    length = 0.381 if which == "B" else 0.419
    clamped = 1.8751040687119611**2 * np.sqrt(rigidity / (0.065 * length**3))
    assert clamped == pytest.approx(2 * np.pi * 3.0, rel=2e-5)
    for zero in zeros:
        assert zero.real == pytest.approx(0.0, abs=1e-9)
        assert abs(zero.imag) == pytest.approx(clamped, rel=1e-6)


@pytest.mark.parametrize("which", SETS)
def test_mass_and_stiffness_read_off_the_linear_model(which: Any) -> None:
    """A of the undamped, currentless plant holds -M^-1 K; its response to a torque holds M^-1."""
    model = load(NAME, [*SETS[which], "bearing.viscous_friction=0", "motor.resistance=1e9 ohm"]).build(
        ["motor.voltage"], ["link.hub.acceleration", "link.mode1.amplitude"]
    )
    linear = linearise(model)
    n = len(linear.A) // 2
    unit_torque = 0.9 * 70 * 0.69 * 7.68e-3 / 1e9
    inverse = linear.B[n:, 0] / unit_torque
    M1, M2, M4, K4 = MATRICES[which]
    determinant = M1 * M4 - M2**2
    assert inverse == pytest.approx([M4 / determinant, -M2 / determinant], rel=3e-4)
    assert linear.A[n:, 1] == pytest.approx([M2 * K4 / determinant, -M1 * K4 / determinant], rel=3e-4)


@pytest.mark.parametrize("which", SETS)
def test_poles_without_back_emf(which: Any) -> None:
    """With a huge resistance the motor is a torque source: poles of theta/tau, computed independently."""
    linear = linearise(_plant(which, "motor.resistance=1e9 ohm"))
    for pole, expected in zip(_sorted(linear.poles()), TORQUE_POLES[which], strict=True):
        assert abs(pole - expected) < 1e-3 * max(abs(expected), 1.0)


@pytest.mark.parametrize(("which", "hertz"), [("A", 4.9156), ("B", 4.6529)])
def test_undamped_hinged_frequency(which: str, hertz: float) -> None:
    linear = linearise(_plant(which, "motor.resistance=1e9 ohm", "bearing.viscous_friction=0"))
    assert np.abs(linear.poles()).max() / (2 * np.pi) == pytest.approx(hertz, rel=1e-4)


def test_motor_constant_and_back_emf_damping() -> None:
    """On the hub's acceleration with the arm's mass as in the scenario: forces per volt and per speed, by the gears."""
    linear = linearise(_plant("A", "bearing.viscous_friction=0"))
    n = len(linear.A) // 2
    M1, M2, M4, _ = MATRICES["A"]
    gain = M4 / (M1 * M4 - M2**2)
    constant, damping = 0.9 * 70 * 0.69 * 7.68e-3 / 2.6, 0.9 * 70**2 * 0.69 * 7.68e-3**2 / 2.6
    assert constant == pytest.approx(0.1284037, rel=1e-6)
    assert damping == pytest.approx(0.0690298, rel=1e-6)
    assert linear.B[n, 0] == pytest.approx(gain * constant, rel=3e-4)
    assert linear.A[n, n] == pytest.approx(-gain * damping, rel=3e-4)
    assert linear.A[n, n] / linear.B[n, 0] == pytest.approx(-damping / constant, rel=1e-12)


def _step(name: Any, *overrides: Any, voltage: float = 1.0) -> tuple[Any, Any]:
    run = flexarm.simulate(load(name, [f"source.height={voltage} V", "simulate.stop=2 s", *overrides]))
    return np.degrees(run["link.hub.angle"]), run["link.tip.deflection"]


@pytest.mark.parametrize(
    ("damping", "free", "dead", "difference"), [(0.004, 100.741, 82.607, 18.133), (0.015, 87.553, 71.794, 15.760)]
)
def test_step_with_and_without_dead_zone(damping: float, free: float, dead: float, difference: float) -> None:
    setting = f"bearing.viscous_friction={damping}"
    without, _ = _step(NAME, setting)
    within, _ = _step("quanser-single-link", setting)
    assert without[-1] == pytest.approx(free, abs=0.05)
    assert within[-1] == pytest.approx(dead, abs=0.05)
    assert without[-1] - within[-1] == pytest.approx(difference, abs=0.05)


def test_the_dead_zone_takes_the_same_angle_at_any_voltage_and_the_ratio_of_the_thresholds() -> None:
    for voltage, threshold in ((1.0, 0.18), (2.0, 0.18), (-1.0, 0.09)):
        linear = ("link.nonlinear=false",)
        without, _ = _step(NAME, *linear, voltage=voltage)
        within, _ = _step("quanser-single-link", *linear, voltage=voltage)
        assert within[-1] / without[-1] == pytest.approx(1 - threshold / abs(voltage), abs=1e-4)
    assert np.degrees(1.75824 * 0.18) == pytest.approx(18.133, abs=0.002)


def test_peak_tip_deflection() -> None:
    _, without = _step(NAME)
    _, within = _step("quanser-single-link")
    assert np.abs(without).max() == pytest.approx(26.1e-3, abs=0.2e-3)
    assert np.abs(within).max() == pytest.approx(21.4e-3, abs=0.2e-3)


@pytest.mark.parametrize(("voltage", "degrees"), [(2.0, 0.088), (5.0, 1.48)])
def test_nonlinear_minus_linear(voltage: float, degrees: float) -> None:
    full, _ = _step(NAME, voltage=voltage)
    linear, _ = _step(NAME, "link.nonlinear=false", voltage=voltage)
    assert np.abs(full - linear).max() == pytest.approx(degrees, rel=0.1)


def test_linearisation_is_harmless_at_one_volt() -> None:
    full, _ = _step(NAME)
    linear, _ = _step(NAME, "link.nonlinear=false")
    assert np.abs(full - linear).max() < 0.011


def test_energy_closes_on_the_smooth_arm() -> None:
    model = load(NAME).build(energy=True)
    run = flexarm.simulate(model, 4.0, 1e-3)
    books = run["energy.residual"]
    assert np.abs(books - books[0]).max() < 1e-6 * run["energy.supplied"].max()
