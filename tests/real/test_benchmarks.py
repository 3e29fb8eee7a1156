"""Benchmarks that everybody knows: what is published of each, against the effect put into its nominal model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.search.partial_fit import ended
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import SEARCH
from tests.real.bench import Bench, bench


def errors(trial: ScoredModel) -> dict[str, float]:
    """Root mean square error of the one signal of each recording, by name."""
    found, problem = {}, trial.fit.problem
    for e in problem.experiments:
        left = (problem.residual(trial.fit.x, e) * e.sigma)[np.isfinite(e.measured)]
        found[e.name] = float(np.sqrt(np.mean(left**2)))
    return found


@pytest.fixture(scope="module")
def silverbox(recordings: Path) -> Bench:
    if not (recordings / "silverbox").is_dir():
        pytest.skip("no silverbox")
    return bench("silverbox")


@pytest.mark.slow
def test_the_silverbox_is_a_hardening_spring(silverbox: Bench) -> None:
    """k3 / k is 3.95 to 4.04 per V^2 by an independent fit; the tip of the arrow lies beyond all that was fitted."""
    harder = silverbox.put_in(silverbox.find("hardening_spring", "spring", exact=True), given=True)
    p, after, before = harder.fit.parameters(), errors(harder), errors(silverbox.refit)
    assert p["spring.cubic_stiffness"] / p["spring.stiffness"] == pytest.approx(3.95, abs=0.08)
    for name in ("multisine", "second_multisine"):
        assert after[name] < 0.1 * before[name] < 1e-3
    assert after["tip_of_the_arrow"] < 0.03 * before["tip_of_the_arrow"]
    for rival in ("hysteresis", "structural_damping", "backlash"):
        other = silverbox.put_in(silverbox.find(rival, "spring", exact=True), given=True)
        assert errors(other)["second_multisine"] > 5 * after["second_multisine"], rival


@pytest.fixture(scope="module")
def drives(recordings: Path) -> Bench:
    if not (recordings / "coupled_drives").is_dir():
        pytest.skip("no coupled_drives")
    return bench("coupled-drives")


def test_the_coupled_drives_are_read_without_a_sign(drives: Bench) -> None:
    """0.85 V linear and 0.22 V with the magnitude, by an independent fit; dry friction beside it is not needed.

    By squared error alone friction takes a tenth off, with both inertias fourteen tolerances from their values.
    """
    magnitude = drives.find("rectified_sensor", "pulley.shaft.speed", exact=True)
    rectified = drives.put_in(magnitude, given=True)
    before, after = errors(drives.refit), errors(rectified)
    assert before["prbs"] == pytest.approx(0.845, abs=0.02)
    assert after["prbs"] == pytest.approx(0.22, abs=0.01)
    assert after["weaker"] < 0.75 * before["weaker"]
    dry = drives.find("coulomb_friction", "drive.shaft", exact=True)
    both = drives.put_in(ended(rectified, magnitude), dry, given=True)
    assert 0.95 * after["prbs"] < errors(both)["prbs"] < after["prbs"]
    assert both.log_evidence < rectified.log_evidence + SEARCH.effort


@pytest.mark.slow
def test_the_hysteretic_benchmark_is_identified(recordings: Path) -> None:
    """Published: m = 2 kg, c = 10 N.s/m, k = alpha = 5e4 N/m, beta gamma = 800 1/m, beta delta = -1100 1/m, nu = 1.

    Here b / zy = beta gamma and (c - b) / zy = beta delta. A spring that hardens without a loop explains little.
    """
    if not (recordings / "bouc_wen").is_dir():
        pytest.skip("no bouc_wen")
    made = bench("bouc-wen")
    (linear,) = errors(made.refit).values()
    law = next(
        c for c in made.known if (c.effect, c.place, c.option) == ("hysteresis", "spring", "stiffening under load")
    )
    trial = made.put_in(law, given=True)
    (left,) = errors(trial).values()
    assert left < 1e-3 * linear
    p = {name.partition(".")[2]: value for name, value in trial.fit.parameters().items() if name.startswith("spring.")}
    assert trial.fit.parameters()["mass.mass"] == pytest.approx(2.0, rel=2e-3)
    assert p["damping"] == pytest.approx(10.0, rel=5e-3)
    assert p["stiffness"] == pytest.approx(1e5, rel=2e-3)
    assert p["residual_share"] == pytest.approx(0.5, rel=2e-3)
    assert p["sharpness"] == pytest.approx(1.0, abs=2e-3)
    assert p["unloading_share"] / p["yield_compression"] == pytest.approx(800, rel=5e-3)
    assert (p["loading_share"] - p["unloading_share"]) / p["yield_compression"] == pytest.approx(-1100, rel=5e-3)
    harder = made.put_in(made.find("hardening_spring", "spring", exact=True), given=True)
    (other,) = errors(harder).values()
    assert other > 0.7 * linear
