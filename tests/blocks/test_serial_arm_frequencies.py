"""Arms of [Mohan 2010]: equations written out, and frequencies computed independently."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.friction import BearingFriction
from blocks.links.serial_arm import SerialArm
from engine.block import Block
from tests.blocks.assembly import linear, model, run
from tests.blocks.test_mode_shapes import shape
from tests.blocks.test_serial_arm import accelerations, layout, point


def test_equations_of_one_link_written_out() -> None:
    """[Mohan 2010, eq. 11] in corrected form, with gravity, joint and modal damping."""
    a, rho, rigidity, hub, kappa, g = 0.33, 0.06 / 0.33, 0.4, 2e-5, 3.73e-4, 9.81
    ratios = (0.0315, 0.0068)
    arm = SerialArm(
        links=1, length=a, mass=0.06, flexural_rigidity=rigidity, hub_inertia=hub, viscous_friction=kappa,
        damping_ratio=list(ratios), gravity=True,
    )  # fmt: skip
    made = model({"arm": arm})
    integral = [[integrate.quad(lambda x, j=j, p=p: x**p * shape(j, x, 0), 0, 1)[0] for j in (1, 2)] for p in (0, 1)]
    b, k2 = rho * a * np.array(integral[0]), a**2 * np.array(integral[1])
    K = rigidity / a**3 * np.array([integrate.quad(lambda x, j=j: shape(j, x, 2) ** 2, 0, 1)[0] for j in (1, 2)])
    zeta = 2 * np.array(ratios) * np.sqrt(K * rho * a)
    np.testing.assert_allclose(K, [137.600, 5404.11], rtol=1e-4)
    np.testing.assert_allclose(0.1818 * k2, [1.12616e-2, 1.79700e-3], rtol=1e-4)
    np.testing.assert_allclose(2 * np.sqrt(K * rho * a), [5.7464, 36.012], rtol=1e-4)
    order = [
        layout(made).index(f"arm.{name}") for name in ("joint1.angle", "link1.mode1.position", "link1.mode2.position")
    ]
    for seed in range(3):
        at, speed = point(made, seed)
        (th, *d), (w, *rate) = at[order], speed[order]
        d, rate = np.array(d), np.array(rate)
        M = np.zeros((3, 3))
        M[0, 0] = rho * a**3 / 3 + hub + rho * a * d @ d
        M[0, 1:] = M[1:, 0] = rho * k2
        M[1:, 1:] = rho * a * np.eye(2)
        f = np.array([
            -g * (0.06 * a / 2 * np.sin(th) + np.cos(th) * b @ d) - 2 * w * rho * a * d @ rate - kappa * w,
            *(-g * b * np.sin(th) + rho * a * d * w**2 - zeta * rate - K * d),
        ])  # fmt: skip
        np.testing.assert_allclose(accelerations(made, at, speed)[order], np.linalg.solve(M, f), rtol=1e-9)


def hertz(values: dict[str, Any], held: tuple[bool, bool] | tuple[bool], **at: float) -> Any:
    """Frequencies with joints held where they are, or free."""
    parts: dict[str, Block] = {"arm": SerialArm(**values)}
    wires, modes = [], {}
    for k, stuck in enumerate(held, 1):
        if stuck:
            parts[f"hold{k}"] = BearingFriction(coulomb_friction=1)
            wires.append(f"hold{k}.shaft arm.joint{k}")
            modes[f"hold{k}"] = "stuck"
    poles = linear(parts, *wires, modes=modes, at=at).poles()
    return np.abs(poles[poles.imag > 1e-3]) / (2 * np.pi)


def two_links(density: float, modes: int, shapes: str) -> dict[str, Any]:
    """Table 5, with the mass per length of link 2."""
    return {
        "links": 2,
        "modes": modes,
        "shapes": shapes,
        "length": [0.24, 0.19],
        "mass": [0.0833 * 0.24, density * 0.19],
        "payload": [0.21, 0],
        "flexural_rigidity": 0.05,
        "hub_inertia": 5e-5,
    }


@pytest.mark.parametrize(
    ("held", "printed", "from_mass"),
    [
        ((True, True), [1.02, 7.27, 26.8, 52.6], [1.03, 7.75, 27.3, 52.9]),
        ((True, False), [1.10, 23.98, 33.19], [1.10, 24.61, 33.19]),
        ((False, True), [6.24, 16.98, 29.5], [6.63, 17.16, 29.9]),
        ((False, False), [14.50, 23.98, 39.9], [14.50, 24.61, 39.9]),
    ],
)
def test_two_link_arm_of_paper_003(held: tuple[bool, bool], printed: list[float], from_mass: list[float]) -> None:
    """[Mohan 2010, Table 5], 0.5 %; theta_2 = 40 deg."""
    for density, expected in ((0.1053, printed), (0.0895, from_mass)):
        values = two_links(density, 4, "craig_bampton")
        found = hertz(values, held, **{"arm.joint2.angle": np.radians(40)})
        np.testing.assert_allclose(found[: len(expected)], expected, rtol=5e-3)
        if held == (True, True):
            for angle in (0.0, 80.0):
                other = hertz(values, held, **{"arm.joint2.angle": np.radians(angle)})
                assert abs(other[1] - found[1]) < 0.35


@pytest.mark.parametrize(
    ("shapes", "modes", "expected"),
    [
        ("cantilever", 2, 9.16),
        ("cantilever", 10, 7.624),
        ("craig_bampton", 2, 7.285),
        ("craig_bampton", 3, 7.270),
        ("craig_bampton", 4, 7.269),
    ],
)
def test_a_moment_at_the_tip_needs_shapes_that_carry_one(shapes: str, modes: int, expected: float) -> None:
    """Second frequency with both joints held; 7.269 Hz by finite elements, approached from above."""
    found = hertz(two_links(0.1053, modes, shapes), (True, True), **{"arm.joint2.angle": np.radians(40)})
    assert found[1] == pytest.approx(expected, rel=5e-4)
    assert found[1] > 7.2685


SINGLE = {"links": 1, "length": 0.33, "mass": 0.06, "flexural_rigidity": 0.4, "hub_inertia": 2e-5}


@pytest.mark.parametrize(
    ("change", "held", "expected"),
    [
        ({"hub_inertia": 2e-5}, False, [31.96, 97.48]),
        ({"hub_inertia": 7e-5}, False, [28.45, 67.82]),
        ({"modes": 1, "hub_inertia": 2e-5}, False, [39.03]),
        ({"modes": 1, "hub_inertia": 7e-5}, False, [31.24]),
        ({"modes": 6, "shapes": "craig_bampton", "hub_inertia": 0.0}, False, [33.42, 108.3]),
        ({"modes": 5, "shapes": "craig_bampton", "hub_inertia": 2e-5}, False, [31.93, 90.34]),
        ({"modes": 5, "shapes": "craig_bampton", "hub_inertia": 7e-5}, False, [28.43, 67.21]),
        ({"modes": 3}, True, [7.6221, 47.767, 133.75]),
    ],
)
def test_hinged_beam_of_paper_003(change: dict[str, Any], held: bool, expected: list[float]) -> None:
    """[Mohan 2010, Tables 2, 3], computed independently; tolerance 0.2 % (clamped 0.1 %)."""
    found = hertz({**SINGLE, **change}, (held,))
    np.testing.assert_allclose(found[: len(expected)], expected, rtol=1e-3 if held else 2e-3)


def test_small_swings_of_paper_003() -> None:
    """Computed independently: rigid 6.6623 rad/s; flexible 1.0578 Hz, tip line under gravity."""
    rigid = {**SINGLE, "modes": 0, "mass": 0.18002, "hub_inertia": 2.95e-5, "gravity": True}
    assert 2 * np.pi * hertz(rigid, (False,))[0] == pytest.approx(6.6623, rel=1e-4)
    found = hertz({**SINGLE, "gravity": True}, (False,))
    assert found[0] == pytest.approx(1.0578, rel=1e-4)
    assert hertz({**SINGLE, "modes": 0, "gravity": True}, (False,))[0] == pytest.approx(1.0579, rel=1e-4)


@pytest.mark.parametrize(("degrees", "expected"), [(7.0, 1.0568), (40.0, 1.026), (90.0, 0.896)])
def test_swings_slow_down_with_their_amplitude(degrees: float, expected: float) -> None:
    """Computed independently; at 7 deg small-angle theory, 1 - theta^2 / 16."""
    parts: dict[str, Block] = {"arm": SerialArm(**SINGLE, modes=2, gravity=True)}
    result = run(parts, stop=6.0, initial={"arm.joint1.angle": np.radians(degrees)})
    angle = result["arm.joint1.angle"]
    down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    instants = [result.time[k] + 1e-3 * angle[k] / (angle[k] - angle[k + 1]) for k in down]
    assert 1 / float(np.mean(np.diff(instants))) == pytest.approx(expected, abs=1e-3)
