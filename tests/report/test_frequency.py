"""Figures of linear models, held against python-control and against what a first-order lag must show."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest

import flexarm
from engine.linearise import LinearModel
from flexarm.plotting.axes import degrees, phase
from flexarm.plotting.frequency import _title, frequencies, plot_linear, responses


def _lag(corner: float = 3.0) -> LinearModel:
    return LinearModel(
        np.array([[-corner]]),
        np.array([[corner]]),
        np.array([[1.0]]),
        np.array([[0.0]]),
        ("x",),
        ("u",),
        ("y",),
        {"u": "V", "y": "rad/s"},
        {"joint": "stuck"},
        {},
        0.0,
    )


def test_a_lag_falls_by_three_decibel_and_45_degrees_at_its_corner() -> None:
    (row,) = responses(_lag())
    at = np.interp(3.0, row.frequency, row.decibel), np.interp(3.0, row.frequency, row.degrees)
    assert at[0] == pytest.approx(-20 * np.log10(np.sqrt(2)), abs=0.01)
    assert at[1] == pytest.approx(-45, abs=0.1)
    assert row.unit == "rad/s/V"
    assert row.frequency[0] == pytest.approx(0.3)
    assert row.frequency[-1] == pytest.approx(30)


def test_responses_are_those_of_python_control() -> None:
    linear = flexarm.linearise("lumped-arm-pulse", "slipping")
    rows = responses(linear)
    system = control.ss(linear.A, linear.B, linear.C, linear.D)
    expected = system(1j * rows[0].frequency, squeeze=False)
    for row in rows:
        i, j = linear.outputs.index(row.output), linear.inputs.index(row.input)
        assert np.allclose(row.gain, expected[i, j], rtol=1e-6, atol=1e-12)
        assert np.abs(np.diff(row.degrees)).max() <= 180


def test_a_lightly_damped_resonance_is_drawn_to_its_height() -> None:
    omega, zeta = 50.0, 2e-3
    A = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
    linear = LinearModel(
        A, np.array([[0.0], [omega**2]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)),
        ("x", "v"), ("u",), ("y",), {}, {}, {}, 0.0,
    )  # fmt: skip
    (row,) = responses(linear)
    assert row.decibel.max() == pytest.approx(20 * np.log10(1 / (2 * zeta)), abs=0.1)


def test_frequencies_exist_without_poles_or_zeros() -> None:
    linear = LinearModel(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), (), ("u",), ("y",), {}, {}, {}, 0.0
    )
    assert len(frequencies(linear)) > 100


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_figures_are_written_by_suffix(suffix: str, tmp_path: Path) -> None:
    path = plot_linear(_lag(), tmp_path / f"a{suffix}", "lag")
    assert path.read_bytes()[:5].startswith({".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix])


def test_the_title_says_which_mode_was_linearised() -> None:
    assert "joint stuck" in _title(_lag(), "arm")


def test_a_stuck_joint_leaves_poles_to_draw(tmp_path: Path) -> None:
    linear = flexarm.linearise("lumped-arm-pulse", "stuck")
    assert responses(linear) == []
    assert plot_linear(linear, tmp_path / "a.png", "stuck").stat().st_size > 5000


@pytest.mark.parametrize(
    ("gain", "power", "start"),
    [
        (1.0, -2, -180.0),
        (1.0, -1, -90.0),
        (1.0, 0, 0.0),
        (1.0, 1, 90.0),
        (1.0, 2, 180.0),
        (1.0, -3, -270.0),
        (-1.0, 0, -180.0),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_phases_begin_where_the_slope_asks_for(gain: float, power: int, start: float, sign: float) -> None:
    """k s^n: 90 n degrees; rounding puts half a turn on either side of the cut of the logarithm."""
    omega = np.geomspace(0.1, 10, 50)
    answer = gain * (1j * omega) ** power
    if abs(start) == 180:
        answer = answer.real + sign * 1e-15j * np.abs(answer)
    np.testing.assert_allclose(phase(answer, omega), start, atol=1e-6)


@pytest.mark.parametrize("first", [0.5, 0.9, 0.97, 0.995, 1.005, 1.03, 1.1, 2.0])
def test_a_phase_that_begins_near_a_resonance_is_not_turned(first: float) -> None:
    """1 / (1 + 2 z j w - w^2), in closed form from 0 to -180 degrees; the gain is as steep as it likes there."""
    omega = first * np.geomspace(1, 10, 400)
    expected = -np.degrees(np.arctan2(2 * 0.005 * omega, 1 - omega**2))
    np.testing.assert_allclose(phase(1 / (1 + 0.01j * omega - omega**2), omega), expected, atol=1e-6)


@pytest.mark.parametrize("spread", [0.0, 4.0, 20.0, 60.0, 100.0, 250.0, 500.0, 1500.0])
def test_an_axis_in_degrees_has_two_ticks_or_more(spread: float) -> None:
    from matplotlib.figure import Figure

    axis = Figure().add_subplot()
    axis.plot([0.0, 1.0], [-93.0 - spread, -93.0])
    degrees(axis.yaxis, -93.0 - spread, -93.0)
    low, high = axis.get_ylim()
    shown = [tick for tick in axis.get_yticks() if low <= tick <= high]
    assert 2 <= len(shown) <= 9
