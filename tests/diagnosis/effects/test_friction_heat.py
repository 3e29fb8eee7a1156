"""Dry friction that falls as it warms up, in recordings that a few lines of this file integrate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng

from diagnosis.api import diagnose
from diagnosis.effects.catalogue import EFFECTS

J, DRY, VISCOUS = 0.01, 0.3, 0.02
SHARE, CAPACITY, RESISTANCE = 0.03, 0.5, 40.0
"""Of the friction that a kelvin takes (the block's own), J/K, K/W: a third of the friction goes in eight seconds."""

STEP, PARTS, SECONDS = 5e-3, 50, 8.0
NOISE = 0.02

SCENARIO = f"""\
schema: 1
name: bearing
blocks:
  torque: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {J} kg.m2}}
  bearing: {{type: BearingFriction, coulomb_friction: 0.25 N.m, viscous_friction: 0.025 N.m.s/rad}}
connect:
  - [torque.shaft, rotor.shaft, bearing.shaft]
simulate: {{stop: 8 s, step: 5 ms}}
recordings:
"""

TRIED = {
    *("friction_warm_up", "viscous_friction", "coulomb_friction", "stribeck_friction", "quadratic_drag", "offset"),
    *("direction_dependent_friction", "wrong_parameter", "uneven_gain", "lag", "load_dependent_friction"),
}


def recorded(folder: Path) -> Path:
    """Two recordings to fit and one to judge: torque in, speed out; every one begins cold.

    Friction is the torque that would stop the shaft within a step, as far as its level goes.
    """
    rng, text, t = default_rng(2), SCENARIO, STEP * np.arange(round(SECONDS / STEP) + 1)
    for k, role in enumerate(("train", "train", "hold_out")):
        slow, fast, h = 5.0 + 2.0 * k, 13.0 - 3.0 * k, STEP / PARTS
        torque = 0.55 * np.sin(slow * t) + 0.35 * np.sin(fast * t + k)
        speed, warm, speeds = 0.0, 0.0, []
        for u in torque:
            speeds.append(speed)
            for _ in range(PARTS):
                left = math.exp(-SHARE * warm)
                level, push = left * DRY, J * speed / h + u - left * VISCOUS * speed
                dry = min(max(push, -level), level)
                speed = (push - dry) * h / J
                lost = abs((dry + left * VISCOUS * speed) * speed)
                warm += h * (lost - warm / RESISTANCE) / CAPACITY
        rows = np.column_stack([t, torque, np.array(speeds) + rng.normal(0, NOISE, len(t))])
        np.savetxt(folder / f"r{k}.csv", rows, delimiter=",", header="t,u,w", comments="")
        text += (
            f"  r{k}:\n    file: r{k}.csv\n    time: {{column: t, unit: s}}\n    role: {role}\n"
            "    drive: {torque.torque: {column: u, unit: N.m, hold: zero_order}}\n"
            f"    measurements: {{rotor.shaft.speed: {{column: w, unit: rad/s, noise: {NOISE}}}}}\n"
        )
        assert 0.25 < 1 - math.exp(-SHARE * warm) < 0.5
    (folder / "bearing.yaml").write_text(text, encoding="utf-8")
    return folder / "bearing.yaml"


@pytest.mark.slow
def test_dry_friction_that_falls_is_named_with_its_heat(tmp_path: Path) -> None:
    """Beside the other laws of a bearing; the fall per joule and the time constant are those of the joint."""
    found = diagnose(recorded(tmp_path), workers=1, without=sorted(set(EFFECTS) - TRIED))
    (finding,) = found.findings
    assert (finding["status"], finding["effect"], finding["place"]) == ("named", "friction_warm_up", "bearing")
    assert finding["parameters"]["temperature_coefficient"]["value"] == SHARE
    assert finding["parameters"]["heat_capacity"]["value"] == pytest.approx(CAPACITY, rel=0.1)
    low, high = (finding["parameters"]["thermal_resistance"][end] for end in ("low", "high"))
    assert low <= RESISTANCE <= high
