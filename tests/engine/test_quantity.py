"""Rates of turns, which units often leave unsaid, and spellings of data sheets."""

from __future__ import annotations

import math

import pytest

from engine.errors import ParameterError
from engine.quantity import coherent, convert

TURN = 2 * math.pi


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [
        ("3000 rpm", "rad/s", 50 * TURN),
        ("3000 1/min", "rad/s", 50 * TURN),
        ("3000 min-1", "rad/s", 50 * TURN),
        ("3000 rev/min", "rad/s", 50 * TURN),
        ("3000 r/min", "rad/s", 50 * TURN),
        ("3000 U/min", "rad/s", 50 * TURN),
        ("50 rev/s", "rad/s", 50 * TURN),
        ("50 Hz", "rad/s", 50 * TURN),
        ("180 rad/min", "rad/s", 3.0),
        ("180 deg/min", "rad/s", math.pi / 60),
        ("60 1/min", "1/s", 1.0),  # a rate that is none of turns
        ("60 rpm", "Hz", 1.0),
        ("3 Hz", "rpm", 180.0),
        ("60 rpm", "1/min", 60.0),
        ("2 V/rpm", "V.s/rad", 2 * 60 / TURN),
        ("2 V.min", "V.s/rad", 2 * 60 / TURN),
        ("5 min", "s", 300.0),
        ("2.6 Ohm", "ohm", 2.6),
        ("3 kOhm", "ohm", 3e3),
    ],
)
def test_turns_and_spellings(given: str, unit: str, expected: float) -> None:
    assert convert(given, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("text", ["rpm", "1/min", "min-1", "Hz"])
def test_rates_of_turns_become_radians_a_second(text: str) -> None:
    scale, unit = coherent(text)
    assert unit == "rad/s"
    assert scale == pytest.approx(TURN if text == "Hz" else TURN / 60, rel=1e-12)


def test_a_decimal_comma_is_named() -> None:
    with pytest.raises(ParameterError, match=r"has a comma in its number\n  write a decimal point, '10\.5 N\.m/rad'"):
        convert("10,5 N.m/rad", "N.m/rad")
