"""[Mohan 2010]: the shipped arms against values computed independently from the corrected equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

from engine.simulate import Result
from flexarm.api import linearise, simulate
from flexarm.cut import cut
from scenarios.load import SHIPPED, load

A, M, HUB, G = 0.33, 0.18002, 2.95e-5, 9.81
INERTIA = M * A**2 / 3 + HUB
NATURAL = np.sqrt(M * G * A / 2 / INERTIA)


def ran(name: str, *changes: str) -> Result:
    return simulate(load(name, changes))


def peaks(time: Any, y: Any) -> Any:
    """Instants and heights of the maxima, by parabolas through three points; the first row counts as one."""
    k = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    a, b, c = y[k - 1], y[k], y[k + 1]
    shift = (a - c) / (2 * (a - 2 * b + c))
    rows = np.column_stack([time[k] + shift * (time[1] - time[0]), b - (a - c) * shift / 4])
    return np.vstack([[time[0], y[0]], rows])


def line(time: Any, y: Any, low: float, high: float, trend: int = 0) -> float:
    """The strongest line (Hz) of the spectrum between two frequencies, Hann window, zero-padded, trend removed."""
    y = y - np.polyval(np.polyfit(time, y, trend), time)
    n = 64 * len(y)
    spectrum, f = np.abs(np.fft.rfft(y * np.hanning(len(y)), n)), np.fft.rfftfreq(n, time[1] - time[0])
    inside = (f > low) & (f < high)
    return float(f[inside][np.argmax(spectrum[inside])])


def frequencies(name: str, analysis: str, *changes: str) -> Any:
    poles = linearise(cut(load(name, changes), "linearise", analysis)).poles()
    return np.abs(poles[poles.imag > 1e-3]) / (2 * np.pi)


def test_rigid_pendulum_swings_and_dies_as_its_damping_ratio_says() -> None:
    """1.0598 Hz, ratio 0.9145, and the logarithmic decrement gives back 0.0142."""
    assert pytest.approx(6.6623, rel=1e-4) == NATURAL
    assert pytest.approx(1.242e-3, rel=1e-3) == 2 * 0.0142 * INERTIA * NATURAL
    result = ran("rigid-pendulum")
    found = peaks(result.time, result["arm.joint1.angle"])
    assert (len(found) - 1) / (found[-1, 0] - found[0, 0]) == pytest.approx(1.0598, rel=2e-3)
    assert found[1, 1] / found[0, 1] == pytest.approx(0.9145, rel=2e-3)
    decrement = np.log(found[0, 1] / found[-1, 1]) / (len(found) - 1)
    assert decrement / np.sqrt(4 * np.pi**2 + decrement**2) == pytest.approx(0.0142, abs=1e-4)
    assert frequencies("rigid-pendulum", "swing")[0] == pytest.approx(NATURAL / (2 * np.pi), rel=1e-9)


def test_the_printed_joint_damping_is_a_ratio_of_a_third() -> None:
    """The products are the paper's; 0.0308 as a joint damping is 0.352 and leaves 0.094 of each swing."""
    critical = 4 * np.pi * M * 0.96
    assert critical == pytest.approx(2.1717, rel=1e-4)
    assert 0.0142 * critical == pytest.approx(0.030837, rel=1e-4)
    assert pytest.approx(0.3521, rel=1e-3) == 0.0308 / (2 * INERTIA * NATURAL)
    result = ran("rigid-pendulum", "arm.viscous_friction=0.0308")
    found = peaks(result.time, result["arm.joint1.angle"])
    assert found[1, 1] / found[0, 1] == pytest.approx(0.094, rel=2e-3)
    assert 1 / (found[2, 0] - found[1, 0]) == pytest.approx(0.9924, rel=2e-3)


@pytest.mark.parametrize(("ratio", "left"), [(0.0315, 0.8204), (0.198, 0.2811)])
def test_clamped_link_rings_down_in_its_first_mode(ratio: float, left: float) -> None:
    """7.6221 Hz; with the printed 0.198 only 0.28 of a swing would be left."""
    result = ran("clamped-flexible-link", f"arm.damping_ratio=[{ratio},0.0068]")
    w = (1.8751040687 / A) ** 2 * np.sqrt(0.4 * A / 0.06)
    assert w / (2 * np.pi) == pytest.approx(7.6221, rel=1e-4)
    fast, t = w * np.sqrt(1 - ratio**2), result.time
    exact = 0.015 * np.exp(-ratio * w * t) * (np.cos(fast * t) + ratio * w / fast * np.sin(fast * t))
    assert np.abs(result["arm.link1.deflection"] - exact).max() < 1e-4 * 0.015
    found = peaks(t, result["arm.link1.deflection"])
    assert found[1, 1] / found[0, 1] == pytest.approx(left, rel=2e-3)


def test_flexible_pendulum_falls_from_level() -> None:
    """Line at 0.97 +- 0.03 Hz over 8 s, tip line 31.8 +- 0.3 Hz, at most 1.2 mm, 46 degrees left."""
    result = ran("flexible-pendulum")
    angle, tip = np.degrees(result["arm.joint1.angle"]), result["arm.link1.deflection"]
    assert line(result.time, angle, 0.3, 5) == pytest.approx(0.97, abs=0.03)
    assert line(result.time, tip, 15, 60) == pytest.approx(31.8, abs=0.3)
    assert 1.0e-3 < np.abs(tip).max() < 1.2e-3
    assert np.abs(angle[result.time > 7]).max() == pytest.approx(46, abs=1)
    found = frequencies("flexible-pendulum", "swing", "arm.damping_ratio=0")
    assert found[0] == pytest.approx(1.0578, rel=2e-3)


