"""One periodic solver for compare and diagnose, models that it must wait for, and extremes between rows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.compare import compare
from diagnosis.frequency_response.extremes import half_range
from diagnosis.frequency_response.table_experiment import TableExperiment
from diagnosis.problems import problem
from engine.errors import FlexarmError
from scenarios.load import load
from tests.diagnosis.frequency_response.test_periodic_solver import PUSHING, decibels
from tests.diagnosis.frequency_response.test_table_experiment import MOTOR, STUCK, scenario, sticking_motor

SPEED = "motor.shaft.speed"


@pytest.mark.parametrize("shift", np.linspace(0, 1, 9))
def test_a_smooth_extreme_between_two_rows(shift: Any) -> None:
    """A parabola through three rows of so coarse a sine is 1e-4 off."""
    rows = np.arange(-3, 52) + shift
    found = half_range(3 * np.cos(2 * np.pi * rows / 48)[:, None] + 7, np.zeros(0))
    assert found == pytest.approx(3, rel=2e-6)


@pytest.mark.parametrize("at", np.linspace(20, 21, 11)[1:-1])
def test_a_corner_between_two_rows_is_read_from_either_side(at: Any) -> None:
    """Exact where both sides are parabolas; a curve over the corner is not."""
    t = np.arange(41.0)
    values = 5 - np.where(t < at, 0.3 * (at - t) + 0.002 * (at - t) ** 2, 1.1 * (t - at) - 0.005 * (t - at) ** 2)
    exact = (5 - values.min()) / 2
    assert half_range(values[:, None], np.array([at])) == pytest.approx(exact, rel=1e-12)
    assert half_range(values[:, None], np.zeros(0)) != pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "overrides"),
    [("srv02-bare", []), ("srv02-2mass-b3", []), ("srv02-2mass-b3", PUSHING), ("srv02-backlash", [])],
)
def test_compare_and_the_problem_of_diagnose_simulate_one_table_alike(name: str, overrides: Any) -> None:
    bench = load(name, overrides)
    (recording,) = gather(bench, (), ())
    error = compare(bench, recording).signals[SPEED]
    count = 0
    for e in problem(bench, [recording]).experiments:
        assert isinstance(e, TableExperiment)
        amplitudes = [s.amplitudes[0] for s in e.solved({}, {})]
        rows = np.searchsorted(error.axis, e.frequency)
        np.testing.assert_array_equal(error.simulated[rows], amplitudes)
        count += len(amplitudes)
    assert count == len(error.axis)


def test_progress_of_a_comparison_ends_at_one() -> None:
    told: list[float] = []
    compare(load("srv02-bare"), "table_2_2", progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_motor_behind_a_hold(tmp_path: Path) -> None:
    """The hold of 2 ms takes sin(x) / x off the gain; the harmonics that it adds are below 1e-4 dB at 5 rad/s."""
    held = (
        "  hold: {type: Delay, delay: 0 s, period: 2 ms}\n"
        "connect:\n  - [source.out, hold.in]\n  - [hold.out, motor.voltage]\n"
    )
    w = np.array([5.0])
    bench = scenario(tmp_path, held, w, 2.0, w)
    bench = load(bench.path, ["recordings.table.drive=hold.in"])
    comparison = compare(bench, "table")
    emf = MOTOR["eta"] * MOTOR["k"] / MOTOR["R"]
    gain = emf / abs(1j * w[0] * MOTOR["J"] + MOTOR["B"] + emf * MOTOR["k"])
    exact = 2 * gain * np.sinc(w[0] * 1e-3 / math.pi)
    assert not comparison.notes
    assert abs(decibels(comparison.signals[SPEED].simulated[0] / exact)) < 1e-4


LOADED = STUCK.replace(
    "connect:", "  bias: {type: %s}\n  push: {type: Torque}\nconnect:\n  - [bias.out, push.torque]"
).replace("friction.shaft]", "friction.shaft, push.shaft]")


def test_a_load_that_comes_later_acts_in_the_response(tmp_path: Path) -> None:
    """The response with a load torque from 0.3 s on becomes that with the same torque from the beginning."""
    w, found = np.array([12.0, 30.0]), []
    for bias in ("Constant, value: 3e-4 N.m", "Step, height: 3e-4 N.m, start: 0.3 s"):
        bench = scenario(tmp_path, LOADED % bias, w, 0.3, w)
        comparison = compare(bench, "table")
        assert not comparison.notes
        found.append(comparison.signals[SPEED].simulated)
    assert np.abs(decibels(found[1] / found[0])).max() < 2e-3
    unloaded = [sticking_motor(x, 0.3) for x in w]
    assert np.abs(decibels(found[1] / unloaded)).min() > 0.05


def test_an_output_that_depends_on_time_is_no_closed_form(tmp_path: Path) -> None:
    """A linear motor's speed beside a second harmonic, against the sum of both."""
    w = np.array([12.0])
    body = (
        f"  other: {{type: Sine, amplitude: 20 rad/s, frequency: {float(w[0]) / math.pi!r} Hz}}\n  sum: {{type: Sum}}\n"
        "connect:\n  - [source.out, motor.voltage]\n  - [motor.shaft.speed, sum.a]\n  - [other.out, sum.b]\n"
    )
    bench = scenario(tmp_path, body, w, 0.3, w)
    text = bench.path.read_text().replace("      motor.shaft.speed:", "      sum.out:")
    comparison = compare(load(bench.path, text=text), "table")
    emf = MOTOR["eta"] * MOTOR["k"] / MOTOR["R"]
    gain = 0.3 * emf / (1j * w[0] * MOTOR["J"] + MOTOR["B"] + emf * MOTOR["k"])
    t = np.linspace(0, 2 * math.pi, 100_001)
    exact = np.ptp(np.abs(gain) * np.sin(t + np.angle(gain)) + 20 * np.sin(2 * t)) / 2
    assert not comparison.notes
    assert comparison.signals["sum.out"].simulated == pytest.approx(exact, rel=2e-4)


