"""Runs of one model that begin alike: what was worked out once is used again, and nothing of it is shared."""

from __future__ import annotations

import numpy as np
import pytest

from engine import simulate as module
from engine.simulate import prepare, simulate
from scenarios.load import load


def test_a_second_run_is_the_first_and_takes_no_new_start(monkeypatch: pytest.MonkeyPatch) -> None:
    model, alone = load("reference-a").build(), load("reference-a").build()
    first = simulate(model, 0.5)
    monkeypatch.setattr(module, "choose_step", lambda *_: pytest.fail("the step is chosen anew"))
    again = simulate(model, 0.5)
    np.testing.assert_array_equal(again.values, first.values)
    job = prepare(model, 0.5, 1e-3)
    job.x0[:], job.d0[:] = 7.0, 7.0
    np.testing.assert_array_equal(simulate(model, 0.5).values, first.values)
    monkeypatch.undo()
    np.testing.assert_array_equal(simulate(alone, 0.5).values, first.values)


@pytest.mark.parametrize(
    "other",
    [
        {"parameters": {"motor.resistance": 3.0}},
        {"initial": {"link.hub.angle": 0.1}},
        {"internal_step": 1e-4},
        {"step": 5e-4},
        {"stop": 0.4},
    ],
)
def test_what_differs_is_prepared_anew(other: dict[str, object]) -> None:
    model, alone = load("reference-a").build(), load("reference-a").build()
    simulate(model, 0.5)
    given: dict[str, object] = {"stop": 0.5, "step": 1e-3} | other
    found, expected = prepare(model, **given), prepare(alone, **given)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.x0, expected.x0)
    np.testing.assert_array_equal(found.p, expected.p)
    assert (found.hmax, found.outputs) == (expected.hmax, expected.outputs)


def test_only_so_many_starts_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_BEGUN", 3)
    model = load("reference-a").build()
    for k in range(8):
        prepare(model, 0.5, 1e-3, parameters={"motor.resistance": 2.0 + k})
    assert len(model.begun) <= 3
