"""The brake against the run-down of a flywheel, which has a closed form, and against its own limits."""

from pathlib import Path

import numpy as np
import pytest

import flexarm

TORQUE, CRITICAL, INERTIA, START = 0.5, 50.0, 0.01, 200.0


@pytest.fixture(scope="module")
def run():
    """The flywheel's run-down."""
    return flexarm.simulate(flexarm.load(Path(__file__).parent.parent / "run-down.yaml"))


def test_the_run_down_follows_its_closed_form(run):
    """J w' = -2 Tm u / (1 + u^2) integrates to ln(u / u0) + (u^2 - u0^2) / 2 = -2 Tm t / (J wc)."""
    u, start = run["wheel.shaft.speed"] / CRITICAL, START / CRITICAL
    passed = np.log(u / start) + (u**2 - start**2) / 2
    np.testing.assert_allclose(passed, -2 * TORQUE * run.time / (INERTIA * CRITICAL), atol=1e-8)


def test_the_torque_is_greatest_at_the_critical_speed(run):
    """-2 Tm u / (1 + u^2) has its extreme, -Tm, at u = 1."""
    slowest = np.argmin(run["brake.torque"])
    assert run["brake.torque"][slowest] == pytest.approx(-TORQUE, rel=1e-6)
    assert run["wheel.shaft.speed"][slowest] == pytest.approx(CRITICAL, rel=5e-3)


def test_the_energy_of_the_wheel_goes_into_the_brake():
    """J (w0^2 - w1^2) / 2, and nothing is left over in the balance."""
    scenario = flexarm.load(Path(__file__).parent.parent / "run-down.yaml")
    books = flexarm.simulate(scenario.build(energy=True), 8.0, 1e-3)
    end = books["wheel.shaft.speed"][-1]
    assert books["energy.dissipated"][-1] == pytest.approx(INERTIA * (START**2 - end**2) / 2, rel=1e-7)
    assert np.ptp(books["energy.residual"]) < 1e-7


def test_slow_it_is_a_viscous_damper():
    """Near rest the torque is -2 Tm w / wc, so that the wheel's pole is -2 Tm / (wc J)."""
    linear = flexarm.linearise(
        flexarm.load(Path(__file__).parent / "slow.yaml"), inputs=["drive.torque"], outputs=["wheel.shaft.speed"]
    )
    (pole,) = [pole for pole in linear.poles() if abs(pole) > 1e-9]
    assert pole.real == pytest.approx(-2 * TORQUE / (CRITICAL * INERTIA), rel=1e-9)
