"""Errata of [Gao X. n.d.], [One-link n.d.] and [Mohan 2010] (docs/errata.md), by derivations that use no product code.

The files that are read hold the papers' own tables.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from tests.physics.papers import table

BETA = tuple(brentq(lambda b: np.cos(b) * np.cosh(b) + 1, *span) for span in ((1.5, 2.5), (4.0, 5.5), (7.0, 8.5)))


def shape(b: Any, v: Any, x: Any, derivative: int = 0) -> Any:
    """Cosh - cos + v (sinh - sin) of b x, or a derivative by x; x is the share of the length."""
    flip = (-1, 1, 1, -1)[derivative]
    even = (np.cosh, np.sinh)[derivative % 2](b * x) + flip * (np.cos, np.sin)[derivative % 2](b * x)
    flip = (-1, -1, 1, 1)[derivative]
    odd = (np.sinh, np.cosh)[derivative % 2](b * x) + flip * (np.sin, np.cos)[derivative % 2](b * x)
    return b**derivative * (even + v * odd)


def sigma(b: Any) -> Any:
    return (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))


def cantilever(mode: Any, x: Any, derivative: int = 0) -> Any:
    return shape(BETA[mode], -sigma(BETA[mode]), x, derivative)


# -- Gao et al.: single-link arm ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "printed"), [(0, 0.6131), (1, 1.0178)])
def test_000_8_the_mode_shape_has_the_wrong_sign_and_denominator(mode: int, printed: float) -> None:
    b = BETA[mode]
    literal = (np.sinh(b) - np.sin(b)) / (np.cosh(b) - np.cos(b))
    assert literal == pytest.approx(printed, abs=5e-5)
    right = -(np.sinh(b) - np.sin(b)) / (np.cosh(b) + np.cos(b))
    assert right == pytest.approx(-sigma(b), rel=1e-9)
    scale = b**2 * np.cosh(b)
    # No bending moment and no shear force at the free end.
    assert abs(shape(b, right, 1.0, 2)) < 1e-9 * scale
    assert abs(shape(b, right, 1.0, 3)) < 1e-9 * scale * b
    assert shape(b, right, 1.0) == pytest.approx((-1) ** mode * 2)
    for wrong in (literal, -literal, -right):  # as printed; each of the two errors alone
        assert abs(shape(b, wrong, 1.0, 2)) > 4e-4 * scale
        assert abs(shape(b, wrong, 1.0, 3)) > 4e-4 * scale * b
    assert abs(shape(b, literal, 1.0, 2)) > scale


def arm_equations(centrifugal: Any) -> tuple[Any, ...]:
    """Lagrange's equations of two modes from (9), with or without the term (w theta')^2; the integrals by symbols."""
    t = sp.Symbol("t")
    inertia, *integrals = sp.symbols("J0 c1 c2 a1 a2 k1 k2")
    c, a, k = integrals[:2], integrals[2:4], integrals[4:]
    theta, *alpha = (sp.Function(name)(t) for name in ("theta", "alpha1", "alpha2"))
    speed = theta.diff(t)
    energy = inertia * speed**2 / 2
    for i in range(2):
        energy += c[i] * speed * alpha[i].diff(t) + a[i] * alpha[i].diff(t) ** 2 / 2 - k[i] * alpha[i] ** 2 / 2
        energy += centrifugal * a[i] * alpha[i] ** 2 * speed**2 / 2
    rows = [sp.expand(energy.diff(q.diff(t)).diff(t) - energy.diff(q)) for q in (theta, *alpha)]
    return t, (inertia, c, a, k), theta, alpha, rows


def test_000_11_does_not_follow_from_10_but_from_the_energy_with_the_centrifugal_term() -> None:
    for centrifugal in (0, 1):
        t, (inertia, c, a, k), theta, alpha, rows = arm_equations(centrifugal)
        eleven = [
            (inertia + sum(a[i] * alpha[i] ** 2 for i in range(2))) * theta.diff(t, 2)
            + sum(c[i] * alpha[i].diff(t, 2) for i in range(2))
            + 2 * sum(a[i] * alpha[i] * alpha[i].diff(t) for i in range(2)) * theta.diff(t)
        ] + [
            c[i] * theta.diff(t, 2)
            + a[i] * alpha[i].diff(t, 2)
            - a[i] * alpha[i] * theta.diff(t) ** 2
            + k[i] * alpha[i]
            for i in range(2)
        ]
        difference = [sp.simplify(mine - theirs) for mine, theirs in zip(rows, eleven, strict=True)]
        assert all(d == 0 for d in difference) == (centrifugal == 1)


def test_000_11_the_sum_over_modes_in_one_equation_leaves_the_modes_undetermined() -> None:
    *_, rows = arm_equations(1)
    _, _, theta, alpha, _ = arm_equations(1)
    t = sp.Symbol("t")
    accelerations = [q.diff(t, 2) for q in (theta, *alpha)]
    per_mode = sp.Matrix([[sp.diff(row, acceleration) for acceleration in accelerations] for row in rows])
    assert per_mode.rank() == 3
    summed = sp.Matrix([per_mode.row(0), per_mode.row(1) + per_mode.row(2)])
    assert summed.rank() == 2


LENGTH, MASS, HUB = 0.419, 0.065, 2.08e-3
DENSITY = MASS / LENGTH
RIGIDITY = (2 * np.pi * 3.0) ** 2 * DENSITY * LENGTH**4 / BETA[0] ** 4


def test_000_16_the_stiffness_integral_of_q_squared_puts_the_mode_at_0_15_hz() -> None:
    squared = quad(lambda x: cantilever(0, x) ** 2, 0, 1, epsabs=1e-12)[0] * LENGTH
    curvature = quad(lambda x: cantilever(0, x, 2) ** 2, 0, 1, epsabs=1e-12)[0] / LENGTH**3
    assert math.sqrt(RIGIDITY * curvature / (DENSITY * squared)) / (2 * np.pi) == pytest.approx(3.0, rel=1e-9)
    assert math.sqrt(RIGIDITY * squared / (DENSITY * squared)) / (2 * np.pi) == pytest.approx(0.150, abs=5e-4)


def final_angle(height: Any, zone: Any) -> Any:
    """Degrees, 1 s after a step of 1 s: equation (11) with one mode, parameter set A."""
    efficiency, ratio, motor, kt, resistance, km = 0.9, 70, 0.69, 7.68e-3, 2.6, 7.68e-3
    gain, friction = efficiency * ratio * motor * kt / resistance, 0.004
    inertia = HUB + DENSITY * LENGTH**3 / 3
    c = DENSITY * LENGTH**2 * quad(lambda x: x * cantilever(0, x), 0, 1)[0]
    a, k = MASS, RIGIDITY * BETA[0] ** 4 / LENGTH**3

    def rate(_: Any, y: Any, voltage: Any) -> list[Any]:
        _, alpha, speed, alpha_speed = y
        torque = gain * (voltage - ratio * km * speed) - friction * speed
        right = [torque - 2 * speed * a * alpha * alpha_speed, a * alpha * speed**2 - k * alpha]
        return [speed, alpha_speed, *np.linalg.solve([[inertia + a * alpha**2, c], [c, a]], right)]

    state = np.zeros(4)
    for voltage in (zone(height), zone(0.0)):
        state = solve_ivp(rate, (0, 1), state, args=(voltage,), rtol=1e-9, atol=1e-11).y[:, -1]
    return np.rad2deg(state[0])


def test_000_12_the_third_branch_of_the_dead_zone() -> None:
    low, high = -0.09, 0.18

    def right(v: Any) -> Any:
        return v - high if v > high else v - low if v < low else 0.0

    def printed(v: Any) -> Any:
        return v - high if v > high else v + low if v < low else 0.0

    below = np.nextafter(low, -1)
    assert right(below) == pytest.approx(0, abs=1e-12)
    assert printed(below) == pytest.approx(-0.18)  # a jump, and a voltage larger than what was applied
    assert final_angle(-1.0, lambda v: v) == pytest.approx(-100.741, abs=0.005)
    assert final_angle(-1.0, right) == pytest.approx(-91.67, abs=0.005)
    assert final_angle(-1.0, printed) == pytest.approx(-109.8, abs=0.05)
    assert final_angle(1.0, right) == pytest.approx(82.607, abs=0.005)


# -- One-link manipulator: harmonic drive and lumped-mass link ---------------------------------------------------------


def test_001_2_the_inertia_is_the_total_and_the_torque_that_of_the_load_side() -> None:
    s, rotor, load, stiffness, n, torque = sp.symbols("s I_r I_s K n tau", positive=True)
    qr, qs = sp.symbols("q_r q_s")
    solved = sp.solve(
        [
            rotor * s**2 * qr + stiffness / n**2 * (qr - n * qs) - torque,
            load * s**2 * qs - stiffness * (qr / n - qs),
        ],
        [qr, qs],
        dict=True,
    )[0]
    rigid = sp.limit(solved[qs] * s**2 / torque, stiffness, sp.oo)
    assert sp.simplify(rigid - n / (n**2 * rotor + load)) == 0


def test_001_table_1_the_largest_torque_is_not_that_of_the_nominal_current() -> None:
    values = {row["quantity"]: float(row["value"]) for row in table("harmonic_drive_actuator")}
    assert values["nominal_current"] * values["torque_per_current"] == pytest.approx(2.147, abs=5e-4)
    assert values["maximum_torque"] == 1.9
    # The row reads output per rotor; the equations take n = 100, as the encoder rows do.
    assert 1 / values["gear_ratio_output_per_rotor"] == pytest.approx(100)
    assert values["encoder_cycles_per_rev_output"] / values["encoder_cycles_per_rev_rotor"] == 100


def test_001_table_2_the_first_zero_and_the_third_mode() -> None:
    rows = [r for r in table("harmonic_drive_poles_zeros") if float(r["imag_rad_per_s"]) > 0]
    ratio = {
        (r["kind"], float(r["imag_rad_per_s"])): -float(r["real_per_s"])
        / math.hypot(float(r["real_per_s"]), float(r["imag_rad_per_s"]))
        for r in rows
    }
    first = ratio.pop(("zero", 12.1))
    assert first == pytest.approx(0.00047, abs=5e-6)
    assert [ratio["zero", 76.19] / first, ratio["zero", 247.89] / first] == pytest.approx([18.3, 35.7], abs=0.05)
    assert max(ratio.values()) / first == pytest.approx(228, abs=1)
    # "Coincides with the analytical modes": a uniform cantilever with the first mode at 12.1 rad/s.
    second, third = (12.1 * (b / BETA[0]) ** 2 for b in BETA[1:])
    assert second == pytest.approx(75.83, abs=0.01)
    assert third == pytest.approx(212.3, abs=0.05)
    assert abs(76.19 / second - 1) < 0.005 < 0.15 < 247.89 / third - 1


# -- Mohan et al.: damping ---------------------------------------------------------------------------------------------

LINK, EI, RHO = 0.33, 0.4, 0.060 / 0.33


def test_003_signs_of_5_8_and_11a() -> None:
    # With + kappa theta' on the right the swing grows.
    inertia, kappa = 0.5455 * 0.33 * 0.33**2 / 3 + 2.95e-5, 1.242e-3
    gravity = 0.5455 * 0.33 * 9.81 * 0.33 / 2
    assert np.roots([inertia, -kappa, gravity]).real.max() == pytest.approx(0.095, abs=5e-4)
    assert np.roots([inertia, kappa, gravity]).real.max() == pytest.approx(-0.095, abs=5e-4)


def test_003_11a_the_coriolis_row() -> None:
    t, total, rho, *rest = sp.symbols("t I rho k11 k12 k21 k22")
    square, coupling = rest[:2], rest[2:]
    theta, *d = (sp.Function(name)(t) for name in ("theta", "d1", "d2"))
    energy = total * theta.diff(t) ** 2 / 2
    for j in range(2):
        energy += rho * (
            square[j] * d[j] ** 2 * theta.diff(t) ** 2 / 2
            + coupling[j] * theta.diff(t) * d[j].diff(t)
            + square[j] * d[j].diff(t) ** 2 / 2
        )
    row = sp.expand(energy.diff(theta.diff(t)).diff(t))
    rates = row.subs({q.diff(t, 2): 0 for q in (theta, *d)})
    right = 2 * theta.diff(t) * rho * sum(square[j] * d[j] * d[j].diff(t) for j in range(2))
    printed = 2 * theta.diff(t) * rho * sum(square[j] * d[j].diff(t) ** 2 for j in range(2))
    assert sp.expand(rates - right) == 0
    assert sp.expand(rates - printed) != 0


def test_003_11b_without_x_the_mass_matrix_is_indefinite() -> None:
    plain = quad(lambda x: cantilever(0, x), 0, 1)[0] * LINK
    arm = quad(lambda x: x * cantilever(0, x), 0, 1)[0] * LINK**2
    square = quad(lambda x: cantilever(0, x) ** 2, 0, 1)[0] * LINK
    assert RHO * square == pytest.approx(0.0600, rel=1e-4)
    assert RHO * arm == pytest.approx(1.12616e-2, rel=2e-4)  # rho = 0.1818 as printed gives 1.12616e-2
    for hub in (0.0, 2e-5, 7e-5):  # tables 2, 3, 4
        inertia = RHO * LINK**3 / 3 + hub
        literal = np.array([[inertia, RHO * plain], [RHO * plain, RHO * square]])
        right = np.array([[inertia, RHO * arm], [RHO * arm, RHO * square]])
        assert np.linalg.eigvalsh(literal).min() < -5e-3
        assert np.linalg.eigvalsh(right).min() > 0


def test_003_10d_the_first_derivative_gives_no_stiffness() -> None:
    curvature = quad(lambda x: cantilever(0, x, 2) ** 2, 0, 1)[0] / LINK**3
    slope = quad(lambda x: cantilever(0, x, 1) ** 2, 0, 1)[0] / LINK
    assert EI * curvature == pytest.approx(137.600, rel=1e-4)
    assert math.sqrt(EI * curvature / 0.06) / (2 * np.pi) == pytest.approx(7.6221, rel=1e-4)
    assert math.sqrt(EI * slope / 0.06) / (2 * np.pi) == pytest.approx(1.542, abs=1e-3)  # and its unit is not N/m


def test_003_critical_factors_are_not_those_of_the_link() -> None:
    found = []
    for mode in range(2):
        stiffness = EI * quad(lambda x, mode=mode: cantilever(mode, x, 2) ** 2, 0, 1)[0] / LINK**3
        found.append(2 * math.sqrt(stiffness * 0.06))
    assert found == pytest.approx([5.7464, 36.012], rel=1e-4)
    # In any one normalisation of both modes the ratio is that of the frequencies.
    assert found[1] / found[0] == pytest.approx(6.27, abs=0.005)
    assert pytest.approx(0.094, abs=5e-4) == 6.5e-3 / 6.9e-2
    # As printed, the product of mode 1 is consistent and that of mode 2 is ten times too small.
    assert pytest.approx(1.37e-2, abs=5e-5) == 0.198 * 6.9e-2
    assert pytest.approx(2.78e-4, abs=5e-7) == 0.0428 * 6.5e-3
    published = {row["quantity"]: float(row["value"]) for row in table("damped_links_results")}
    assert published["structural coefficient mode 2"] / (0.0428 * 6.5e-3) == pytest.approx(10, abs=0.1)


def test_003_ratios_divided_by_the_frequency_in_hertz() -> None:
    assert 0.198 / (2 * np.pi) == pytest.approx(0.0315, abs=5e-5)
    assert 0.0428 / (2 * np.pi) == pytest.approx(0.00681, abs=5e-6)
    # One cycle of 19.8 % leaves 28 % of the amplitude: not a strip of spring steel.
    assert math.exp(-2 * np.pi * 0.198 / math.sqrt(1 - 0.198**2)) == pytest.approx(0.28, abs=0.005)


def test_003_4b_the_composite_mass_needs_the_same_propagation_on_both_sides() -> None:
    def propagation(r: Any) -> Any:  # twist (omega, v) of a point from that of another, r from here to there
        x, y, z = r
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.block([[np.eye(3), np.zeros((3, 3))], [-cross, np.eye(3)]])

    r = np.array([0.3, -0.2, 0.1])
    body = np.diag([0.02, 0.03, 0.04, 1.5, 1.5, 1.5])  # a body about its own mass centre, which lies at r
    forward, backward = propagation(r), propagation(-r)
    right, printed = forward.T @ body @ forward, forward.T @ body @ backward
    steiner = np.diag([0.02, 0.03, 0.04]) + 1.5 * (r @ r * np.eye(3) - np.outer(r, r))
    assert right[:3, :3] == pytest.approx(steiner)
    assert right == pytest.approx(right.T)
    assert not np.allclose(printed, printed.T)


def test_003_table_5_the_mass_of_link_2() -> None:
    rows = table("damped_links")
    second = rows[-1]
    assert float(second["mass_kg"]) / float(second["length_m"]) == pytest.approx(0.0895, abs=5e-5)
    assert float(second["mass_per_length_kg_per_m_printed"]) == 0.1053 == pytest.approx(0.020 / 0.19, abs=5e-5)
    for row in rows[:-1]:
        assert float(row["mass_kg"]) / float(row["length_m"]) == pytest.approx(
            float(row["mass_per_length_kg_per_m_printed"]), rel=5e-4
        )
    # EI follows from steel of 200 GPa; the mass does not follow from 7850 kg/m3 as exactly.
    assert pytest.approx(0.4) == 200e9 * 0.024 * 0.001**3 / 12
    assert pytest.approx(0.1884) == 7850 * 0.024 * 0.001
