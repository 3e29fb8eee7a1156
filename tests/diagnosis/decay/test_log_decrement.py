"""Logarithmic decrement: exact on closed forms, honest about scatter; dry friction is told from viscous damping."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.decay.log_decrement import decrement_of, logarithmic_decrement, ratio_of
from diagnosis.decay.record import DampingWarning
from diagnosis.recordings.columns import RecordingError
from engine.errors import ParameterError
from tests.diagnosis.decay.decays import coulomb, viscous

FREQUENCY = 0.96  # Hz, the pendulum of [Mohan 2010, Table 1]


@pytest.fixture
def quiet() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DampingWarning)
        yield


@pytest.mark.parametrize("ratio", [0.0142, 0.05, 0.1, 0.2, 0.35])
def test_the_exact_form_returns_the_ratio_of_a_damped_cosine(ratio: float, quiet: Any) -> None:
    time = np.arange(0, 40, 1e-3)
    found = logarithmic_decrement(time, viscous(time, FREQUENCY, ratio))
    assert found.ratio == pytest.approx(ratio, rel=1e-5)
    assert found.two_point == pytest.approx(ratio, rel=1e-5)
    assert found.natural_frequency == pytest.approx(FREQUENCY, rel=1e-5)
    assert found.frequency == pytest.approx(FREQUENCY * np.sqrt(1 - ratio**2), rel=1e-5)
    assert found.rest == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("ratio", [0.0142, 0.05, 0.1])
def test_the_sampling_interval_hardly_matters(ratio: float) -> None:
    time = np.arange(0, 40, 1e-2)
    assert logarithmic_decrement(time, viscous(time, FREQUENCY, ratio, phase=0.7)).ratio == pytest.approx(
        ratio, rel=1e-5
    )


@pytest.mark.parametrize(
    ("ratio", "printed", "digits"), [(0.0142, 0.014201, 6), (0.05, 0.0501, 4), (0.1, 0.1005, 4), (0.2, 0.204, 3)]
)
def test_the_form_of_the_paper_is_high_by_half_the_square(
    ratio: float, printed: float, digits: int, quiet: Any
) -> None:
    time = np.arange(0, 40, 1e-3)
    found = logarithmic_decrement(time, viscous(time, FREQUENCY, ratio))
    assert round(found.approximate, digits) == printed
    assert found.approximate / found.ratio - 1 == pytest.approx(1 / np.sqrt(1 - ratio**2) - 1, rel=1e-3, abs=2e-5)


def test_decrement_and_ratio_are_inverse() -> None:
    for ratio in (1e-6, 0.0142, 0.352, 0.9):
        assert ratio_of(decrement_of(ratio)) == pytest.approx(ratio, rel=1e-14)
    assert decrement_of(0.0142) == pytest.approx(2 * np.pi * 0.0142 / np.sqrt(1 - 0.0142**2), rel=1e-14)


def test_an_offset_and_the_sign_of_the_peaks_do_not_matter() -> None:
    time = np.arange(0, 20, 1e-3)
    values = viscous(time, FREQUENCY, 0.03) + 7.5
    for sign in (1, -1):
        found = logarithmic_decrement(time, values, sign=sign)
        assert found.ratio == pytest.approx(0.03, rel=1e-4)
        assert found.rest == pytest.approx(7.5, abs=1e-5)


def test_the_reported_error_is_the_scatter_over_seeds() -> None:
    time = np.arange(0, 20, 2e-3)
    clean = viscous(time, FREQUENCY, 0.0142)
    found = [
        logarithmic_decrement(time, clean + 0.01 * np.random.default_rng(seed).standard_normal(len(time)))
        for seed in range(40)
    ]
    ratios = np.array([f.ratio for f in found])
    scatter = ratios.std(ddof=1)
    assert abs(ratios.mean() - 0.0142) < 3 * scatter / np.sqrt(40) + 1e-6
    assert 0.6 < np.median([f.standard_error for f in found]) / scatter < 1.7
    assert np.mean([f.interval[0] < 0.0142 < f.interval[1] for f in found]) >= 0.85
    assert np.median([f.noise for f in found]) == pytest.approx(0.01, rel=0.1)


def test_the_pendulum_of_the_paper_returns_its_ratio() -> None:
    # Release from 7 deg with kappa = 1.242e-3 N.m.s/rad.
    mass, length, hub, gravity, kappa = 0.5455 * 0.33, 0.33, 2.95e-5, 9.81, 1.242e-3
    inertia = mass * length**2 / 3 + hub
    time = np.arange(0, 12, 2e-3)
    swing = solve_ivp(
        lambda _, y: [y[1], -(kappa * y[1] + mass * gravity * length / 2 * np.sin(y[0])) / inertia],
        (0, 12),
        [np.deg2rad(7), 0],
        t_eval=time,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    found = logarithmic_decrement(time, swing)
    assert found.ratio == pytest.approx(0.0142, abs=1e-4)
    assert found.frequency == pytest.approx(1.0598, rel=2e-3)
    assert found.peaks[1] / found.peaks[0] == pytest.approx(0.9145, rel=2e-3)
    envelopes = found.envelopes
    assert envelopes is not None
    assert envelopes.verdict == "viscous"


def test_dry_friction_is_recognised_by_its_constant_loss() -> None:
    time = np.arange(0, 20, 1e-3)
    with pytest.warns(DampingWarning, match="Coulomb"):
        found = logarithmic_decrement(time, coulomb(time, FREQUENCY, 1.0, 0.01))
    envelopes = found.envelopes
    assert envelopes is not None
    assert envelopes.verdict == "coulomb"
    # 4 F / k per cycle.
    assert envelopes.loss_per_cycle == pytest.approx((0.04, 0.04), rel=1e-2)
    assert envelopes.fit("coulomb").loss == pytest.approx(0.04 * FREQUENCY, rel=1e-2)
    assert envelopes.fit("coulomb").rms < 0.05 * envelopes.fit("viscous").rms


def test_viscous_decay_is_not_mistaken_for_dry_friction() -> None:
    time = np.arange(0, 20, 1e-3)
    noise = 2e-3 * np.random.default_rng(4).standard_normal(len(time))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = logarithmic_decrement(time, viscous(time, FREQUENCY, 0.0142) + noise)
    envelopes = found.envelopes
    assert envelopes is not None
    assert envelopes.verdict == "viscous"
    assert envelopes.fit("viscous").rate == pytest.approx(0.0142 * 2 * np.pi * FREQUENCY, rel=0.01)
    assert "exponentially" in envelopes.sentence


@pytest.mark.parametrize(("law", "force"), [("drag", (0.0, 1.0)), ("viscous and coulomb", (0.001, 0.0))])
def test_drag_and_mixed_friction_are_told_apart(law: str, force: tuple[float, float]) -> None:
    dry, square = force
    w, linear = 2 * np.pi * FREQUENCY, 0.0 if law == "drag" else 0.01
    time = np.arange(0, 15, 2e-3)
    values = solve_ivp(
        lambda _, y: [
            y[1],
            -(w**2) * (y[0] + dry * np.tanh(y[1] / 1e-4)) - 2 * linear * w * y[1] - square * y[1] * abs(y[1]),
        ],
        (0, 15),
        [0.12, 0],
        t_eval=time,
        method="LSODA",
        rtol=1e-8,
        atol=1e-10,
    ).y[0]
    with pytest.warns(DampingWarning):
        found = logarithmic_decrement(time, values)
    envelopes = found.envelopes
    assert envelopes is not None
    assert envelopes.verdict == law
    if law == "drag":
        # The energy lost per cycle, 8/3 c w^2 A^3, gives A' = -4/(3 pi) c w A^2 and so b = 4 c w A0 / (3 pi).
        assert envelopes.fit("drag").rate == pytest.approx(4 * square * w * 0.12 / (3 * np.pi), rel=0.03)
    else:
        fit = envelopes.fit(law)
        assert fit.rate == pytest.approx(linear * w, rel=0.05)
        assert fit.loss == pytest.approx(4 * dry * FREQUENCY, rel=0.05)


def test_a_swing_that_does_not_decay_is_refused() -> None:
    time = np.arange(0, 20, 1e-3)
    with pytest.raises(RecordingError, match="does not decay"):
        logarithmic_decrement(time, np.cos(6 * time))
    noise = 1e-2 * np.random.default_rng(2).standard_normal(len(time))
    with pytest.raises(RecordingError, match="does not decay"):
        logarithmic_decrement(time, np.cos(6 * time) + noise)
    with pytest.raises(RecordingError, match="grows"):
        logarithmic_decrement(time, np.exp(0.095 * time) * np.cos(6.66 * time))


def test_records_that_hold_no_decay_name_the_cause() -> None:
    time = np.arange(0, 20, 1e-2)
    with pytest.raises(RecordingError, match=r"0 peaks|1 peak"):
        logarithmic_decrement(time, np.exp(-time))
    with pytest.raises(ParameterError, match="half the sampling rate"):
        logarithmic_decrement(time, np.cos(time), frequency=80.0)
    for start in (30.0, -1.0, np.inf, np.nan):
        with pytest.raises(ParameterError, match="outside the record"):
            logarithmic_decrement(time, np.cos(time), start=start)
    with pytest.raises(ParameterError, match="rest"):
        logarithmic_decrement(time, np.cos(time), rest=np.nan)
    with pytest.raises(RecordingError, match="constant"):
        logarithmic_decrement(time, np.ones_like(time))
    with pytest.raises(RecordingError, match="gap"):
        logarithmic_decrement(np.delete(time, slice(500, 600)), np.delete(np.cos(time), slice(500, 600)))
    with pytest.raises(RecordingError, match="not finite"):
        logarithmic_decrement(time, np.where(time == 0, np.nan, np.cos(time)))


def test_pure_noise_is_no_decay() -> None:
    time = np.arange(0, 20, 1e-2)
    for seed in range(5):
        with pytest.raises(RecordingError):
            logarithmic_decrement(time, np.random.default_rng(seed).standard_normal(len(time)))


def test_two_peaks_alone_are_warned_of() -> None:
    time = np.arange(0, 2.2, 1e-3)
    with pytest.warns(DampingWarning, match="two peaks only"):
        found = logarithmic_decrement(time, viscous(time, FREQUENCY, 0.1, phase=-1.0))
    assert found.ratio == pytest.approx(0.1, rel=1e-3)


def test_uneven_sampling_is_interpolated() -> None:
    steps = 1e-3 * (1 + 0.3 * np.random.default_rng(0).uniform(-1, 1, 20000))
    time = np.cumsum(steps)
    found = logarithmic_decrement(time, viscous(time, FREQUENCY, 0.02))
    assert found.ratio == pytest.approx(0.02, rel=1e-4)
