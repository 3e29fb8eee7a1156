"""A run that nearly diverges: its residual is a large number, and nothing is printed."""

import warnings

import numpy as np

from diagnosis.estimation.time_experiment import TimeExperiment


def test_the_residual_of_a_run_near_the_largest_number_is_finite_and_silent() -> None:
    time = np.arange(0.0, 1.0, 0.01)
    made = TimeExperiment(
        name="a",
        role="train",
        time=time,
        step=1e-3,
        every=10,
        drive=None,
        measured=np.zeros((len(time), 1)),
        sigma=np.array([1e-3]),
        from_first=(False,),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r = made.residual(np.full((10 * len(time), 1), 1e307))
    assert np.isfinite(r).all()
    assert (np.abs(r) > 1e300).all()
