"""Tones: what has one frequency in all recordings, beside what leaves more power over a band."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.estimation.tones import tones
from diagnosis.thresholds import NOISE

TONE = 2 * math.pi * 2.7975


def recorded(name: str, seconds: float, interval: float, *, uneven: bool = False) -> TimeExperiment:
    time = np.arange(0.0, seconds, interval)
    if uneven:
        time[1:] += 0.2 * interval * np.random.default_rng(1).uniform(-1, 1, len(time) - 1)
    return TimeExperiment(
        name=name,
        role="train",
        time=time,
        step=interval,
        every=1,
        drive=None,
        measured=np.zeros((len(time), 2)),
        sigma=np.ones(2),
        from_first=(False, False),
        uneven=uneven,
    )


def residual(e: TimeExperiment, seed: int, amplitude: float) -> np.ndarray:
    """Noise; in the first signal a resonance near 50 Hz that rings all the time, in the second a slow tone."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((len(e.time), 2))
    turn = 2 * math.pi * 50 * (e.time[-1] / (len(e.time) - 1))
    rows[:, 0] += lfilter([3.0], [1.0, -2 * 0.99 * math.cos(turn), 0.99**2], rng.standard_normal(len(e.time)))
    rows[:, 1] += amplitude * np.sin(TONE * e.time + seed)
    return rows


@pytest.mark.parametrize("uneven", [False, True])
def test_a_tone_stands_out_of_a_resonance_with_more_power(uneven: bool) -> None:
    """Recordings of other lengths and rates agree about it, to a tenth of the longest one's line."""
    experiments = [recorded("a", 5.9, 1e-3, uneven=uneven), recorded("b", 4.1, 2e-3)]
    left = {e.name: residual(e, seed, 0.3) for seed, e in enumerate(experiments)}
    assert np.var(left["a"][:, 0]) > 100 * np.var(left["a"][:, 1])
    found = tones(experiments, left, 3)
    assert found[0] == pytest.approx(TONE, abs=0.1 * 2 * math.pi / 5.9)
    assert len(found) == 3


def test_nothing_is_said_of_recordings_that_are_too_short() -> None:
    e = recorded("a", 1e-3 * (NOISE.fewest - 1), 1e-3)
    assert tones([e], {"a": residual(e, 0, 1.0)}, 3) == []


def test_a_drift_and_silence_are_no_tones() -> None:
    e = recorded("a", 4.0, 1e-2)
    drift = np.column_stack([e.time, e.time**2])
    assert all(w > 2 * 2 * math.pi / 4.0 for w in tones([e], {"a": drift}, 3))
    assert tones([e], {"a": np.zeros((len(e.time), 2))}, 3) == []
