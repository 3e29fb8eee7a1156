"""Outputs that are asked for stay in the FMU though nothing there uses them."""

from __future__ import annotations

from flexarm.cut import cut
from scenarios.load import load


def test_a_filter_whose_consumer_is_bypassed_can_be_an_output() -> None:
    """The voltage is driven from outside, so the controller goes; the filter before it is asked for and stays."""
    made = cut(load("reference-b"), "export", inputs=["motor.voltage"], outputs=["filter.out", "motor.shaft.speed"])
    assert [variable.name for variable in made.model.outputs] == ["filter.out", "motor.shaft.speed"]
    assert "pi" in made.bypassed
    assert "filter" not in made.bypassed
    plain = cut(load("reference-b"), "export", inputs=["motor.voltage"], outputs=["motor.shaft.speed"])
    assert "filter" in plain.bypassed
