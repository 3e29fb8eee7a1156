"""Sizes that are only chosen: parameters that follow tangents end where a fit of each value ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.least_squares import descend
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nearby import Nearby
from diagnosis.search.partial_fit import standing
from engine.threads import Threads
from scenarios.load import load
from tests.diagnosis.plants import case


def test_what_delays_leave_is_told_without_tangents_of_their_own(tmp_path: Path) -> None:
    """Each delay is fitted in full as well: they rank alike, and what they leave is told to two per cent."""
    scenario = load(case(tmp_path, seed=4))
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    delay = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "delay")
    known, *others = (fitter.build((delay,), ({"delay": wait},)) for wait in (0.001, 0.0002, 0.0005, 0.0015, 0.002))
    told, fitted = [], []
    with Threads(1) as pool:
        x, cost, _ = descend(known, fitter.refit.fit.x, known.training, pool)
        near = Nearby(known, x, pool, noise="coloured")
        assert near.cost == pytest.approx(cost)
        for other in others:
            told.append(near.fitted(other)[1])
            _, best, converged = descend(other, x, other.training, pool, iterations=100)
            assert converged
            fitted.append(best)
    assert list(np.argsort(told)) == list(np.argsort(fitted))
    assert told == pytest.approx(fitted, rel=0.02)


def test_a_delay_is_found_to_a_twentieth_of_a_sample(tmp_path: Path) -> None:
    """What a motor answers from rest, written down two samples of 2 ms late."""
    path = case(tmp_path, seed=5)
    for file in tmp_path.glob("*.csv"):
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        rows[2:, 2] = rows[:-2, 2].copy()
        np.savetxt(file, rows, delimiter=",", header="t,u,speed", comments="")
    scenario = load(path)
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    delay = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "delay")
    made = fitter.finish(fitter.partial_fit((delay,), [standing(fitter.refit.fit)]))
    assert made.sizes[0]["delay"] == pytest.approx(0.004, abs=1e-4)
    assert made.hold_out < 1.1
