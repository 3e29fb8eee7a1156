"""Residuals of several recordings at once: those of one at a time to the bit, whatever fails and whoever works."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.estimation.whitened import WhitenedResiduals
from diagnosis.problems import problem
from diagnosis.thresholds import FITTING
from engine import lanes, native
from engine.simulate import Drive
from engine.threads import Threads
from tests.diagnosis.estimation.test_covariance import wheel


def recordings(folder: Path) -> tuple[Any, Any]:
    """A wheel and six recordings: one is shorter, two cannot be simulated, one is of another inertia."""
    made = problem(*wheel(folder))
    one: Any = made.training[0]
    drives = [Drive(one.drive.time, np.asarray(one.drive.values) * (1 + 0.2 * k), one.drive.hold) for k in range(6)]
    six = [replace(one, name=f"{k}", drive=drive, measured=one.measured + 0.01 * k) for k, drive in enumerate(drives)]
    six[1] = six[1].cut(0.5)
    six[3] = replace(six[3], initial={"wheel.shaft.speed": 1e308})
    six[4] = replace(six[4], settings={"wheel.inertia": 3.0})
    six[5] = replace(six[5], settings={"oil.viscous_friction": -1.0})
    return replace(made, experiments=tuple(six)), np.full(len(made.free), 0.1)


@pytest.mark.parametrize("machine", [True, False])
def test_they_are_those_of_one_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, machine: bool) -> None:
    native.forget()
    monkeypatch.setattr(native, "MACHINE_CODE", machine)
    made, x = recordings(tmp_path)
    alone = [made.residual(x, e) for e in made.experiments]
    failed = [bool((np.abs(r) == FITTING.huge).all()) for r in alone]
    assert failed == [False, False, False, True, False, True]
    known = WhitenedResiduals(made, made.experiments, Threads(1)).residual(x)
    for workers in (1, 3):
        with Threads(workers) as pool:
            found = made.residuals(x, made.experiments, over=pool.map)
            assert [r.tobytes() for r in found] == [r.tobytes() for r in alone]
            rows = WhitenedResiduals(made, made.experiments, pool).residual(x)
            assert [r.tobytes() for r in rows] == [r.tobytes() for r in known]
    native.forget()


def test_those_that_are_alike_are_worked_on_together(tmp_path: Path) -> None:
    made, x = recordings(tmp_path)
    jobs = [e.job(made.model, *made.values(x, e), made.internal_step) for e in made.experiments[:5]]
    code = native.way_of(made.model).code
    assert code is not None
    expected = [[0, 2, 3, 4], [1]] if code.in_lanes else [[k] for k in range(5)]
    assert lanes.groups(made.model, jobs) == expected
