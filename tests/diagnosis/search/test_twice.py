"""An effect that is missing at two places at once, such as the friction of two bearings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.api import diagnose, possible_effects
from diagnosis.effects.catalogue import EFFECTS
from diagnosis.effects.effect import all_beside, beside
from scenarios.amend import amended
from scenarios.load import load

MOTOR, LOAD, STIFFNESS, DAMPING = 2e-3, 8e-3, 6.0, 5e-3
DRY, DRY_LOAD = 0.03, 0.05

SCENARIO = """\
schema: 1
name: two-bearings
blocks:
  drive: {type: Torque}
  rotor: {type: Inertia, inertia: 2.1e-3 kg.m2}
  spring: {type: SpringDamper, stiffness: 5.8 N.m/rad, damping: 5 mN.m.s/rad}
  load: {type: Inertia, inertia: 7.8e-3 kg.m2}
  front: {type: BearingFriction, viscous_friction: 2 mN.m.s/rad}
  back: {type: BearingFriction, viscous_friction: 2 mN.m.s/rad}
connect:
  - [drive.shaft, rotor.shaft, front.shaft, spring.a]
  - [spring.b, load.shaft, back.shaft]
simulate: {stop: 2 s, step: 4 ms}
recordings:
"""
RECORDING = """\
  {name}:
    file: {name}.csv
    time: {{column: t, unit: s}}
    drive: {{drive.torque: {{column: u, unit: N.m, hold: zero_order}}}}
    measurements:
      rotor.shaft.speed: {{column: v, unit: rad/s, noise: 0.01}}
      load.shaft.speed: {{column: w, unit: rad/s, noise: 0.01}}
    role: {role}
"""

Array = NDArray[np.float64]


def turned(torque: Array, interval: float, parts: int = 100) -> Array:
    """Speeds of both bodies: explicit steps of 40 us, each body held where what pulls it is less than its friction."""
    h, v, w, twist, rows = interval / parts, 0.0, 0.0, 0.0, []

    def slid(speed: float, pull: float, dry: float, inertia: float) -> float:
        if speed == 0.0:
            return 0.0 if abs(pull) <= dry else h * (pull - math.copysign(dry, pull)) / inertia
        new = speed + h * (pull - math.copysign(dry, speed)) / inertia
        return 0.0 if new * speed < 0 else new

    for u in torque:
        rows.append((v, w))
        for _ in range(parts):
            through = STIFFNESS * twist + DAMPING * (v - w)
            v, w = slid(v, u - through - 2e-3 * v, DRY, MOTOR), slid(w, through - 2e-3 * w, DRY_LOAD, LOAD)
            twist += h * (v - w)
    return np.array(rows)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, random, t = tmp_path_factory.mktemp("rig"), np.random.default_rng(5), np.linspace(0.0, 2.0, 501)
    inputs = {
        "steps": ("train", np.repeat(random.uniform(-0.4, 0.4, 20), 26)[:501]),
        "chirp": ("train", 0.4 * np.sin(2 * np.pi * (0.7 + 2 * t) * t)),
        "other": ("hold_out", np.repeat(random.uniform(-0.3, 0.3, 30), 17)[:501]),
    }
    text = SCENARIO
    for name, (role, u) in inputs.items():
        y = turned(u, 4e-3) + 0.01 * random.standard_normal((len(t), 2))
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, u, y]), delimiter=",", header="t,u,v,w", comments="")
        text += RECORDING.format(name=name, role=role)
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_second_time_its_blocks_have_another_name(rig: Path) -> None:
    front, back = [c for c in possible_effects(rig) if c.effect == "coulomb_friction"]
    assert beside([front], front) is None
    both = all_beside([front], [back])
    assert both is not None
    there = rig.with_name("both.yaml")
    edits = [edit for c in both for edit in c.edits(c.starts[0])]
    there.write_text(amended(rig.read_text(encoding="utf-8"), edits), encoding="utf-8")
    found = {name for name in load(there).system.blocks if name.startswith("found")}
    assert found == {"found_coulomb_friction", "found_coulomb_friction_2"}


def test_a_change_of_the_user_s_block_is_made_once(rig: Path) -> None:
    stiffness = next(c for c in possible_effects(rig) if c.effect == "wrong_parameter")
    other = next(c for c in possible_effects(rig) if c.effect == "coulomb_friction")
    assert beside([stiffness], stiffness) is None
    assert beside([stiffness], other) is other


def test_friction_in_two_bearings_is_found_in_both(rig: Path) -> None:
    tried = {"coulomb_friction", "viscous_friction", "offset", "joint_flexibility", "wrong_parameter"}
    found = diagnose(rig, workers=1, without=sorted(set(EFFECTS) - tried))
    named = {(f["effect"], f["place"]): f["parameters"]["coulomb_friction"]["value"] for f in found.findings}
    assert found.verdict == "named"
    assert named == {
        ("coulomb_friction", "drive.shaft"): pytest.approx(DRY, rel=0.1),
        ("coulomb_friction", "spring.b"): pytest.approx(DRY_LOAD, rel=0.1),
    }
