"""The how-to of control design as a reader follows it: its Python runs on the rig, and holds what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexarm.api import simulate
from flexarm.design.margins import margins, margins_of
from scenarios.load import load
from tools.figures.robust import TRUTH, follow


def test_a_controller_for_one_model_fails_on_another_and_one_for_all_does_not(tmp_path: Path) -> None:
    """The linear members, the nonlinear ones, and the rig that was recorded, sampled with a delay of one period."""
    found = follow(tmp_path)
    assert len(found["members"]) == 31
    assert margins_of(found["for_one"] * found["fitted"]).disk >= 0.4
    assert found["unstable"]
    driven = load(tmp_path / "closed-one.yaml").build()
    for k in found["unstable"]:  # pushed at 5 rad/s, and the faster the longer it runs, however slowly that grows
        speed = np.abs(simulate(driven, 12.0, 5e-3, parameters=found["made"].samples[k]).values[:, 0])
        assert speed[-200:].max() > max(2 * found["left"]["one"][k], 5.0)
    assert found["left"]["one"][0] < 0.05
    assert max(found["left"]["all"]) < 0.05
    run = simulate(load(tmp_path / "closed-all.yaml", TRUTH))
    assert np.abs(run.values[-200:, 0]).max() < 0.05
    sliding = {"bearing": "sliding forward"}
    (loop,) = margins(load(tmp_path / "closed-all.yaml", TRUTH), loop="motor.torque", modes=sliding).members
    assert loop.stable
    assert loop.disk > 0.3
