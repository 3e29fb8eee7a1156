"""The published friction laws of a servo, as `benchmarks.peers.servo` writes them: limits, and a fit of made logs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.peers.servo import DUTY, GRAVITY, HORN, LAWS, LENGTH, MASS, STEP, Array, Log, Rig, fit

TIME: Array = np.arange(0.0, 2.0, 5e-3)
STEPS: Array = np.float64(STEP) * np.arange(2001, dtype=np.float64)


def log(gain: float, goal: Array, position: Array | None = None) -> Log:
    on = np.ones(len(STEPS))
    there = np.zeros(len(TIME)) - HORN if position is None else position
    return Log("made", DUTY * gain, TIME, there, goal, on, 0.0)


def lanes(law: str, **given: float) -> dict[str, Array]:
    return {name: np.array([[given.get(name, value)]]) for name, value in LAWS[law].items()}


def test_without_friction_the_weight_swings_as_a_pendulum() -> None:
    """Let go at 20 mrad from rest: cos(sqrt(m g r / J) t), to the first order of the step."""
    free = replace(log(100, 0 * STEPS), on=np.zeros(len(STEPS)), position=np.full(len(TIME), 0.02 - HORN))
    made = Rig([free]).simulate("M1", lanes("M1", Kc=1e-12, Kv=1e-12))[:, 0, 0]
    swing = np.sqrt(MASS * GRAVITY * LENGTH / (MASS * LENGTH**2 + LAWS["M1"]["armature"]))
    assert np.abs(made[:2001] + HORN - 0.02 * np.cos(swing * STEPS)).max() < 4e-4


def test_what_friction_holds_stays_exactly() -> None:
    held = replace(log(100, 0 * STEPS), on=np.zeros(len(STEPS)), position=np.full(len(TIME), 0.05))
    made = Rig([held]).simulate("M3", lanes("M3", Kc=0.2))[:, 0, 0]
    assert (made == 0.05).all()


@pytest.mark.parametrize(
    ("richer", "poorer", "nothing"),
    [
        ("M2", "M1", {"Kcs": 0.0}),
        ("M4", "M3", {"Kcs": 0.0, "Kls": 0.0}),
        ("M5", "M3", {"Kcs": 0.0, "Kms": 0.0, "Kes": 0.0}),
        ("M6", "M5", {"Keq": 0.0, "Kmq": 0.0}),
    ],
)
def test_each_law_holds_the_one_before(richer: str, poorer: str, nothing: dict[str, float]) -> None:
    """M5 holds M3 where Km = Ke."""
    rig = Rig([log(400, np.sin(3 * STEPS))])
    one, other = rig.simulate(richer, lanes(richer, **nothing)), rig.simulate(poorer, lanes(poorer))
    assert np.allclose(one, other, atol=1e-12)


def test_a_law_is_recovered_from_what_it_made() -> None:
    """Two gains, as in the recordings; noise of a count of the servo's encoder."""
    true = lanes("M3", Kl=0.25, Kc=0.02, resistance=4.0)
    rng = np.random.default_rng(0)
    logs = []
    for gain, goal in ((100.0, 1.5 * np.sin(4 * STEPS)), (400.0, np.sin(3 * STEPS + 4 * STEPS**2))):
        blank = log(gain, goal)
        made = Rig([blank]).simulate("M3", true)[:: round(5e-3 / STEP), 0, 0][: len(TIME)]
        logs.append(replace(blank, position=made + rng.normal(0, 1.5e-3, len(TIME)), speed=0.0))
    found, ends = fit("M3", Rig(logs), 3, 1)
    assert ends[0] < 1.7e-3
    assert found["Kl"] == pytest.approx(0.25, rel=0.05)
    ratio = found["torque_constant"] / found["resistance"]
    assert ratio == pytest.approx(0.38 / 4.0, rel=0.05)
