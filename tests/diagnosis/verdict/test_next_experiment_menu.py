"""The menu of next experiments: what is in it, and that a lag against a delay calls for a fast input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.scales import operating_scales
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import standing
from diagnosis.verdict.experiment_design import NOTHING, menu, propose
from scenarios.load import load
from tests.diagnosis import plants

SAMPLE, LATE = 2e-3, 3
SLOW = ("slow_sine", "ramp", "reversal", "push", "levels", "amplitude_sweep", "free_decay", "both_ways_decay")


def lagged(u: Any, samples: Any) -> Any:
    """An input behind a first-order lag of so many samples, exact for values that are held."""
    keep = np.exp(-1 / samples)
    return lfilter([0.0, 1 - keep], [1.0, -keep], u)


def late(u: Any, samples: Any) -> NDArray[Any]:
    return np.concatenate([np.zeros(samples), u[:-samples]])


def slowly(t: Any) -> dict[str, Any]:
    """Inputs that change so slowly that a delay and a lag do the same."""
    return {
        "sine": ("train", 1.2 * np.sin(2 * np.pi * 0.8 * t)),
        "growing": ("train", 0.6 * t * np.sin(2 * np.pi * 1.3 * t)),
        "ramp": ("hold_out", np.interp(t, [0, 0.5, 1.5, 2.0], [0, 1.2, -1.2, 0])),
    }


@pytest.fixture(scope="module")
def rivals(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """A motor whose input comes three samples late, and the two models that say so, each fitted."""
    made = plants.speed
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plants, "inputs", slowly)
        patch.setattr(plants, "speed", lambda t, u: made(t, late(u, LATE), parts=5))
        path = plants.case(tmp_path_factory.mktemp("late"), noise=0.05, seed=5)
    scenario = load(path)
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    refit = fitter.refit
    listed = [c for c in candidates(operating_scales(fitter.base)) if c.effect in ("lag", "delay")]
    return [fitter.finish(fitter.partial_fit((c,), [standing(refit.fit)])) for c in listed]


@pytest.mark.parametrize("sample", [2e-4, 1e-3, 1e-2, 0.2])
def test_no_input_is_larger_or_faster_than_it_may_be(sample: float) -> None:
    for kind, (sentence, time, drive) in menu(3.0, sample).items():
        assert np.abs(drive).max() <= 3.0, kind
        assert len(time) == len(drive)
        assert np.ptp(drive) > 0
        assert sentence[0].islower()
        changes = time[np.flatnonzero(np.diff(drive))]
        if kind.startswith("prbs"):
            assert np.diff(changes).min() >= max(5e-3, 5 * sample) - 1e-9
            assert {-3.0, 3.0} == set(drive)


def test_a_lag_against_a_delay_calls_for_a_fast_input(rivals: list[Any]) -> None:
    """Driven behind a lag and behind a delay, a motor of our own differs most where the input changes fast."""
    found = propose(rivals, rivals[0].fit.problem.model)
    assert found is not None
    assert {label.split(" at ")[0] for label in found.separates} == {"lag", "delay"}
    assert found.separating
    assert found.kind not in SLOW

    def apart(time: Any, drive: Any) -> Any:
        t = np.arange(0.0, time[-1] + 1e-9, SAMPLE)
        u = np.interp(t, time, drive)
        return np.std(plants.speed(t, lagged(u, LATE), parts=1) - plants.speed(t, late(u, LATE), parts=1))

    inputs = menu(float(np.abs(found.drive).max()), SAMPLE)
    chosen = apart(found.time, found.drive)
    assert chosen > 2 * max(apart(*inputs[kind][1:]) for kind in SLOW)
    assert chosen > 0.7 * max(apart(time, drive) for _, time, drive in inputs.values())


def test_two_models_that_are_one_law_have_no_input(rivals: list[Any]) -> None:
    found = propose([rivals[0], rivals[0]], rivals[0].fit.problem.model)
    assert found is not None
    assert found.kind == NOTHING
    assert not found.separating
    assert found.expected == 0
    assert "another sensor" in found.sentence


def test_one_law_beside_another_is_told(rivals: list[Any]) -> None:
    found = propose([rivals[0], rivals[1], rivals[0]], rivals[0].fit.problem.model)
    assert found is not None
    assert found.separating
    assert found.expected > 3
    first = rivals[0].label
    assert f"{first} and {first} answer alike to every input tried" in found.sentence
