"""Two codes that share nothing, against each other: each validates the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.concealed.case import draw
from benchmarks.concealed.drawing import Options
from benchmarks.concealed.plants import DRIVEN, PLANTS
from benchmarks.concealed.scenario import write
from benchmarks.concealed.sites import drive_sites, sites
from diagnosis.compare import compare
from scenarios.load import load
from tests.concealed.flexarm_side import NOT_IN_THE_LIBRARY, clean, difference, simulated

QUIET = Options(nuisance=0.0)


@pytest.mark.parametrize("plant", [*PLANTS, *DRIVEN])
def test_nothing_concealed_and_true_parameters_leave_the_noise_alone(plant: Any, tmp_path: Path) -> None:
    """Without noise the codes agree to a thousandth of a floor; with it what is left is the noise."""
    sensors = tuple(s.column for s in (PLANTS | DRIVEN)[plant].sensors)
    case = draw(plant, [], [], 21, replace(QUIET, sensors=sensors))
    assert difference(simulated(case, tmp_path), clean(case)) < 2e-3
    write(replace(case, nominal=dict(case.truth.parameters)), tmp_path / "noisy", tmp_path / "answers")
    scenario = load(str(tmp_path / "noisy" / "scenario.yaml"))
    sigma = {s.signal: s.sigma for s in case.sensors}
    left: dict[str, list[Any]] = {signal: [] for signal in sigma}
    for recorded in case.recordings:
        for signal, error in compare(scenario, recorded.name).signals.items():
            left[signal].append(error.rmse / sigma[signal])
    for signal, values in left.items():
        assert np.sqrt(np.mean(np.square(values))) == pytest.approx(1.0, abs=0.03), signal


SITES = [
    pytest.param(plant.name, str(site), id=f"{plant.name}: {site}")
    for plant in PLANTS.values()
    for site in [*sites(plant), *drive_sites(plant)]
    if site.effect.name not in NOT_IN_THE_LIBRARY
] + [
    pytest.param(plant.name, str(site), id=f"{plant.name}: {site}")
    for plant in DRIVEN.values()
    for site in drive_sites(plant)
]


RELATIVE = {"payload": 1e-3, "end_stop": 1e-4}
"""Share of an effect by which both sides may differ."""


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "site"), SITES)
def test_every_effect_means_the_same_on_both_sides(plant: Any, site: Any, tmp_path: Path) -> None:
    """The effect put into the scenario as one of flexarm's blocks, with the true numbers: a twentieth of a floor.

    A payload is kept out: the truth bends in the mode of the loaded arm, the scenario in that of the bare one. A stop
    is met or not: three thresholds of it are thousands of floors, of which the truth's own step leaves a hundred
    thousandth.
    """
    try:
        case = draw(plant, [site], [3.0], 11, QUIET)
    except ValueError as error:
        pytest.skip(str(error))
    (concealed,) = case.truth.concealed
    if concealed.effect == "delay":
        whole = max(1, round(concealed.parameters["delay"] * 1e4)) * 1e-4
        concealed = replace(concealed, parameters={"delay": whole})
        case = replace(case, truth=replace(case.truth, concealed=(concealed,)))
    truth = clean(case)
    without = difference(simulated(case, tmp_path / "without"), truth)
    within = difference(simulated(case, tmp_path / "with", [concealed]), truth)
    assert within < max(RELATIVE.get(concealed.effect, 0.0) * without, 0.0 if concealed.effect == "payload" else 0.05)