def test_the_printed_damping_of_the_flexible_pendulum_stops_it_at_once() -> None:
    """0.0106 N.m.s/rad is a ratio of 0.363, and the first swing over reaches 22 degrees."""
    inertia = 0.06 * A**2 / 3 + 2e-5
    assert 0.0106 / (2 * inertia * np.sqrt(0.06 * G * A / 2 / inertia)) == pytest.approx(0.363, rel=2e-3)
    angle = np.degrees(ran("flexible-pendulum", "arm.viscous_friction=0.0106")["arm.joint1.angle"])
    assert angle.min() == pytest.approx(-22, abs=0.5)


def test_frequencies_before_and_after_the_brake() -> None:
    """Two modes, hub 7e-5: 28.45 and 67.82 Hz hinged, 7.622 and 47.77 Hz held; by both ways."""
    undamped = ("arm.damping_ratio=0", "arm.viscous_friction=0")
    hinged, held = (frequencies("flexible-arm-braked", key, *undamped) for key in ("driven", "held"))
    np.testing.assert_allclose(hinged, [28.45, 67.82], rtol=2e-3)
    np.testing.assert_allclose(held, [7.622, 47.77], rtol=2e-3)
    result = ran("flexible-arm-braked", *undamped)
    grips = next(time for time, name, _ in result.events if name == "brake.grip")
    tip, before, after = result["arm.link1.deflection"], result.time < grips, result.time > grips + 0.01
    driven = [line(result.time[before], tip[before], *band, trend=6) for band in ((15, 60), (50, 90))]
    np.testing.assert_allclose(driven, [28.45, 67.82], rtol=2e-3)
    ringing = [line(result.time[after], tip[after], *band) for band in ((4, 20), (30, 70))]
    np.testing.assert_allclose(ringing, [7.622, 47.77], rtol=2e-3)
    assert np.abs(tip[after]).max() > 10 * np.abs(tip[before]).max()


def test_the_brake_holds_the_arm_at_the_reference() -> None:
    result = ran("flexible-arm-braked")
    angle, grip = result["arm.joint1.angle"], result["brake.grip"]
    assert angle[0] == pytest.approx(np.radians(-40), rel=1e-12)
    assert (angle[grip == 0] <= 0).all()
    at_rest = angle[result.time > 0.7]
    assert np.ptp(at_rest) == 0
    assert 0 < at_rest[0] < np.radians(0.05)
    assert np.abs(result["recording.out"]).max() <= 0.011


@pytest.mark.parametrize(("density", "expected"), [(0.1053, [14.50, 23.98, 39.9]), (0.0895, [14.50, 24.61, 39.9])])
def test_two_link_arm(density: float, expected: list[float]) -> None:
    """Both joints free, 0.5 %; held joints are in the block's own tests."""
    changes = (f"arm.mass=[0.019992,{density * 0.19}]", "arm.damping_ratio=0", "arm.viscous_friction=0")
    found = frequencies("two-link-flexible", "plant", *changes)
    np.testing.assert_allclose(found[:3], expected, rtol=5e-3)


def test_two_link_arm_moves_on_its_torques_as_a_rigid_one_does() -> None:
    """The line from joint 1 to joint 2, against two rigid bars driven by the same recordings, integrated by scipy."""
    (l1, l2), (m1, m2), hub, payload = (0.24, 0.19), (0.019992, 0.020007), 5e-5, 0.21
    rows = np.genfromtxt(SHIPPED / "data" / "two_link_torques.csv", delimiter=",", skip_header=2)
    torques = PchipInterpolator(rows[:, 0], rows[:, 1:])
    i1, i2, coupling = m1 * l1**2 / 3 + hub + (payload + m2) * l1**2, m2 * l2**2 / 3 + hub, m2 * l1 * l2 / 2

    def rhs(t: float, y: Any) -> Any:
        _, b, p, q = y
        c, s = coupling * np.cos(b), coupling * np.sin(b)
        M = [[i1 + i2 + 2 * c, i2 + c], [i2 + c, i2]]
        f = np.array([s * (2 * p + q) * q, -s * p**2]) + (torques(t) if t < rows[-1, 0] else 0.0)
        return [p, q, *np.linalg.solve(M, f)]

    rigid = solve_ivp(rhs, (0, 2), np.radians([-40, 40, 0, 0]), rtol=1e-9, atol=1e-10, max_step=0.01, dense_output=True)
    result = ran("two-link-flexible", "arm.viscous_friction=0")
    assert np.abs(result["torque1.out"]).max() == 0.011
    assert np.abs(result["torque2.out"]).max() == 0.007
    first, second = rigid.sol(result.time)[:2]
    assert np.abs(result["arm.joint1.angle"] + result["arm.link1.deflection"] / l1 - first).max() < 2e-3
    assert np.abs(result["arm.joint2.angle"] - second).max() < 0.06
    assert np.ptp(first) > 0.3
    assert np.ptp(second) > 1
