"""What a residual's spectrum says where the instants are uneven: the frequency that was put in."""

import math

import numpy as np
import pytest

from diagnosis.estimation.time_experiment import TimeExperiment

FREQUENCY = 3.0
"""Of the residual (Hz)."""


def recorded(time: np.ndarray, *, uneven: bool) -> tuple[TimeExperiment, np.ndarray]:
    """An experiment at these instants, and a sine of the residual."""
    r = np.sin(2 * math.pi * FREQUENCY * time)[:, None]
    made = TimeExperiment(
        name="a",
        role="train",
        time=time,
        step=1e-3,
        every=10,
        drive=None,
        measured=r,
        sigma=np.ones(1),
        from_first=(False,),
        uneven=uneven,
    )
    return made, r


def instants() -> np.ndarray:
    """Four seconds of samples whose rate doubles half-way: the first interval is twice the last."""
    return np.concatenate([np.arange(0.0, 2.0, 0.02), np.arange(2.0, 4.0, 0.01)])


@pytest.mark.parametrize("uneven", [False, True])
def test_the_strongest_frequency_is_that_of_the_residual(uneven: bool) -> None:
    time = instants() if uneven else np.arange(0.0, 4.0, 0.01)
    made, r = recorded(time, uneven=uneven)
    when, frequency = made.where_residual_is_large(r, ["speed"])
    assert frequency.startswith("strongest at ")
    assert float(frequency.split()[2]) == pytest.approx(FREQUENCY, rel=0.02)
    assert f"of {4.0:.2g} s" in when


@pytest.mark.parametrize("uneven", [False, True])
def test_the_first_line_is_that_of_the_residual(uneven: bool) -> None:
    time = instants() if uneven else np.arange(0.0, 4.0, 0.01)
    made, r = recorded(time, uneven=uneven)
    lines = made.lines(r, 3)
    assert max(lines, key=lambda w: lines[w]) == pytest.approx(2 * math.pi * FREQUENCY, rel=0.02)
