"""Errata of [Gao J. n.d.] (docs/errata.md), settled by derivations and numbers that use no product code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import least_squares

from tests.physics.papers import column, table

TABLES = {
    "srv02_bare_motor_sines": 11,
    "srv02_rigid_link_sines": 33,
    "srv02_flexible_link_sines": 39,
}
S = sp.Symbol("s")
PARAMETERS = sp.symbols("Jm Ja Jl da dl ka kl Ba Bl Bm a km kg", positive=True)
JM, JA, JL, DA, DL, KA, KL, BA, BL, BM, GAIN, KM, KG = PARAMETERS
W = BM + GAIN * KM


def transfer(rows: Any, unknowns: Any, voltage: Any) -> tuple[Any, Any]:
    """Motor speed over voltage from the Laplace transforms of the rows, by Cramer's rule; positions are unknown."""
    matrix = sp.Matrix([[sp.diff(row, unknown) for unknown in unknowns] for row in rows])
    source = sp.Matrix([-sp.diff(row, voltage) for row in rows])
    replaced = matrix.copy()
    replaced[:, 0] = source
    # One s cancels: the whole train may be turned freely.
    return sp.expand(-replaced.det()), sp.expand(sp.cancel(-matrix.det() / S))


def two_mass(outer: Any, inner: Any) -> Any:
    """Numerator and denominator; torque on the motor is ``outer`` times that of the spring, wound by pm ``inner``."""
    pm, pa, voltage = sp.symbols("pm pa V")
    spring = (KA + DA * S) * (pm * inner - pa)
    rows = [
        GAIN * (voltage - KM * S * pm) - JM * S**2 * pm - BM * S * pm - outer * spring,
        JA * S**2 * pa + BA * S * pa - spring,
    ]
    return transfer(rows, (pm, pa), voltage)


PRINTED_215 = (
    JM * JA * S**3
    + (JA * (BM + GAIN * KM + DA) + JM * (DA + BA)) * S**2
    + (KA * (JM + JA) + DA * (BM + BA + GAIN * KM) + BA * (BM + GAIN * KM)) * S
    + KA * (BM + BA + GAIN * KM)
)


def test_002_215_is_the_formula_of_a_ratio_of_one_with_jm_for_m() -> None:
    numerator, denominator = two_mass(1, 1)
    assert sp.expand(denominator - PRINTED_215) == 0
    assert sp.expand(numerator - GAIN * (JA * S**2 + (DA + BA) * S + KA)) == 0


def test_002_214_the_reaction_is_divided_by_the_ratio() -> None:
    # With the sign repaired but the ratio as printed, the ratio cancels: tables B are motor-referred.
    literal = two_mass(KG, 1 / KG)
    assert [sp.expand(x - y) for x, y in zip(literal, two_mass(1, 1), strict=True)] == [0, 0]
    # Divided, the load and its spring appear at the motor divided by the square of the ratio, as power demands.
    right = two_mass(1 / KG, 1 / KG)
    referred = {p: p / KG**2 for p in (JA, DA, KA, BA)}
    for x, y in zip(right, two_mass(1, 1), strict=True):
        ratio = sp.cancel(x / y.subs(referred, simultaneous=True))
        assert sp.diff(ratio, S) == 0
    assert sp.cancel(right[0] / right[1]) != sp.cancel(literal[0] / literal[1])


def test_002_214_as_printed_is_unstable() -> None:
    # The inner minus makes the spring push the motor away: kg(da(..) - ka(..)) with kg = 1 and table B.1.
    jm, ja, d, k, b_load, bm, gain, km = 4.606e-7, 4.81e-5, 3e-5, 0.012, 1.68e-6, 1.26e-6, 2.038154e-3, 7.68e-3
    w = bm + gain * km

    def poles(sign: Any) -> Any:
        mass, damping = np.diag([jm, ja]), np.array([[w + d, -d], [-d, b_load + d]])
        stiffness = np.array([[sign * k, -sign * k], [-k, k]])
        lower = np.hstack([-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)])
        return np.linalg.eigvals(np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), lower]))

    assert poles(1).real.max() < 1e-9
    assert poles(-1).real.max() > 10


def three_mass() -> Any:
    pm, pa, pl, voltage = sp.symbols("pm pa pl V")
    first, second = (KA + DA * S) * (pm - pa), (KL + DL * S) * (pa - pl)
    rows = [
        GAIN * (voltage - KM * S * pm) - JM * S**2 * pm - BM * S * pm - first,
        JA * S**2 * pa - first + second,
        JL * S**2 * pl + BL * S * pl - second,
    ]
    return transfer(rows, (pm, pa, pl), voltage)