def test_a_response_that_never_repeats_is_noted(tmp_path: Path) -> None:
    """A second sine at an irrational ratio beats with the first."""
    w = np.array([12.0])
    bias = f"Sine, amplitude: 2e-4 N.m, frequency: {12 * math.sqrt(0.003) / (2 * math.pi):.9g} Hz"
    bench = scenario(tmp_path, LOADED % bias, w, 0.3, w)
    (note,) = compare(bench, "table").notes
    assert note.startswith("at 12 rad/s the simulated response did not become periodic")


UNDAMPED = """\
schema: 1
name: pendulum
blocks:
  push: {type: Torque}
  arm: {type: Inertia, inertia: 1 kg.m2}
  spring: {type: GroundSpring, stiffness: 1 N.m/rad}
connect: [[push.shaft, arm.shaft, spring.shaft]]
recordings:
  table:
    kind: frequency_response
    file: table.csv
    drive: push.torque
    frequency: {column: w, unit: rad/s}
    amplitude: {value: 1, unit: N.m}
    response:
      arm.shaft.angle: {column: y, unit: rad}
"""


def test_a_row_at_an_undamped_resonance_is_refused(tmp_path: Path) -> None:
    """(iw - A) is singular at 1 rad/s; below it the answer is 1 / (1 - w^2)."""
    (tmp_path / "s.yaml").write_text(UNDAMPED)
    (tmp_path / "table.csv").write_text("w,y\n1.0,1\n")
    with pytest.raises(FlexarmError, match="resonates without damping at 1 rad/s"):
        compare(load(tmp_path / "s.yaml"), "table")
    (tmp_path / "table.csv").write_text("w,y\n0.5,1\n")
    error = compare(load(tmp_path / "s.yaml"), "table").signals["arm.shaft.angle"]
    assert error.simulated == pytest.approx(1 / 0.75, rel=1e-12)
