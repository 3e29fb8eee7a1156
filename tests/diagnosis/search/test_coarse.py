"""Coarse recordings: the residual of the refitted model stays as it is, and fits near it end where whole ones do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, _mean_drive
from diagnosis.problems import problem, variant
from diagnosis.search.coarse import coarse
from diagnosis.thresholds import COARSE
from engine.simulate import Drive
from engine.step import STEP_PER_RATE
from engine.threads import Threads
from scenarios.load import load
from tests.diagnosis.plants import case


def test_a_study_of_few_samples_is_left_as_it_is(tmp_path: Path) -> None:
    scenario = load(case(tmp_path, seed=1))
    made = problem(scenario, gather(scenario, [], []))
    assert sum(len(e.time) for e in made.training) < 8000
    assert coarse(made, np.zeros(len(made.free))) is made


def test_coarse_fits_end_where_whole_ones_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800))
    scenario = load(case(tmp_path, seed=2))
    made = problem(scenario, gather(scenario, [], []))
    start = np.zeros(len(made.free))
    with Threads(1) as pool:
        best, _, converged = descend(made, start, made.training, pool)
    assert converged
    rough = coarse(made, best)
    assert {e.thinned for e in rough.experiments} == {3}
    for e, there in zip(made.experiments, rough.experiments, strict=True):
        assert isinstance(e, TimeExperiment)
        assert isinstance(there, TimeExperiment)
        smooth = e.smoothed(e.residual(made.simulate(best, e)), 3) * e.sigma
        known = np.isfinite(there.measured)
        np.testing.assert_allclose(
            (rough.residual(best, there) * there.sigma)[known],
            smooth[known],
            atol=1e-9 * float(np.abs(e.measured).max()),
        )
    with Threads(1) as pool:
        found, _, converged = descend(rough, start, rough.training, pool)
    assert converged
    # The noise that smoothing takes away moves the optimum by a part of its uncertainty.
    assert np.abs(found - best).max() < 0.2


def _run_finely(tmp_path: Path, *options: str) -> Problem:
    """A case whose scenario runs in steps shorter than its recordings' intervals and than its machine needs."""
    file = case(tmp_path, seed=1)
    text = file.read_text(encoding="utf-8")
    assert "step: 2 ms" in text
    file.write_text(text.replace("step: 2 ms", "step: 1 ms"), encoding="utf-8")
    scenario = load(file, list(options))
    return problem(scenario, gather(scenario, [], []))


def test_a_slow_machine_is_run_in_longer_steps_with_the_same_answer(tmp_path: Path) -> None:
    made = _run_finely(tmp_path)
    x = np.zeros(len(made.free))
    rough = coarse(made, x)
    for e, there in zip(made.experiments, rough.experiments, strict=True):
        assert isinstance(e, TimeExperiment)
        assert isinstance(there, TimeExperiment)
        assert (e.every, there.every) == (2, 1)
        assert there.coarse
        assert there.finest_step == pytest.approx(e.finest_step)
        assert np.abs((there.measured - e.measured) / e.sigma).max() < 3 * COARSE.solver
        np.testing.assert_allclose(rough.residual(x, there), made.residual(x, e), atol=1e-9)
    assert made.internal_step == pytest.approx(1e-3)
    assert rough.internal_step == pytest.approx(2e-3)


def test_coarse_samples_are_followed_in_steps_as_fine_as_the_recordings(tmp_path: Path) -> None:
    """However many rows are simulated for each sample: what is too fast for coarse samples would be tried nowhere."""
    for e in _run_finely(tmp_path).experiments:
        assert isinstance(e, TimeExperiment)
        assert e.every == 2
        for count in (2, 3):
            assert e.averaged(count).finest_step == pytest.approx(e.finest_step)
            assert e.averaged(count).stepped(2).finest_step == pytest.approx(e.finest_step)


def test_the_steps_of_a_fast_machine_still_resolve_its_fastest_mode(tmp_path: Path) -> None:
    made = _run_finely(tmp_path, "motor.rotor_inertia=1e-8 kg.m2")
    x = np.zeros(len(made.free))
    rough = coarse(made, x)
    assert made.internal_step
    assert rough.internal_step
    assert made.internal_step < 0.5e-3
    assert rough.internal_step <= COARSE.per_rate / STEP_PER_RATE * made.internal_step * (1 + 1e-9)
    for e, there in zip(made.experiments, rough.experiments, strict=True):
        np.testing.assert_allclose(rough.residual(x, there), made.residual(x, e), atol=1e-9)


def test_models_that_are_compared_run_in_the_same_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no long step is good enough, coarse samples are no reason to take one in an amended model."""
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800, solver=0.0))
    scenario = load(case(tmp_path, seed=2))
    made = problem(scenario, gather(scenario, [], []))
    rough = coarse(made, np.zeros(len(made.free)))
    assert {e.thinned for e in rough.experiments} == {3}
    assert rough.internal_step == made.internal_step
    assert variant(rough, []).internal_step == made.internal_step


def test_a_mean_input_has_the_area_of_the_input() -> None:
    random = np.random.default_rng(3)
    time = np.cumsum(random.uniform(0.5e-3, 1.5e-3, 400))
    time -= time[0]
    values = random.normal(size=(400, 2))
    held = _mean_drive(Drive(time, values, ("zero_order", "linear")), 0.01, float(time[-1]))
    fine = np.arange(0.0, 0.3, 1e-6) + 5e-7
    given = [values[np.searchsorted(time, fine, side="right") - 1, 0], np.interp(fine, time, values[:, 1])]
    for k, column in enumerate(given):
        means = column.reshape(30, -1).mean(axis=1)
        np.testing.assert_allclose(np.asarray(held.values)[:30, k], means, atol=2e-3)


def test_an_input_that_jumps_between_samples_is_kept_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.search.coarse.COARSE", replace(COARSE, samples=800))
    scenario = load(case(tmp_path, seed=2))
    made = problem(scenario, gather(scenario, [], []))
    first = made.experiments[0]
    assert isinstance(first, TimeExperiment)
    assert first.drive is not None
    time = np.asarray(first.drive.time)
    chatter = Drive(time, np.where(np.arange(len(time)) % 2, 1.0, -1.0)[:, None], first.drive.hold)
    changed = [e if e is not first else replace(first, drive=chatter) for e in made.experiments]
    chattering = replace(made, experiments=tuple(changed))
    assert coarse(chattering, np.zeros(len(made.free))) is chattering
