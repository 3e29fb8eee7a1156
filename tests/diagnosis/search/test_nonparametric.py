"""A law whose name is taken out of the catalogue: measured as a curve, put in as one, and given no wrong name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import flexarm
from diagnosis.api import diagnose
from diagnosis.thresholds import RECOVERY
from diagnosis.verdict.write import amended_text
from scenarios.load import load
from tests.diagnosis import plants

FRICTION = (
    *("coulomb_friction", "stribeck_friction", "direction_dependent_friction"),
    *("load_dependent_friction", "quadratic_load_friction"),
)
LIKE_IT = (
    *FRICTION,
    "dead_zone",
    "saturation",
    "current_limit",
    "rate_limit",
    "command_quantisation",
    "supply_sag",
    "uneven_gain",
    "offset",
    "viscous_friction",
    "quadratic_drag",
)
DRAG, LEVEL, NOISE = 4.0e-8, 4.0e-4, 0.3


def dragged(t: Any, u: Any, parts: int = 10) -> NDArray[Any]:
    """Motor speed with drag DRAG v |v| beside the viscous friction, by Runge-Kutta steps of 0.2 ms."""
    constant = plants.EFFICIENCY * plants.TORQUE_CONSTANT / plants.RESISTANCE
    damping = plants.VISCOUS + constant * plants.TORQUE_CONSTANT
    h, v, rows = (t[1] - t[0]) / parts, 0.0, []

    def rate(v: Any, volt: Any) -> Any:
        return (constant * volt - damping * v - DRAG * v * abs(v)) / plants.INERTIA

    for volt in u:
        rows.append(v)
        for _ in range(parts):
            a = rate(v, volt)
            b = rate(v + h / 2 * a, volt)
            c = rate(v + h / 2 * b, volt)
            v += h / 6 * (a + 2 * b + 2 * c + rate(v + h * c, volt))
    return np.array(rows)


@pytest.fixture(scope="module")
def sticky(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = plants.case(tmp_path_factory.mktemp("sticky"), coulomb=LEVEL, noise=NOISE, seed=3)
    return diagnose(path, without=LIKE_IT)


@pytest.fixture(scope="module")
def slowed(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plants, "speed", dragged)
        path = plants.case(tmp_path_factory.mktemp("slowed"), noise=NOISE, seed=4)
    return diagnose(path, without=LIKE_IT)


def refitted(found: Any) -> Any:
    """The user's scenario with its parameters as the refit left them, so that the curve alone makes the difference."""
    values = found.study.refit.fit.parameters()
    return load(found.study.scenario.path, [f"{name}={value:.12g}" for name, value in values.items()])


def put_in(found: Any) -> Any:
    """The scenario that a user is given, read from beside the recordings."""
    path = found.study.scenario.path.with_name("amended.yaml")
    path.write_text(amended_text(found))
    return load(path)


@pytest.mark.parametrize("concealed", ["sticky", "slowed"])
def test_a_law_without_a_name_is_measured_and_put_in(concealed: str, request: pytest.FixtureRequest) -> None:
    found = request.getfixturevalue(concealed)
    assert found.verdict == "unknown"
    (finding,) = found.findings
    assert (finding["status"], finding["effect"], finding["block"]) == ("unknown", "unknown", "motor")
    assert "without a name" in finding["sentence"]
    assert not set(LIKE_IT) & {c.effect for t in found.study.trials for c in t.effects}
    amended = put_in(found)
    law = amended.system.blocks["found_law"]
    assert type(law).__name__ in ("TorqueCurve", "Curve")
    assert len(law.values["heights"]) == RECOVERY.heights
    assert np.isfinite(flexarm.simulate(amended)["motor.shaft.speed"]).all()
    for name in ("ramp", "slow"):
        before, after = (flexarm.compare(s, name).signals["motor.shaft.speed"].rmse for s in (refitted(found), amended))
        assert after**2 - NOISE**2 < 0.2 * (before**2 - NOISE**2)
    assert found.study.chosen.hold_out - 1 < 0.2 * (found.study.refit.hold_out - 1)
    assert finding["explained"] > 0.8


def curve(found: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Abscissas and heights of the curve that was put in."""
    rows = found.findings[0]["parameters"]
    heights = [rows[f"heights[{k + 1}]"] for k in range(RECOVERY.heights)]
    ends = [(row["low"], row["high"]) for row in heights]
    assert all(row["unit"] == "N.m" for row in heights)
    # Few samples are as fast as an end of the curve: its height may be said to be undetermined.
    assert all(low <= row["value"] <= high for row, (low, high) in zip(heights, ends, strict=True) if low is not None)
    assert all(low is not None for low, _ in ends[1:-1])
    law = put_in(found).system.blocks["found_law"]
    assert law.values["of"] == "speed"
    return np.linspace(law.values["lower"], law.values["upper"], RECOVERY.heights), np.array(
        [row["value"] for row in heights]
    )


def in_its_scale(found: Any) -> Any:
    """Torque is not measured: what is fitted is torque by inertia, so the plant's torques count in the fitted one's."""
    return found.study.chosen.fit.parameters()["motor.rotor_inertia"] / plants.INERTIA


def test_the_curve_of_dry_friction_is_a_step_against_the_motion(sticky: Any) -> None:
    speed, torque = curve(sticky)
    beyond = (np.abs(speed) > 20) & (np.abs(speed) < 140)
    assert beyond.sum() >= RECOVERY.heights // 2
    law = -LEVEL * np.sign(speed[beyond]) * in_its_scale(sticky)
    np.testing.assert_allclose(torque[beyond], law, rtol=0, atol=0.25 * LEVEL)


def test_the_curve_of_a_drag_bends_as_the_drag(slowed: Any) -> None:
    """What is linear in the speed may as well be the motor's; what bends is the drag's alone."""
    speed, torque = curve(slowed)
    law = -DRAG * speed * np.abs(speed) * in_its_scale(slowed)

    speed, torque, law = speed[1:-1], torque[1:-1], law[1:-1]  # few samples are as fast as its ends

    def bent(y: Any) -> Any:
        return y - speed * (speed @ y) / (speed @ speed)

    np.testing.assert_allclose(bent(torque), bent(law), rtol=0, atol=0.15 * np.ptp(bent(law)))


def test_the_curve_reaches_as_far_as_the_recordings(slowed: Any) -> None:
    """Held beyond its ends, a shorter one would have bent the motor's own parameters: they stay in their tolerances."""
    speed = curve(slowed)[0]
    tops = [np.ptp(e.measured) for e in slowed.study.refit.fit.problem.experiments]
    assert np.ptp(speed) > 0.9 * max(tops)
    assert np.abs(slowed.study.chosen.fit.x[:6]).max() < 1
    assert slowed.study.chosen.hold_out < 1.2
