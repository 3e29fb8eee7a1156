"""Sizes that are only chosen: parameters that follow tangents end where a fit of each value ends."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.problem import Problem
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nearby import Followed, Nearby
from diagnosis.search.partial_fit import PartialFit, StartingPoint, ended, standing
from diagnosis.thresholds import COARSE, EVIDENCE, SEARCH
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
        assert near.known.cost == pytest.approx(cost)
        for other in others:
            told.append(near.fitted(other).cost)
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


def begun_late(fitter: CandidateFitter, delay: Candidate, wait: float, *, whole: bool) -> PartialFit:
    """A model with a delay, its parameters fitted."""
    made = fitter.build((delay,), ({"delay": wait},), whole=whole)
    with Threads(1) as pool:
        x, cost, _ = descend(made, np.zeros(len(made.free)), made.training, pool)
    return PartialFit((delay,), StartingPoint(cost, made, x, ({"delay": wait},), ({"delay": wait},)), True)


def test_where_tangents_promise_too_much_a_size_is_looked_for_closer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a resistance made up for a part of the delay (random rig 8721); here the promise is made up."""
    fitter = late(tmp_path)
    delay = listed(fitter)["delay"]
    assert delay.finer is not None
    finer, told, asked = delay.finer, Nearby.fitted, list[Sizes | None]()

    def asking(sizes: Sizes, share: float) -> Sizes | None:
        asked.append(finer(sizes, share))
        return asked[-1]

    def fitted(near: Nearby, other: Problem) -> Followed:
        made, sizes = told(near, other), asked[-1]
        return replace(made, cost=-1e9) if sizes and sizes["delay"] > 0.0046 else made

    monkeypatch.setattr(Nearby, "fitted", fitted)
    found = fitter._refined(begun_late(fitter, replace(delay, finer=asking), 0.0037, whole=True), noise="coloured")
    assert found.point.sizes[0]["delay"] == pytest.approx(0.004, abs=1e-4)


def test_steps_lead_to_a_delay_within_three_distances(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two values tell a slope and one is tried, at each of them; halving takes all ten distances, two values each."""
    fitter = late(tmp_path)
    told, simulated = Nearby.fitted, list[float]()

    def fitted(near: Nearby, other: Problem) -> Followed:
        made = told(near, other)
        simulated.append(made.cost)
        return made

    monkeypatch.setattr(Nearby, "fitted", fitted)
    with Threads(1) as pool:
        begun = begun_late(fitter, listed(fitter)["delay"], 0.0037, whole=True)
        near = Nearby(begun.point.problem, begun.point.x, pool, noise="coloured")
        finer = begun.effects[0].finer
        assert finer is not None

        def at(share: float) -> Problem | None:
            sizes = finer({"delay": 0.0037}, share)
            return fitter.build(begun.effects, (sizes,), whole=True) if sizes else None

        share, best = near.sought(at, SEARCH.finer)
    assert best.cost == min(simulated)
    assert finer({"delay": 0.0037}, share)["delay"] == pytest.approx(0.004, abs=1e-4)  # type: ignore[index]
    assert len(simulated) <= 3 * 3, simulated


def test_a_size_is_looked_for_on_the_whole_recordings_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse ones are corrected by a model that lacks the delay."""
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800))
    fitter = late(tmp_path)
    assert fitter.coarse is not fitter.base
    partial = begun_late(fitter, listed(fitter)["delay"], 0.003, whole=False)
    monkeypatch.setattr(CandidateFitter, "_coloured", lambda self, there, reach: there)
    assert fitter.finish(partial).sizes[0]["delay"] == pytest.approx(0.004, abs=1e-4)


def test_of_two_ends_of_a_fit_the_one_that_leaves_less_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the beginning of the recordings it ends elsewhere here, and higher."""
    fitter = late(tmp_path)
    partial = begun_late(fitter, listed(fitter)["delay"], 0.0005, whole=True)
    assert partial.point.problem.chi2(partial.point.x, partial.point.problem.training) > EVIDENCE.stated
    ends: list[PartialFit] = []
    began: list[PartialFit] = []
    descended, whole = CandidateFitter._descended, CandidateFitter._whole

    def fitted(self: CandidateFitter, partial: PartialFit, **how: Any) -> PartialFit:
        if how.get("noise") != "white":
            return descended(self, partial, **how)
        first = began[0].point if began else None
        began.append(partial if first is None else replace(partial, point=replace(first, cost=first.cost + 100)))
        return began[-1]

    def counted(self: CandidateFitter, partial: PartialFit, end: PartialFit, reach: float) -> PartialFit:
        ends.append(end)
        return whole(self, partial, end, reach)

    monkeypatch.setattr(CandidateFitter, "_coloured", lambda self, there, reach: there)
    monkeypatch.setattr(CandidateFitter, "_descended", fitted)
    monkeypatch.setattr(CandidateFitter, "_whole", counted)
    fitter.finish(partial)
    assert (len(began), len(ends)) == (2, 1)
