"""What other tools are given of the servo: the friction that its position tells, and a law with a further part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.peers.servo import LAWS, STEP, Array, Rig
from benchmarks.peers.servo_tools import Corrected, Hinge, sliding, with_pysindy
from tests.benchmarks.test_servo import STEPS, TIME, lanes, log

GOAL: Array = np.asarray(1.2 * np.sin(3 * STEPS))


def test_a_constant_more_is_coulomb_friction() -> None:
    blank = log(400, GOAL)
    one = Rig([blank]).simulate("M1", lanes("M1", Kc=0.03))
    other = Corrected([blank], lambda v, tm, te: np.full_like(v, 0.02)).simulate("M1", lanes("M1", Kc=0.01))
    assert np.allclose(one, other, atol=1e-12)


def test_less_friction_than_none_drives_nothing() -> None:
    """What a regression makes of friction may be negative: it would add energy."""
    blank = log(400, GOAL)
    one = Rig([blank]).simulate("M1", lanes("M1", Kc=0.0, Kv=0.0))
    other = Corrected([blank], lambda v, tm, te: np.full_like(v, -1.0)).simulate("M1", lanes("M1"))
    assert np.array_equal(one, other)


def test_position_tells_the_friction_while_the_joint_slides() -> None:
    """Of a made servo with noise of a count: its level and its slope over speed, to some mN.m."""
    blank, rng = log(400, GOAL), np.random.default_rng(0)
    true = LAWS["M1"] | {"Kc": 0.05, "Kv": 0.02}
    made = Rig([blank]).simulate("M1", lanes("M1", Kc=0.05, Kv=0.02))[:: round(5e-3 / STEP), 0, 0][: len(TIME)]
    x, friction = sliding([replace(blank, position=made + rng.normal(0, 1.5e-3, len(TIME)))], true)
    slope, level = np.polyfit(np.abs(x[:, 0]), friction, 1)
    assert level == pytest.approx(0.05, abs=0.01)
    assert slope == pytest.approx(0.02, abs=0.006)


def test_mujoco_and_the_laws_have_one_servo() -> None:
    """M1 in both: MuJoCo's friction is a constraint that gives a little, the laws' holds exactly."""
    pytest.importorskip("mujoco")
    blank, p = log(400, GOAL), LAWS["M1"]
    made = Rig([blank]).simulate("M1", lanes("M1"))[:, 0, 0]
    there = replace(blank, time=STEPS[:2000], position=made[:2000])
    (error,) = Hinge([there]).errors([p["torque_constant"], p["resistance"], p["armature"], p["Kc"], p["Kv"]])
    assert np.abs(error).max() < 2e-3


def test_a_sparse_regression_finds_the_term_that_is_missing() -> None:
    pytest.importorskip("pysindy")
    rng = np.random.default_rng(1)
    x = rng.uniform(-1, 1, (2000, 3))
    y = 0.3 * np.abs(x[:, 1]) + rng.normal(0, 1e-3, 2000)

    def cost(further: object) -> float:
        assert callable(further)
        return float(np.mean((further(*x.T) - y) ** 2))

    told, _ = with_pysindy(x, y, cost)
    assert told == "+0.3 |tm|"
