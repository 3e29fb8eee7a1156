"""The tolerance on the internal step, as a scenario states it."""

from __future__ import annotations

import warnings

import pytest

import flexarm
from scenarios.load import load

NAME = "quanser-single-link-no-dead-zone"


def test_a_step_too_long_is_noticed_and_names_the_mode() -> None:
    coarse = ["simulate.internal_step=20 ms", "simulate.step=20 ms", "simulate.step_tolerance=1e-5"]
    with pytest.warns(RuntimeWarning, match=r"half the internal step .* fastest mode moves"):
        flexarm.simulate(load(NAME, coarse))


def test_a_fine_step_passes_in_silence() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flexarm.simulate(load(NAME, ["simulate.step_tolerance=1e-5"]))
