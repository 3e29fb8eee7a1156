"""Eddy-current drag concealed in the rig's recordings: it is found, at its place and with its sizes."""

import pytest

import flexarm
from flexarm.effects import possible_effects

GREATEST_TORQUE, CRITICAL_SPEED = 0.2, 40.0
"""Those of rig.py."""

RIVALS = {"coulomb_friction", "stribeck_friction", "viscous_friction", "quadratic_drag", "wrong_parameter"}
"""Effects that are tried beside it here; beside the whole catalogue it is found as well, and that takes longer."""


def test_the_drag_that_the_model_leaves_out_is_found(rig):
    """The rig is integrated without flexarm; its drag is the only effect that the model lacks."""
    others = {c.effect for c in possible_effects(rig)} - RIVALS - {"eddy_current_drag"}
    found = flexarm.diagnose(rig, workers=1, without=sorted(others))
    assert found.verdict == "named"
    (finding,) = found.findings
    assert (finding["effect"], finding["place"]) == ("eddy_current_drag", "motor.shaft")
    assert finding["explained"] > 0.99
    for name, truth in (("greatest_torque", GREATEST_TORQUE), ("critical_speed", CRITICAL_SPEED)):
        size = finding["parameters"][name]
        assert size["low"] < truth < size["high"]
        assert size["value"] == pytest.approx(truth, rel=0.05)


def test_it_is_tried_at_shafts_alone(rig):
    """At no signal, and nowhere if it is left out."""
    drags = [c for c in possible_effects(rig) if c.effect == "eddy_current_drag"]
    assert [c.place for c in drags] == ["motor.shaft"]
    assert "eddy_current_drag" not in {c.effect for c in possible_effects(rig, without=["eddy_current_drag"])}