def test_002_220_two_coefficients_are_wrong() -> None:
    numerator, denominator = three_mass()
    printed_numerator = GAIN * (
        JA * JL * S**4
        + (JA * (DL + BL) + JL * (DA + DL)) * S**3
        + (JA * KL + JL * (KA + KL) + DA * (DL + BL) + DL * BL) * S**2
        + (KL * (DA + BL) + KA * (DL + BL)) * S
        + KA * KL
    )
    assert sp.expand(numerator - printed_numerator) == 0
    inner = JA * (DL + BL) + JL * DL
    s3 = JM * (JA * KL + JL * (KA + KL) + DA * (DL + BL) + DL * BL) + (DA + W) * inner + W * JL * DA + KA * JA * JL
    s3_printed = JM * (JA * KL + JL * (KA + KL + DA * (DL + BL) + DL * BL)) + (DA + W) * inner + JL * DL * W
    common = JM * (KL * (DA + BL) + KA * (DL + BL)) + (DA + W) * ((JA + JL) * KL + DL * BL) + KA * inner
    s2, s2_printed = common + W * (DA * (DL + BL) + JL * KA), common + W * (DA * (DL + BL) + JL * KL)
    right = {
        5: JM * JA * JL,
        4: JM * (JA * (DL + BL) + JL * (DA + DL)) + JA * JL * (DA + W),
        3: s3,
        2: s2,
        1: JM * KL * KA + W * (KL * (DA + BL) + KA * (DL + BL)) + DA * KL * BL + KA * ((JA + JL) * KL + DL * BL),
        0: KA * KL * (W + BL),
    }
    found = sp.Poly(denominator, S)
    for power, expected in right.items():
        assert sp.expand(found.coeff_monomial(S**power) - expected) == 0, power
    assert sp.expand(s3 - s3_printed) != 0
    assert sp.factor(s2 - s2_printed) == sp.factor(W * JL * (KA - KL))


def test_002_216_and_221_the_inverse_dynamics() -> None:
    pm, pa, pl, pa1 = sp.symbols("pm pa pl pa1")
    # (2.16): from (2.13), the denominator is da s + ka and both sides are positions.
    motor = sp.solve(JA * S**2 * pa + (DA * S + KA) * (pa - pm / KG) + BA * S * pa, pm)[0]
    assert sp.simplify(motor - KG * (JA * S**2 + (DA + BA) * S + KA) / (DA * S + KA) * pa) == 0
    # The reaction on the motor is what the load needs, divided by the ratio.
    reaction = (DA * S + KA) * (motor / KG - pa) / KG
    assert sp.simplify(reaction - (JA * S**2 + BA * S) * pa / KG) == 0
    # (2.21): from (2.18), minus kg (dl s + kl)/(da s + ka) pl.
    motor = sp.solve(JA * S**2 * pa1 + (DA * S + KA) * (pa1 - pm / KG) - (DL * S + KL) * (pl - pa1), pm)[0]
    expected = KG * (JA * S**2 + (DA + DL) * S + KA + KL) / (DA * S + KA) * pa1
    expected -= KG * (DL * S + KL) / (DA * S + KA) * pl
    assert sp.simplify(motor - expected) == 0


@pytest.mark.parametrize(("name", "rows"), TABLES.items())
def test_002_the_printed_gain_is_divided_by_1_8951_volt(name: Any, rows: Any) -> None:
    speed, gain = column(name, "max_motor_speed_rad_per_s"), column(name, "gain_dB_printed")
    assert len(speed) == rows
    assert np.all(column(name, "amplitude_V") == 2)
    assert np.abs(gain - 20 * np.log10(speed / 1.8951)).max() < 2e-4
    offset = gain - 20 * np.log10(speed / 2)
    assert 0.46785 < offset.min() < offset.max() < 0.46804


def test_002_the_divisor_is_two_volt_less_the_coulomb_voltage() -> None:
    offset = np.concatenate(
        [
            column(name, "gain_dB_printed") - 20 * np.log10(column(name, "max_motor_speed_rad_per_s") / 2)
            for name in TABLES
        ]
    )
    assert len(offset) == 83
    assert offset.mean() == pytest.approx(0.46795, abs=1e-5)
    divisor = 2 * 10 ** (-offset.mean() / 20)
    assert divisor == pytest.approx(1.8951, abs=1e-5)
    torque = (2 - divisor) * 0.69 * 7.68e-3 / 2.6
    assert torque == pytest.approx(2.138e-4, abs=1e-7)
    assert pytest.approx(0.1104, abs=5e-5) == 2.25e-4 * 2.6 / (0.69 * 7.68e-3)  # the text's value would be this


def counts(name: Any) -> Any:
    """Speeds as counts of a converter of 10 V / 2048 behind a tachometer of 1.5 mV per rpm."""
    return column(name, "max_motor_speed_rad_per_s") * 60 / (2 * np.pi) * 1.5e-3 / (10 / 2048)


