"""Figures of linear models, held against python-control and against what a first-order lag must show."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest

import flexarm
from engine.linearise import LinearModel
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
