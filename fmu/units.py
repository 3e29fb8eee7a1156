"""Units for modelDescription.xml: exponents of the SI base units and the factor, by pint through `engine.quantity`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from engine.errors import ParameterError
from engine.quantity import base_units

_SYMBOL = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
    "radian": "rad",
}
_SHOWN_AS = {
    "rad": (("deg", 180 / math.pi),),
    "rad/s": (("deg/s", 180 / math.pi), ("rpm", 30 / math.pi)),
    "m": (("mm", 1e3),),
}


@dataclass(frozen=True)
class UnitDefinition:
    """A unit by its base units.

    Attributes:
        name: Modelica spelling.
        exponents: exponent of each base unit (``kg``, ``m``, ``s``, ``A``, ``K``, ``mol``, ``cd``, ``rad``).
        factor: value in base units = factor * value in this unit.
        shown_as: units for display: name, and what a value is multiplied by; empty if the unit cannot be resolved.
    """

    name: str
    exponents: dict[str, int]
    factor: float
    shown_as: tuple[tuple[str, float], ...] = ()


def definition(unit: str) -> UnitDefinition | None:
    """The definition of a unit, or None for a text that is not a unit of fixed meaning (empty, or ``*``)."""
    if unit in ("", "*"):
        return None
    try:
        factor, powers = base_units(unit)
    except ParameterError:
        return UnitDefinition(unit, {}, 1.0)
    exponents = {_SYMBOL[name]: round(power) for name, power in powers.items() if name in _SYMBOL}
    exact = all(name in _SYMBOL or name == "count" for name in powers) and all(p == round(p) for p in powers.values())
    return UnitDefinition(unit, exponents if exact else {}, factor if exact else 1.0, _SHOWN_AS.get(unit, ()))
