"""Amplitudes of simulated sweeps: read where the extremes are, which is seldom at a row."""

from __future__ import annotations

import math

import numpy as np
import pytest

from diagnosis.frequency_response.sine_model import half_range, periodic, settling_time, sine_model
from diagnosis.recordings.mapping import FrequencyTable, from_scenario
from tests.diagnosis.test_orbit import PUSHING, TwoMassesWithPlay, decibels, table
from tests.diagnosis.test_sines import scenario


@pytest.mark.parametrize("shift", np.linspace(0, 1, 9))
def test_a_smooth_extreme_between_two_rows(shift):
    """A parabola through three rows of so coarse a sine is 1e-4 off."""
    rows = np.arange(-3, 52) + shift
    found = half_range(3 * np.cos(2 * np.pi * rows / 48)[:, None] + 7, np.zeros(0))
    assert found == pytest.approx(3, rel=2e-6)


@pytest.mark.parametrize("at", np.linspace(20, 21, 11)[1:-1])
def test_a_corner_between_two_rows_is_read_from_either_side(at):
    """Exact where both sides are parabolas; a curve over the corner is not."""
    t = np.arange(41.0)
    values = 5 - np.where(t < at, 0.3 * (at - t) + 0.002 * (at - t) ** 2, 1.1 * (t - at) - 0.005 * (t - at) ** 2)
    exact = (5 - values.min()) / 2
    assert half_range(values[:, None], np.array([at])) == pytest.approx(exact, rel=1e-12)
    assert half_range(values[:, None], np.zeros(0)) != pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("w", [3.0, 15.0, 30.0])
def test_a_sweep_over_a_contact_is_that_of_exact_propagation(w):
    """At 15 rad/s the speed peaks in a corner that lies between two steps: 6e-4 dB, read at the rows."""
    made, whole = table("srv02-2mass-b3", PUSHING)
    e = whole.rows(np.flatnonzero(whole.frequency == w))
    amplitude, sine, model = float(e.amplitude[0]), e.answers.driven.sine, e.answers.model
    (solution,) = e.answers.solve({}, e.frequency, e.amplitude, {})
    start = np.array([solution.x[0] - solution.x[1], *solution.x[2:]])
    exact = TwoMassesWithPlay({f.name: f.value(0.0) for f in made.free}, w, amplitude).amplitude(start)
    values = {f"{sine}.amplitude": amplitude, f"{sine}.frequency": w / (2 * math.pi)}
    found, settled = periodic(model, values, w, settling_time(model, model.parameter_values, 4.0), None)
    assert settled
    assert abs(decibels(found[0] / exact)) < 1e-4


def test_a_sweep_of_a_motor_behind_a_hold(tmp_path):
    """The hold of 2 ms takes sin(x) / x off the gain; what it adds of harmonics is below 1e-4 dB at 5 rad/s."""
    held = (
        "  hold: {type: Delay, delay: 0 s, period: 2 ms}\n"
        "connect:\n  - [source.out, hold.in]\n  - [hold.out, motor.voltage]\n"
    )
    rows, w = np.array([5.0]), 5.0
    bench = scenario(tmp_path, held, rows, 2.0, rows)
    channels = from_scenario(bench, "table").responses
    driven = sine_model(bench, FrequencyTable("swept", "", "hold.in", rows, 2 * rows, "V", channels))
    values = {f"{driven.sine}.amplitude": 2.0, f"{driven.sine}.frequency": w / (2 * math.pi)}
    found, settled = periodic(driven.model, values, w, 0.5, None)
    emf = 0.69 * 7.68e-3 / 2.6
    exact = 2 * emf / abs(1j * w * 4.606e-7 + 1.26e-6 + emf * 7.68e-3) * np.sinc(w * 1e-3 / math.pi)
    assert settled
    assert abs(decibels(found[0] / exact)) < 1e-4
