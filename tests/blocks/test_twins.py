"""Sliding twins: their units, and the same motion as the turning law on a lever of a metre."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.actuators.spring_damper import SpringDamper
from blocks.registry import registry
from blocks.sources.constant import Constant
from engine.block import Block, parameter
from engine.errors import ParameterError
from engine.ports import ROTATIONAL, TRANSLATIONAL
from engine.quantity import base_units
from engine.slides import along_slide
from tests.blocks.assembly import run
from tests.blocks.test_drive_train import balance

TWINS = {name: made for name, made in registry().items() if made.slide_twin}

VALUES: dict[str, dict[str, Any]] = {
    "BearingFriction": {"coulomb_friction": 0.4, "static_friction": 0.6, "stribeck_velocity": 0.05},
    "JointFriction": {"coulomb_friction": 0.4, "static_friction": 0.6, "stribeck_velocity": 0.05},
    "Brake": {"torque": 0.8, "reference": 0.1},
    "SpringDamper": {"stiffness": 30.0, "damping": 0.1, "rest_angle": 0.2},
    "EndStop": {"lower": -0.05, "upper": 0.1, "stiffness": 300.0, "damping": 0.5},
    "Backlash": {"stiffness": 30.0, "damping": 0.1, "half_gap": 0.03, "rest_angle": 0.2},
    "LuGreFriction": {"coulomb_friction": 0.4, "bristle_stiffness": 200.0, "bristle_damping": 1.0},
    "LuGreJointFriction": {"coulomb_friction": 0.4, "stribeck_velocity": 0.05, "bristle_stiffness": 200.0},
    "ElastoPlasticFriction": {"coulomb_friction": 0.4, "stribeck_velocity": 0.05, "bristle_stiffness": 200.0},
    "ElastoPlasticJointFriction": {"coulomb_friction": 0.4, "stribeck_velocity": 0.05, "bristle_stiffness": 200.0},
    "RegularisedFriction": {"coulomb_friction": 0.4, "stribeck_velocity": 0.05, "creep_velocity": 0.01},
    "BoucWenSpring": {"stiffness": 30.0, "yield_twist": 0.05, "rest_angle": 0.2},
    "HardeningSpring": {"stiffness": 30.0, "cubic_stiffness": 200.0, "rest_angle": 0.2},
    "StructuralSpring": {"stiffness": 30.0, "loss_factor": 0.1, "lowest_frequency": 1.0, "highest_frequency": 100.0},
    "GroundSpring": {"stiffness": 30.0, "damping": 0.1, "rest_angle": 0.2},
    "TorqueCurve": {"lower": -1.0, "upper": 1.0, "points": 3, "heights": [0.5, 0.0, -0.2]},
    "Vibration": {"amplitude": 0.7, "frequency": 12.0, "phase": 0.3},
    "QuadraticDrag": {"drag": 0.5},
    "WarmingFriction": {"coulomb_friction": 0.4, "heat_capacity": 0.4, "thermal_resistance": 9.0},
    "LoadDependentFriction": {
        "coefficient": 0.4,
        "quadratic_coefficient": 0.3,
        "static_ratio": 1.5,
        "stribeck_velocity": 0.05,
    },
}  # fmt: skip
"""Parameters in SI units; a lever of a metre makes the twin's the same numbers."""

ELSEWHERE = {"Inertia", "Fixed", "Torque", "PrescribedMotion", "Tachometer"}
"""Twins that stand in the rig below, or have closed forms of their own in other files."""


def test_every_law_is_tried_here() -> None:
    assert set(TWINS) == set(VALUES) | ELSEWHERE


@pytest.mark.parametrize("name", sorted(VALUES))
def test_a_twin_moves_as_its_law_on_a_lever_of_a_metre(name: str) -> None:
    kind, values = TWINS[name], VALUES[name]
    twin, names = registry()[kind.slide_twin], dict(kind.slide_names)
    assert twin.__doc__
    assert twin.__doc__ != kind.__doc__
    moved = []
    for made, mass, port in (
        (kind(**values), "Inertia", "shaft"),
        (twin(**{names.get(key, key): value for key, value in values.items()}), "Mass", "flange"),
    ):
        size = {"inertia" if mass == "Inertia" else "mass": 0.5}
        body, other = registry()[mass](**size), registry()[mass](**size)
        parts: dict[str, Block] = {"body": body, "other": other, "law": made}
        flanges = [p.name for p in made.ports.values() if p.role == "flange"]
        assert {made.ports[f].kind for f in flanges} == {ROTATIONAL if port == "shaft" else TRANSLATIONAL}
        wires = [f"body.{port} law.{flanges[0]}"] + [f"other.{port} law.{f}" for f in flanges[1:]]
        for k, port_in in enumerate(p.name for p in made.ports.values() if p.role == "input"):
            parts[f"feed{k}"] = Constant(value=0.7)
            wires.append(f"feed{k}.out law.{port_in}")
        result = run(parts, *wires, stop=1.0, initial={f"body.{port}.speed": 1.0}, internal_step=5e-5)
        moved.append(result)
    turning, sliding = moved
    np.testing.assert_allclose(sliding["body.flange.position"], turning["body.shaft.angle"], rtol=0, atol=1e-13)
    assert balance(sliding) < 1e-6


@pytest.mark.parametrize(
    "unit", ["N.m/rad", "N.m.s/rad", "N.m.s2/rad2", "N.m/rad3", "rad/s", "rad", "kg.m2", "V.s/rad"]
)
def test_units_lose_a_lever_for_each_newton_and_two_for_each_kilogram(unit: str) -> None:
    """Dimensional analysis by an independent library: a sliding quantity is the turning one by a lever r = 1 m.

    angle = position / r, torque = force r, inertia = mass r^2.
    """
    (one, before), (other, after) = base_units(unit), base_units(along_slide(unit))
    assert one == other == 1.0
    lengths = before.get("meter", 0.0) - after.get("meter", 0.0)
    levers = {"N": 1, "k": 2}.get(unit[0], 0)
    assert lengths == levers - before.get("radian", 0.0)
    assert {k: v for k, v in before.items() if k not in ("meter", "radian")} == {
        k: v for k, v in after.items() if k != "meter"
    }


def test_a_twin_of_a_law_of_ones_own() -> None:
    class Slack(SpringDamper):
        """Spring that is weaker by a share."""

        share = parameter("1", 0.5, "share of the torque")

    class SlidingSlack(Slack, slide={}):
        """The same along a slide."""

    assert SlidingSlack.parameters["stiffness"].unit == "N/m"
    assert SlidingSlack.parameters["share"].doc == "share of the force"
    assert list(SlidingSlack.ports) == ["a", "b", "compression", "force"]
    assert SlidingSlack(stiffness="3 N/mm", rest_distance=0.1).rest_angle == 0.1
    assert Slack.slide_twin == "SlidingSlack"
    assert SpringDamper.slide_twin == "TranslationalSpringDamper"
    with pytest.raises(ParameterError, match="declares no 'angle'"):

        class Wrong(Slack, slide={"angle": "x"}):
            """Names what is not there."""
