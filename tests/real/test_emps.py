"""EMPS: the dry friction and the offset that its authors published, found from the linear model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from diagnosis.api import diagnose
from diagnosis.binding import find_recording
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.recordings.types import Channel, Recording
from diagnosis.search.scored_model import ScoredModel
from scenarios.load import load
from tests.real.bench import Bench, bench

FRICTION, OFFSET = 20.3935, -3.1648
"""Coulomb friction and offset (N) published with the data set."""

CORNER = 50.0
"""Hz, of the zero-phase filter (fourth-order Butterworth, forwards and backwards) through which forces are compared."""


@pytest.fixture(scope="module")
def axis(recordings: Path) -> Bench:
    return bench("emps")


@pytest.fixture(scope="module")
def directional(axis: Bench) -> ScoredModel:
    return axis.put_in(axis.find("direction_dependent_friction"))


@pytest.fixture(scope="module")
def pair(axis: Bench) -> ScoredModel:
    return axis.put_in(axis.find("coulomb_friction"), axis.find("offset", "motor.force"))


def pulses(scenario: str) -> tuple[Channel, ...]:
    found = find_recording(load(scenario), "pulses")
    assert isinstance(found, Recording)
    return found.measurements


def relative(trial: ScoredModel) -> float:
    """Root mean square of the held-out force residual relative to the force, both filtered, at every sample."""
    made = trial.fit
    (e,) = made.problem.held_out
    assert isinstance(e, TimeExperiment)
    simulated = made.problem.simulate(made.x, e)[:, 0]
    (channel,) = pulses("emps")
    b, a = butter(4, CORNER * 2 * e.step)
    force = filtfilt(b, a, channel.values)
    return float(np.linalg.norm(filtfilt(b, a, simulated) - force) / np.linalg.norm(force))


def test_friction_and_its_asymmetry_have_the_published_size(directional: ScoredModel) -> None:
    found = directional.fit.parameters()
    forward = found["found_direction_dependent_friction.coulomb_friction"]
    backward = found["found_direction_dependent_friction.coulomb_friction_backward"]
    assert (forward + backward) / 2 == pytest.approx(FRICTION, rel=0.03)
    assert (forward - backward) / 2 == pytest.approx(OFFSET, rel=0.05)
    assert found["guide.viscous_friction"] == pytest.approx(203.5, rel=0.03)
    assert found["carriage.mass"] == pytest.approx(95.11, rel=0.03)


def test_the_pair_does_the_same_and_cannot_be_told_apart(directional: ScoredModel, pair: ScoredModel) -> None:
    found = pair.fit.parameters()
    assert found["found_coulomb_friction.coulomb_friction"] == pytest.approx(FRICTION, rel=0.03)
    # The offset is put into the force, which moves the carriage; published as what must be overcome.
    assert found["found_offset.offset"] == pytest.approx(-OFFSET, rel=0.05)
    assert pair.hold_out == pytest.approx(directional.hold_out, rel=1e-3)
    assert pair.fit.chi2 == pytest.approx(directional.fit.chi2, rel=1e-3)


def inverse(parameters: dict[str, float], forward: float, backward: float) -> float:
    """The force residual of the inverse model on the recorded motion of PULSES, as the literature states it."""
    (channel,) = pulses("emps")
    (moved,) = pulses("emps-open-loop")
    b, a = butter(4, CORNER * 2e-3)
    speed = np.gradient(filtfilt(b, a, moved.values), 1e-3)
    dry = np.where(speed > 0, forward, -backward)
    force = parameters["carriage.mass"] * np.gradient(speed, 1e-3) + parameters["guide.viscous_friction"] * speed + dry
    applied = filtfilt(b, a, channel.values)
    return float(np.linalg.norm(force - applied) / np.linalg.norm(applied))


def test_held_out_force(axis: Bench, directional: ScoredModel) -> None:
    """Published with zero-phase filters of 20 to 150 Hz: 0.180 without dry friction, 0.048 to 0.083 with it."""
    found = directional.fit.parameters()
    levels = [found[f"found_direction_dependent_friction.coulomb_friction{way}"] for way in ("", "_backward")]
    print(
        inverse(axis.refit.fit.parameters(), 0.0, 0.0),
        inverse(found, *levels),
        relative(axis.refit),
        relative(directional),
    )
    assert inverse(axis.refit.fit.parameters(), 0.0, 0.0) == pytest.approx(0.180, abs=0.01)
    assert 0.048 < inverse(found, *levels) < 0.083
    assert relative(directional) < 0.11 < 0.19 < relative(axis.refit)


@pytest.mark.slow
def test_the_verdict_is_a_tie_of_the_two(recordings: Path) -> None:
    found = diagnose("emps", workers=2)
    assert found.verdict == "tie"
    (finding,) = found.findings
    assert finding["effect"] == "direction_dependent_friction"
    assert any("coulomb_friction" in other and "offset" in other for other in finding["indistinguishable_from"]), (
        finding["indistinguishable_from"]
    )
