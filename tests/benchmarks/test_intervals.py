"""Intervals of the proof, on made-up findings."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.proof.intervals import covered

PLACE = "source.out -> motor.voltage"


def finding(effect: str, **parameters: tuple[float, float]) -> dict[str, Any]:
    rows = {name: {"value": (low + high) / 2, "low": low, "high": high} for name, (low, high) in parameters.items()}
    return {"status": "named", "effect": effect, "place": PLACE, "block": "motor", "parameters": rows}


@pytest.mark.parametrize(("low", "high", "holds"), [(39.0, 41.0, True), (9.0, 11.0, False)])
def test_a_supply_is_compared_at_the_voltage_that_it_is_told_for(low: float, high: float, holds: bool) -> None:
    """10 ohm at 5 V sag as 40 ohm at 10 V do; the voltage was chosen, and has no interval."""
    told = {"findings": [finding("supply_sag", resistance=(low, high), source_voltage=(10.0, 10.0))]}
    true = {
        "effect": "supply_sag",
        "place": PLACE,
        "same_place": [],
        "parameters": {"resistance": 10.0, "voltage": 5.0},
    }
    answer = {"true_parameters": {}, "concealed": [true], "nuisance": {"gain": 0.0}, "plant": "geared-two-mass"}
    assert covered(told, answer) == [("supply_sag.resistance", holds)]
