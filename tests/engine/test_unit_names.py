"""A unit that is unknown, or does not fit, is refused with the spelling that was likely meant."""

import pytest

from engine.errors import ParameterError
from engine.quantity import convert

UNKNOWN = {
    "RPM": "rpm",
    "gcm2": "g.cm2",
    "kg-m^2": "kg.m^2",
    "Vs/rad": "V.s/rad",
    "V/kRPM": "V/krpm",
    "V/dps": "V/(deg/s)",
    "V/gcm2": "V/(g.cm2)",
    "oz-in": "ozf.in",
    "Nm/Rad": "N.m/rad",
    "hz": "Hz",
    "vlt": "V",
}

MISFITS = {
    ("Nm", "N.m"): "N.m",
    ("mNm/A", "N.m/A"): "mN.m/A",
    ("Nms/rad", "N.m.s/rad"): "N.m.s/rad",
    ("A/Nm", "A/(N.m)"): "A/(N.m)",
    ("kg.cm", "N.m"): "kgf.cm",
    ("amps", "A"): "A",
    ("rads", "rad/s"): "rad/s",
    ("S", "s"): "s",
}


@pytest.mark.parametrize("written", UNKNOWN)
def test_an_unknown_unit_is_refused_with_the_nearest(written: str) -> None:
    with pytest.raises(ParameterError, match="unknown unit") as caught:
        convert(f"1 {written}", "*")
    assert f"did you mean '{UNKNOWN[written]}'?" in str(caught.value)
    assert convert(f"1 {UNKNOWN[written]}", "*") > 0


@pytest.mark.parametrize(("written", "target"), MISFITS)
def test_a_unit_of_something_else_is_refused_with_one_that_fits(written: str, target: str) -> None:
    """To pint, Nm is a unit of yarn and amps a speed."""
    with pytest.raises(ParameterError, match="does not fit") as caught:
        convert(f"1 {written}", target)
    meant = MISFITS[written, target]
    assert f"did you mean '{meant}'?" in str(caught.value)
    assert convert(f"1 {meant}", target) > 0


@pytest.mark.parametrize(("written", "target"), [("xyz", "*"), ("V", "N.m"), ("Nm" * 40, "*")])
def test_nothing_is_suggested_where_nothing_is_near(written: str, target: str) -> None:
    with pytest.raises(ParameterError) as caught:
        convert(f"1 {written}", target)
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "said", "example"),
    [
        ("s", "a number with a unit", "7.68 s"),
        ("1", "a number", "7.68"),
        ("*", "a number with a unit", "7.68 N.m/A"),
    ],
)
def test_what_is_no_number_is_shown_one_in_the_unit_that_is_wanted(unit: str, said: str, example: str) -> None:
    with pytest.raises(ParameterError) as refused:
        convert("abc", unit)
    assert refused.value.message == f"'abc' is not {said}"
    assert refused.value.remedy == f"write for example '{example}'"
