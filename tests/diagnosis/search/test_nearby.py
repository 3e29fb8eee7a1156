"""Sizes that are only chosen: parameters that follow tangents end where a fit of each value ends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.least_squares import descend
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nearby import Nearby
from diagnosis.search.partial_fit import ended, standing
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


def late(tmp_path: Path, filtered: float = 0.0) -> CandidateFitter:
    """What a motor answers from rest, behind a filter of a time constant (s), written down two samples of 2 ms late."""
    path = case(tmp_path, seed=5)
    for file in tmp_path.glob("*.csv"):
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        if filtered:
            share = np.exp(-0.002 / filtered)
            rows[:, 2] = lfilter([1 - share], [1, -share], rows[:, 2])
        rows[2:, 2] = rows[:-2, 2].copy()
        np.savetxt(file, rows, delimiter=",", header="t,u,speed", comments="")
    scenario = load(path)
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


def listed(fitter: CandidateFitter) -> dict[str, Candidate]:
    return {c.effect: c for c in candidates(operating_scales(fitter.base))}


def test_a_delay_makes_room_for_a_lag_that_is_put_in_beside_it(tmp_path: Path) -> None:
    """Alone it has taken a part of the filter for its own: a few steps with the filter too have to give it back.

    The filter's pole is q = exp(-T / 20 ms), that of a lag of 20 ms; what is slow it delays by T q / (1 - q), a little
    less than such a lag. So beside the lag a delay of 4 ms + T q / (1 - q) - 20 ms is true.
    """
    step, lost = 0.002, 0.02
    q = np.exp(-step / lost)
    true = 2 * step + step * q / (1 - q) - lost
    fitter = late(tmp_path, lost)
    delay, lag = listed(fitter)["delay"], listed(fitter)["sensor_lag"]
    alone = fitter.finish(fitter.partial_fit((delay,), [standing(fitter.refit.fit)]))
    taken = alone.sizes[0]["delay"]
    assert taken > true + step
    both = fitter.partial_fit((ended(alone, alone.effects[0]), lag), [standing(alone.fit)])
    begun = both.point.sizes[0]["delay"]
    assert abs(begun - true) < abs(begun - taken)
    found = fitter.finish(both)
    assert found.sizes[0]["delay"] == pytest.approx(true, abs=2e-4)
    assert found.added()["sensor_lag.corner_frequency"] == pytest.approx(1 / lost, rel=0.03)


def test_a_delay_is_found_to_a_twentieth_of_a_sample(tmp_path: Path) -> None:
    fitter = late(tmp_path)
    delay = listed(fitter)["delay"]
    made = fitter.finish(fitter.partial_fit((delay,), [standing(fitter.refit.fit)]))
    assert made.sizes[0]["delay"] == pytest.approx(0.004, abs=1e-4)
    assert made.hold_out < 1.1
