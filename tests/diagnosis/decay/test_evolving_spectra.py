"""Evolving spectra against decays of known damping: a table computed independently, and the refusals."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.decay.evolving_spectra import evolving_spectra
from diagnosis.decay.record import DampingWarning
from diagnosis.decay.spectrum import find_lines
from diagnosis.recordings.columns import RecordingError
from engine.errors import ParameterError
from tests.diagnosis.decay.decays import HEAVY, LIGHT, MODES, coulomb, two_modes, viscous


def estimate(
    time: Any,
    values: Any,
    window: float | None = 0.4,
    hop: float | None = 0.05,
    windows: int | None = 6,
    taper: str = "hann",
    frequencies: Any = MODES,
) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DampingWarning)
        return evolving_spectra(time, values, frequencies, window=window, hop=hop, windows=windows, taper=taper)


def ratios(*args: Any, **kwargs: Any) -> NDArray[Any]:
    return np.array([mode.ratio for mode in estimate(*args, **kwargs).modes])


@pytest.mark.parametrize("rate", [1000, 10000])
@pytest.mark.parametrize("window", [0.2, 0.4])
@pytest.mark.parametrize("expected", [LIGHT, HEAVY])
def test_without_noise_the_ratios_come_back_within_one_per_cent(rate: int, window: float, expected: Any) -> None:
    assert ratios(*two_modes(rate, expected), window) == pytest.approx(expected, rel=0.01)


def test_the_hann_rows_of_the_table() -> None:
    assert ratios(*two_modes(10000, LIGHT)) == pytest.approx(LIGHT, rel=5e-3)
    assert ratios(*two_modes(10000, HEAVY)) == pytest.approx(HEAVY, rel=3e-3)


def test_the_rectangular_row_of_the_table() -> None:
    found = estimate(*two_modes(10000, LIGHT), taper="rectangular")
    assert [mode.ratio for mode in found.modes] == pytest.approx(LIGHT, rel=0.015)
    assert max(abs(m.two_point / r - 1) for m, r in zip(found.modes, LIGHT, strict=True)) < 0.045


@pytest.mark.parametrize("window", [0.2, 0.4])
def test_light_damping_with_noise_at_10_khz_within_two_per_cent(window: float) -> None:
    for seed in range(10):
        assert ratios(*two_modes(10000, LIGHT, noise=2e-3, seed=seed), window) == pytest.approx(LIGHT, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "scatter"), [(1000, 0.051), (2000, 0.034), (10000, 0.017)])
def test_a_mode_that_dies_within_the_window_scatters_as_reported(rate: int, scatter: float) -> None:
    found = [estimate(*two_modes(rate, HEAVY, noise=2e-3, seed=seed)).modes[1] for seed in range(50)]
    estimates = np.array([mode.ratio for mode in found])
    spread = estimates.std(ddof=1)
    assert spread / HEAVY[1] == pytest.approx(scatter, rel=0.35)
    assert np.all(np.abs(estimates - HEAVY[1]) < 3 * scatter * HEAVY[1])
    assert abs(estimates.mean() - HEAVY[1]) < 3 * spread / np.sqrt(50)
    # What is reported with one estimate is what repetition shows.
    assert np.median([mode.standard_error for mode in found]) == pytest.approx(spread, rel=0.3)
    assert np.mean([mode.interval[0] < HEAVY[1] < mode.interval[1] for mode in found]) >= 0.85


def test_the_natural_frequency_is_read_from_the_record() -> None:
    for given in ((7.2, 50.0), (8.2, 45.0)):
        found = estimate(*two_modes(2000, LIGHT), frequencies=given)
        assert [mode.frequency for mode in found.modes] == pytest.approx(MODES, rel=2e-4)
        assert [mode.ratio for mode in found.modes] == pytest.approx(LIGHT, rel=5e-3)
    # 19.8 % of damping lowers the frequency by 2 %; the natural one is reported.
    assert estimate(*two_modes(2000, HEAVY)).modes[0].frequency == pytest.approx(MODES[0], rel=2e-3)


@pytest.mark.parametrize("taper", ["hann", "rectangular"])
def test_the_window_of_the_paper_is_warned_of(taper: str) -> None:
    # Tw f_1 = 0.38 < 1.5.
    with pytest.warns(DampingWarning, match=r"window too short: 0\.05 s holds 0\.38 periods"):
        found = evolving_spectra(*two_modes(10000, LIGHT), MODES, window=0.05, hop=0.05, windows=4, taper=taper)
    assert not any(mode.reliable for mode in found.modes)
    assert abs(found.modes[0].ratio / LIGHT[0] - 1) > 0.25
    assert any("too short" in sentence for sentence in found.warnings)


def test_a_sufficient_window_is_not_warned_of() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = evolving_spectra(*two_modes(10000, LIGHT), MODES, window=0.4, hop=0.05, windows=6)
    assert found.warnings == ()
    assert all(mode.reliable for mode in found.modes)


def test_modes_closer_than_the_window_resolves_are_warned_of() -> None:
    time = np.arange(0, 2, 1e-3)
    values = viscous(time, 20, 0.005) + viscous(time, 23, 0.005)
    with pytest.warns(DampingWarning, match="closer than 2 / window"):
        found = evolving_spectra(time, values, (20, 23), window=0.4, hop=0.05, windows=6)
    assert not any(mode.reliable for mode in found.modes)
    found = evolving_spectra(time, values, (20, 23), window=0.9, hop=0.1, windows=8)
    assert [mode.ratio for mode in found.modes] == pytest.approx([0.005, 0.005], rel=0.02)


def test_a_mode_that_dies_within_the_window_is_warned_of() -> None:
    with pytest.warns(DampingWarning, match="dies within the window"):
        evolving_spectra(*two_modes(10000, HEAVY), MODES, window=0.4, hop=0.05, windows=6)


@pytest.mark.filterwarnings("ignore:the mode at .* dies")
def test_windows_lost_in_noise_are_left_out_and_named() -> None:
    with pytest.warns(DampingWarning, match="lost in the noise"):
        found = evolving_spectra(*two_modes(1000, HEAVY, noise=2e-2), MODES, window=0.3, hop=0.05, windows=12)
    assert found.modes[1].used < 12
    assert found.modes[1].interval[0] < HEAVY[1] < found.modes[1].interval[1]


@pytest.mark.parametrize("noise", [0.0, 1e-2])
def test_a_mode_that_does_not_decay_is_refused_by_name(noise: float) -> None:
    time, values = two_modes(1000, (0.0315, 0.0), noise=noise)
    with pytest.raises(RecordingError, match=r"mode at 47\.77 Hz does not decay"):
        estimate(time, values)
    with pytest.raises(RecordingError, match=r"mode at 12 Hz grows"):
        estimate(time, np.exp(0.5 * time) * np.sin(2 * np.pi * 12 * time), frequencies=(12,))


@pytest.mark.parametrize("taper", ["hann", "rectangular"])
@pytest.mark.parametrize("frequency", [14.0, 20.0, 30.0, 90.0])
def test_a_frequency_that_is_not_in_the_record_is_refused(frequency: float, taper: str) -> None:
    with pytest.raises(RecordingError, match="no vibration within 15 %") as error:
        estimate(*two_modes(1000, LIGHT, noise=2e-3), frequencies=(7.6, frequency), taper=taper)
    assert "7.6" in error.value.remedy
    assert "47." in error.value.remedy


def test_settings_that_mean_nothing_are_refused() -> None:
    time, values = two_modes(1000, LIGHT)
    with pytest.raises(RecordingError, match="is not in the record"):
        estimate(time, values, frequencies=(470,))
    with pytest.raises(RecordingError, match="the record lasts 1 s"):
        estimate(time, values, windows=60)
    with pytest.raises(RecordingError, match="the record lasts 1 s"):
        estimate(time, values, window=2.0)
    with pytest.raises(ParameterError, match="unknown taper"):
        estimate(time, values, taper="kaiser")
    with pytest.raises(ParameterError, match="at least two windows"):
        estimate(time, values, windows=1)
    with pytest.raises(ParameterError, match="shorter than the sampling interval"):
        estimate(time, values, hop=0.0)
    for start in (1.0, -0.1, np.inf):
        with pytest.raises(ParameterError, match="outside the record"):
            evolving_spectra(time, values, MODES, start=start)
    with pytest.raises(ParameterError, match="rest"):
        evolving_spectra(time, values, MODES, rest=np.inf)
    with pytest.raises(ParameterError, match="take longer hops"):
        evolving_spectra(*two_modes(10000, LIGHT, 10.0), MODES, window=0.4, hop=1e-4)
    with pytest.raises(ParameterError, match="twice"):
        estimate(time, values, frequencies=(7.6, 7.6))


def test_lines_and_windows_are_found_when_not_given() -> None:
    time, values = two_modes(2000, LIGHT, duration=2.0, noise=2e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DampingWarning)
        found = evolving_spectra(time, values + 3.0)
    assert [mode.given for mode in found.modes] == pytest.approx(MODES, rel=0.02)
    assert [mode.ratio for mode in found.modes] == pytest.approx(LIGHT, rel=0.02)
    assert found.rest == pytest.approx(3.0, abs=2e-3)
    with pytest.raises(RecordingError, match="no vibration"):
        evolving_spectra(time, np.exp(-time))


def test_a_long_record_is_covered_by_a_bounded_number_of_windows() -> None:
    time = np.arange(0, 300, 5e-3)
    found = estimate(time, viscous(time, 5.0, 1e-4), window=None, hop=None, windows=None, frequencies=(5,))
    assert len(found.times) <= 401
    assert found.times[-1] > 295
    assert found.modes[0].ratio == pytest.approx(1e-4, rel=1e-3)


def test_amplitudes_are_those_of_the_signal() -> None:
    # A sine of 0.7, slowly damped: the window shows its middle. The padded bins miss the maximum by 0.3 % at most.
    time = np.arange(0, 4, 1e-3)
    found = estimate(time, viscous(time, 15, 2e-4, 0.7), window=0.5, hop=0.25, windows=8, frequencies=(15,))
    assert found.modes[0].amplitudes[0] == pytest.approx(0.7 * np.exp(-2e-4 * 2 * np.pi * 15 * 0.25), rel=3e-3)
    assert found.modes[0].ratio == pytest.approx(2e-4, rel=0.01)


def test_dry_friction_shows_in_the_windows_too() -> None:
    time = np.arange(0, 8, 1e-3)
    found = estimate(time, coulomb(time, 5.0, 1.0, 0.005), window=0.6, hop=0.2, windows=30, frequencies=(5,))
    assert found.modes[0].envelopes.verdict == "coulomb"
    assert found.modes[0].envelopes.loss_per_cycle[0] == pytest.approx(0.02, rel=0.03)


def test_lines_of_a_decay() -> None:
    from diagnosis.decay.record import decay_record

    assert find_lines(decay_record(*two_modes(1000, LIGHT, duration=2.0))) == pytest.approx(MODES, rel=0.01)