def test_002_speeds_are_quantised() -> None:
    assert (10 / 2048) / 1.5e-3 * 2 * np.pi / 60 == pytest.approx(0.34088, abs=1e-5)
    flexible, w = counts("srv02_flexible_link_sines"), column("srv02_flexible_link_sines", "frequency_rad_per_s")
    assert np.abs(flexible - np.round(flexible))[w >= 0.9].max() < 0.02
    assert (w >= 0.9).sum() == 28
    lowest = flexible[w == 10][0]
    assert lowest == pytest.approx(15, abs=1e-3)
    assert 20 * np.log10(15.5 / 15) == pytest.approx(0.285, abs=1e-3)
    # A.1 from 0.5 Hz on: integers to 0.03, except at 15 and 30 Hz. 0.4 Hz (242.07) is none.
    rigid, hertz = counts("srv02_rigid_link_sines"), column("srv02_rigid_link_sines", "frequency_Hz")
    away = np.abs(rigid - np.round(rigid))
    fine = (hertz >= 0.5) & ~np.isin(hertz, (15, 30))
    assert fine.sum() == 19
    assert away[fine].max() < 0.03
    assert sorted(hertz[(hertz >= 0.4) & (away > 0.02)]) == [0.4, 1.5, 9, 15, 30]
    # The bare motor's table is read more coarsely, to 10 mV and finer; it is not quantised so.
    assert np.abs(counts("srv02_bare_motor_sines") % 1 - 0.5).min() < 0.02


def test_002_suspect_rows() -> None:
    w, speed = (column("srv02_flexible_link_sines", h) for h in ("frequency_rad_per_s", "max_motor_speed_rad_per_s"))
    assert speed[w == 200][0] == speed[w == 2][0] == 33.7477
    assert 20 * np.log10(speed[w == 150][0] / speed[w == 200][0]) > 3
    assert column("srv02_rigid_link_sines", "frequency_Hz").min() == 0.02  # the text says 0.01


def test_002_table_b1_does_not_describe_table_a1() -> None:
    # Below 4 rad/s the train turns as one: total inertia by a fit of a / (J s + W), raw gain.
    gain, total = 2.038154e-3, {}
    for name in ("srv02_rigid_link_sines", "srv02_flexible_link_sines"):
        w, speed = column(name, "frequency_rad_per_s"), column(name, "max_motor_speed_rad_per_s")
        low = w < 4
        fit = least_squares(
            lambda p, w=w[low], speed=speed[low]: (
                20 * np.log10(gain / np.abs(1j * w * np.exp(p[0]) + np.exp(p[1])) / (speed / 2))
            ),
            np.log([2e-5, 1.7e-5]),
        )
        total[name] = (int(low.sum()), math.exp(fit.x[0]), math.sqrt(np.mean(fit.fun**2)))
    rows, inertia, rms = total["srv02_rigid_link_sines"]
    assert rows == 14
    assert inertia == pytest.approx(1.85e-5, rel=0.01)
    assert rms == pytest.approx(0.065, abs=0.002)
    b1 = float(table("srv02_matched_loads")[0]["Ja_kg_m2"])
    assert (b1 + 4.606e-7) / inertia == pytest.approx(2.6, abs=0.05)
    rows, inertia, rms = total["srv02_flexible_link_sines"]
    assert rows == 17
    assert inertia == pytest.approx(6.29e-5, rel=0.005)
    assert rms == pytest.approx(0.26, abs=0.01)


def test_002_figure_33_ends_at_rest_and_meets_all_four_limits_at_2_s() -> None:
    distance, snap, segment = 2.4, 76.8, 0.25
    state, most = np.zeros(4), np.zeros(3)  # position, velocity, acceleration, jerk
    for sign in (1, -1, -1, 1, -1, 1, 1, -1):
        h = np.linspace(0, segment, 501)
        q, v, a, j = state
        jerk = j + sign * snap * h
        acceleration = a + j * h + sign * snap * h**2 / 2
        velocity = v + a * h + j * h**2 / 2 + sign * snap * h**3 / 6
        most = np.maximum(most, [np.abs(velocity).max(), np.abs(acceleration).max(), np.abs(jerk).max()])
        position = q + v * segment + a * segment**2 / 2 + j * segment**3 / 6 + sign * snap * segment**4 / 24
        state = np.array([position, velocity[-1], acceleration[-1], jerk[-1]])
    assert state == pytest.approx([distance, 0, 0, 0], abs=1e-9)
    assert most == pytest.approx([2.4, 4.8, 19.2], rel=1e-9)


def test_002_41_has_its_corner_at_10_rad_per_s() -> None:
    def level(w: Any, corner: Any) -> Any:
        return 20 * np.log10(abs(corner / (1j * w + corner)))

    assert level(10, 10) == pytest.approx(-3.01, abs=0.01)
    assert level(2 * np.pi * 10, 10) == pytest.approx(-16.1, abs=0.05)
    assert level(2 * np.pi * 10, 2 * np.pi * 10) == pytest.approx(-3.01, abs=0.01)
