"""The noise of a signal, against noise that was put in."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.recordings.noise import about_neighbours, noise, period, spikes

RANDOM = np.random.default_rng(7)


def test_noise_where_the_signal_moves_fast_between_samples() -> None:
    """Second differences take the resonance for noise; here they are a hundred times too large."""
    t = np.arange(8000.0)
    sine = np.sin(2 * np.pi * t / 8) + RANDOM.normal(0, 1e-3, 8000)
    assert np.std(np.diff(sine, 2)) / np.sqrt(6) > 100e-3
    found = noise(t, sine)
    assert found.source == "between samples"
    assert found.sigma == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("order", [2, 4, 8])
def test_white_noise_keeps_its_size_at_every_order_and_polynomials_vanish(order: int) -> None:
    t = np.sort(RANDOM.uniform(0, 100, 4000))
    assert about_neighbours(t, RANDOM.normal(0, 2.0, 4000), order).std() == pytest.approx(2.0, rel=0.1)
    even = np.arange(4000.0)
    assert about_neighbours(even, RANDOM.normal(0, 2.0, 4000), order).std() == pytest.approx(2.0, rel=0.1)
    assert np.abs(about_neighbours(t, (t / 100) ** (order - 1), order)).max() < 1e-9


def test_jitter_of_the_clock_is_not_noise_of_the_signal() -> None:
    t = np.float64(1e-3) * np.arange(4000) + RANDOM.uniform(-2e-4, 2e-4, 4000)
    y = 10 * np.sin(2 * np.pi * 5 * t) + RANDOM.normal(0, 1e-3, 4000)
    assert noise(t, y).sigma == pytest.approx(1e-3, rel=0.1)


def test_noise_at_rest_counts_where_the_machine_rests() -> None:
    """A hum while it moves is not the sensor's noise; the stretch before the step is."""
    t = np.float64(1e-3) * np.arange(3000)
    u = np.where(t < 0.5, 0.0, np.sin(9 * t))
    y = np.where(t < 0.5, 0.0, np.cumsum(u) * 1e-2) + RANDOM.normal(0, 1e-3, 3000)
    y += np.where(t < 0.5, 0.0, 0.02 * RANDOM.normal(0, 1, 3000))
    found = noise(t, y, [u])
    assert found.source == "at rest"
    assert found.sigma == pytest.approx(1e-3, rel=0.15)
    assert found.logged > 10 * found.sigma


def test_noise_between_periods() -> None:
    """Six periods of a multisine whose lines reach the Nyquist frequency: only repetition tells noise from signal."""
    lines = np.zeros(513, dtype=complex)
    lines[1:500] = np.exp(2j * np.pi * RANDOM.uniform(size=499))
    u = np.tile(np.fft.irfft(lines), 6)
    y = np.real(u) + RANDOM.normal(0, 2e-4, len(u))
    assert period([u]) == 1024
    found = noise(np.arange(float(len(u))), y, [u])
    assert found.source == "repeated periods"
    assert found.sigma == pytest.approx(2e-4, rel=0.1)
    assert period([np.sin(np.arange(1000) ** 1.5)]) == 0


def test_the_quantum_is_kept() -> None:
    t = np.arange(2000.0)
    found = noise(t, 0.25 * np.round(np.sin(t / 300) * 40))
    assert found.source == "quantum"
    assert found.sigma == pytest.approx(0.25 / np.sqrt(12))
    assert found.quantum == pytest.approx(0.25)


def test_spikes_are_found_and_nothing_else() -> None:
    t = np.float64(5e-3) * np.arange(1000)
    smooth = 300 * np.sin(3 * t) + RANDOM.normal(0, 0.3, 1000)
    where = np.sort(RANDOM.choice(np.arange(10, 990, 7), 20, replace=False))
    spoilt = smooth.copy()
    spoilt[where] += RANDOM.choice([-1, 1], 20) * RANDOM.uniform(20, 200, 20)
    sigma = noise(t, spoilt).sigma
    assert sigma == pytest.approx(0.3, rel=0.25)
    np.testing.assert_array_equal(np.flatnonzero(spikes(t, spoilt, sigma)), where)
    assert not spikes(t, smooth, sigma).any()


@pytest.mark.parametrize("shape", ["square", "triangle", "staircase", "bounce", "few samples a swing"])
def test_edges_and_kinks_are_no_spikes(shape: str) -> None:
    t = np.float64(1e-3) * np.arange(4000)
    clean = {
        "square": np.sign(np.sin(20 * t)),
        "triangle": np.abs((t * 3) % 2 - 1),
        "staircase": np.round(5 * np.sin(4 * t)),
        "bounce": np.abs(np.sin(60 * t)),
        "few samples a swing": np.abs(np.sin(390 * t)) * (1 + 0.3 * np.sin(t)),
    }[shape]
    y = clean + RANDOM.normal(0, 1e-4, 4000)
    assert not spikes(t, y, noise(t, y).sigma).any()


def test_most_of_a_signal_is_no_spike() -> None:
    """A motion without noise wears a zigzag of every third sample: what it does, and no outliers."""
    time = np.float64(1e-3) * np.arange(101)
    values = np.sin(20 * time)
    values[2::3] += 1e-9
    assert not spikes(time, values, 1e-13).any()
    zigzag = values.copy()
    zigzag[::2] += 1e-6
    assert not spikes(time, zigzag, 1e-13).any()
