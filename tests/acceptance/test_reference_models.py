"""Reference models A and B: A against an independent integration, B's switching exact and its books closed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate

from engine.simulate import Result, simulate
from scenarios.load import load

BETA = np.array([1.8751040687119611, 4.694091132974174, 7.854757438237613, 10.99554073487547])
LENGTH, MASS, RIGIDITY, HUB, XI = 0.419, 0.065, 0.137422, 3e-4, 0.01
RESISTANCE, KT, ETA, ROTOR, RATIO, GEAR_ETA, GEAR, BEARING = 2.6, 7.68e-3, 0.69, 4.606e-7, 70, 0.9, 4.8754e-5, 0.004


def model_a() -> tuple[np.ndarray, np.ndarray]:
    """Model A from its equations, by DOP853 in pieces between the voltage's jumps; times and states."""
    inertia = GEAR_ETA * RATIO**2 * ROTOR + GEAR + HUB + MASS * LENGTH**2 / 3
    coupling = MASS * LENGTH * 2 / BETA**2
    stiffness = RIGIDITY * BETA**4 / LENGTH**3
    damping = 2 * XI * np.sqrt(stiffness * MASS)
    drive = GEAR_ETA * RATIO * ETA * KT / RESISTANCE

    def voltage(t: float) -> float:
        steps = 2.0 * (0.2 <= t < 1.2) - 1.5 * (1.7 <= t < 2.9) + 0.75 * (3.3 <= t < 3.8)
        x = t - 4.0
        return steps + (np.sin(2 * np.pi * (0.5 * x + 11.5 * x**2 / 12)) if x >= 0 else 0.0)

    def rate(t: float, y: np.ndarray, v: float | None) -> np.ndarray:
        alpha, speed, alphadot = y[1:5], y[5], y[6:]
        torque = drive * ((voltage(t) if v is None else v) - RATIO * KT * speed) - BEARING * speed
        matrix = np.diag(np.full(5, MASS))
        matrix[0, 0] = inertia + MASS * alpha @ alpha
        matrix[0, 1:] = matrix[1:, 0] = coupling
        force = np.empty(5)
        force[0] = torque - 2 * MASS * speed * (alpha @ alphadot)
        force[1:] = MASS * alpha * speed**2 - stiffness * alpha - damping * alphadot
        return np.concatenate([y[5:], np.linalg.solve(matrix, force)])

    times, states, y = [np.array([0.0])], [np.zeros((1, 10))], np.zeros(10)
    for begin, end in pairwise((0, 0.2, 1.2, 1.7, 2.9, 3.3, 3.8, 4.0, 6.0)):
        rows = np.arange(round(begin * 100) + 1, round(end * 100) + 1) / 100
        constant = voltage((begin + end) / 2) if begin < 4 else None
        done = integrate.solve_ivp(
            rate, (begin, end), y, method="DOP853", t_eval=rows, args=(constant,), rtol=1e-10, atol=1e-12
        )
        times.append(rows)
        states.append(done.y.T)
        y = done.y[:, -1]
    return np.concatenate(times), np.vstack(states)


def test_model_a_against_its_equations() -> None:
    time, states = model_a()
    run = simulate(load("reference-a").build(), 6.0, 0.01, internal_step=2.5e-4)
    np.testing.assert_allclose(run.time, time, atol=1e-12)
    tip = states[:, 1:5] @ np.array([2.0, -2.0, 2.0, -2.0])
    np.testing.assert_allclose(run["link.hub.angle"], states[:, 0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(run["link.hub.speed"], states[:, 5], rtol=0, atol=2e-6)
    np.testing.assert_allclose(run["link.tip.deflection"], tip, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run["motor.shaft.speed"], RATIO * run["link.hub.speed"], rtol=1e-12)


def relative_rms(run: Result, fine: Result, name: str) -> float:
    return float(np.sqrt(np.mean((run[name] - fine[name]) ** 2) / np.mean(fine[name] ** 2)))


@pytest.mark.parametrize("name", ["reference-a", "reference-b"])
def test_steps_are_fine_enough(name: str) -> None:
    """Motor speed at internal steps of 1 ms within 2e-4 of steps sixteen times finer, and at 0.25 ms within 1e-5."""
    made = load(name).build()
    fine = simulate(made, 10.0, 1e-3, internal_step=6.25e-5)
    assert relative_rms(simulate(made, 10.0, 1e-3, internal_step=1e-3), fine, "motor.shaft.speed") < 2e-4
    assert relative_rms(simulate(made, 10.0, 1e-3, internal_step=2.5e-4), fine, "motor.shaft.speed") < 1e-5


@pytest.mark.parametrize("name", ["reference-a", "reference-b"])
def test_the_books_close(name: str) -> None:
    run = simulate(load(name).build(energy=True), 10.0, 1e-3, internal_step=2.5e-4)
    assert np.ptp(run["energy.residual"]) < 1e-9 * run["energy.supplied"][-1]


def test_model_b_switches_exactly() -> None:
    """It sticks without creep, dead zone and friction act, backlash is crossed, and the arm goes there and back."""
    outputs = ["pi.out", "motor.voltage", "motor.shaft.angle", "motor.shaft.speed", "contact.contact", "link.hub.angle"]
    run = simulate(load("reference-b").build(outputs=outputs), 10.0, 1e-3)
    u = run["pi.out"]
    zone = np.where(u > 0.18, u - 0.18, np.where(u < -0.09, u + 0.09, 0.0))
    np.testing.assert_allclose(run["motor.voltage"], zone, atol=1e-12)
    rest = (run.time > 3.0) & (run.time < 5.0)
    assert run["motor.shaft.speed"][rest].any() == np.False_
    assert np.ptp(run["motor.shaft.angle"][rest]) == 0.0
    assert set(np.unique(run["contact.contact"])) == {-1.0, 0.0, 1.0}
    assert run["link.hub.angle"].max() == pytest.approx(2.4, abs=0.02)
    assert abs(run["link.hub.angle"][-1]) < 0.02
    names = {name for _, name, _ in run.events}
    assert {"friction", "contact.contact", "zone.zone", "there.phase", "back.phase"} <= names
    assert (np.diff(u) != 0).sum() > 5000
