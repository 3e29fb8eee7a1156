"""Physical quantities: Modelica unit spelling, conversion by pint, declared parameters.

Units are spelled as in Modelica (``N.m/rad``, ``kg.m2``). pint does the arithmetic; it is imported on first use
because it costs a third of a second, and what it says is kept (`engine.known_units`). Angles count as dimensionless in
pint, so rates of turns against rad/s need care: 10 Hz is 62.83 rad/s, which pint would call 10, and 600 1/min too, as
data sheets of drives write it.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Container
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from engine.errors import ParameterError
from engine.known_units import known
from engine.unit_names import likely

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(
    r"^\s*([-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:inf|nan))\s*(.*?)\s*$", re.IGNORECASE
)
_COMMA = re.compile(r"^\s*([-+]?\d+),(\d.*?)\s*$")
"""A number with a comma, and what is behind that."""
_POWER = re.compile(r"(?<=[A-Za-z])(-?\d+)")
_SPELLING = {"1": "dimensionless", "": "dimensionless", "%": "percent", "r/min": "rpm", "U/min": "rpm"}
_WORDS = {"Ohm": "ohm", "rev": "revolution"}
_WORD = re.compile(r"Ohm\b|\brev\b")
"""Words of Modelica and of data sheets that pint spells otherwise; prefixes stay."""
_LONGEST = 200
"""Characters of a quantity."""
_NO_UNIT = re.compile(r"(?<![A-Za-z0-9^*.-])(?!1(?![0-9.]))[0-9]|[0-9]{3}|[0-9.]\s*(\^|\*\*)|[0-9.][eE][-+0-9]")
"""Numbers that no unit holds: other than 1, unless a short exponent. A power of a power would take hours."""


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(cache_folder=None)
    return registry


@functools.cache
def _unit(text: str) -> Any:
    """The pint unit of a Modelica unit string.

    Raises:
        ParameterError: the unit is unknown.
    """
    try:
        return _parsed(text)
    except Exception as error:
        raise _unknown(text) from error


def _parsed(text: str) -> Any:
    """The pint unit of a Modelica unit string, or what pint raises."""
    if len(text) > _LONGEST or _NO_UNIT.search(text):
        raise ValueError(text)
    spelled = _SPELLING.get(text.strip(), text.strip())
    spelled = _WORD.sub(lambda word: _WORDS[word[0]], spelled)
    spelled = _POWER.sub(r"**\1", spelled.replace(" ", "*").replace("^", "**"))
    spelled = re.sub(r"(?<=[A-Za-z0-9)])\.(?=[A-Za-z(])", "*", spelled)
    unit = _registry().Unit(spelled)
    _ = unit.dimensionality  # pint finds some mistakes only here
    return unit


def _unknown(text: str) -> ParameterError:
    shown = text if len(text) <= 40 else f"{text[:40]}..."
    manner = "write units as in Modelica: N.m/rad, kg.m2, rad/s, V, mm, deg"
    if text[:1] in tuple("*/+-^("):
        return ParameterError(
            f"unknown unit '{shown}'", remedy="a sum or product of numbers begins with '=': = 2 * 3 m"
        )
    meant = likely(text, "", _parsed)
    return ParameterError(f"unknown unit '{shown}'", remedy=f"did you mean '{meant}'? {manner}" if meant else manner)


@known
def factor(source: str, target: str) -> float:
    """Factor that converts a number from ``source`` units to ``target`` units.

    Raises:
        ParameterError: the two measure different things, or are offset or logarithmic scales (degC, dB).
    """
    if source == target:
        return 1.0
    a, b = _unit(source), _unit(target)
    if a.dimensionality != b.dimensionality:
        meant = likely(source, target, _parsed)
        remedy = f"did you mean '{meant}'?" if meant else ""
        raise ParameterError(f"unit '{source}' does not fit: '{target}' is expected", remedy=remedy)
    registry = _registry()
    try:
        value, twice = (float(registry.Quantity(n, a).to(b).magnitude) for n in (1.0, 2.0))
    except Exception as error:
        raise ParameterError(f"unit '{source}' cannot be converted to '{target}'") from error
    if not 0 < abs(value) < math.inf or abs(twice - 2 * value) > 1e-9 * abs(value):
        raise ParameterError(
            f"unit '{source}' is not a multiple of '{target}'", remedy="give the number in another unit"
        )
    cycles = _turns(a) - _turns(b)
    if cycles and (_angle(b) - _angle(a)) * cycles > 0:
        value *= (2 * math.pi) ** cycles
    return value


def _turns(unit: Any) -> int:
    """The power of turns in a time that a unit has without saying so: hertz, and a minute to the power of 1 or -1.

    Of a minute to another power nobody says whether it counts turns.
    """
    hertz = int(sum(power for name, power in unit._units.items() if name.endswith("hertz")))
    minutes = int(unit._units.get("minute", 0))
    return hertz - (minutes if abs(minutes) == 1 else 0)


def _angle(unit: Any) -> int:
    angular = ("radian", "degree", "revolution", "turn", "revolutions_per_minute")
    return int(sum(power for name, power in unit._units.items() if name.endswith(angular)))


@known
def coherent(text: str) -> tuple[float, str]:
    """Factor to, and Modelica spelling of, the coherent SI unit of the same quantity: ``mV`` gives (1e-3, ``V``).

    Angles stay (``deg/V`` gives ``rad/V``), and a rate in hertz or in 1/min becomes rad/s, as everywhere in this
    library.

    Raises:
        ParameterError: the unit is unknown, or an offset scale (degC).
    """
    registry = _registry()
    numerator: list[str] = []
    denominator: list[str] = []
    try:
        parts = _coherent_parts(_unit(text))
    except ParameterError:
        raise
    except Exception as error:
        raise _unknown(text) from error
    for name, power in parts.items():
        symbol = name if name == "ohm" else registry.get_symbol(name)
        spelled = symbol + (f"{abs(power):g}" if abs(power) != 1 else "")
        (numerator if power > 0 else denominator).append(spelled)
    below = ".".join(denominator) if len(denominator) < 2 else f"({'.'.join(denominator)})"
    spelling = (".".join(numerator) or "1") + (f"/{below}" if below else "")
    return factor(text, spelling), spelling


def _coherent_parts(unit: Any) -> dict[str, float]:
    """Powers of coherent unit names: each part of a unit without its prefix, or by its base units."""
    registry = _registry()
    if dict(unit._units) == {"minute": -1}:
        return {"radian": 1, "second": -1}
    parts: dict[str, float] = {}
    for name, power in unit._units.items():
        plain = registry.parse_unit_name(name)[0][1]
        one = registry.Quantity(1.0, plain).to_base_units()
        inner = one.units._units if plain == "hertz" or one.magnitude != 1.0 else {plain: 1}
        if plain == "hertz":
            inner = {"radian": 1, "second": -1}
        for base, exponent in inner.items():
            parts[base] = parts.get(base, 0) + exponent * power
    return {name: power for name, power in parts.items() if power and name != "count"}


def base_units(text: str) -> tuple[float, dict[str, float]]:
    """Factor to base units, and the power of each base unit by pint's name; radians count.

    Raises:
        ParameterError: the unit is unknown.
    """
    scale, powers = _base_units(text)
    return scale, dict(powers)


@known
def _base_units(text: str) -> tuple[float, tuple[tuple[str, float], ...]]:
    one: Any = _registry().Quantity(1.0, _unit(text)).to_base_units()
    return float(one.magnitude), tuple((str(name), float(power)) for name, power in one.units._units.items())


def compatible(a: str, b: str) -> bool:
    """Whether two units measure the same thing; ``*`` fits everything."""
    if "*" in (a, b) or a == b:
        return True
    return _dimension(a) == _dimension(b)


@known
def _dimension(text: str) -> tuple[tuple[str, float], ...]:
    """Powers of what a unit measures; angles and pure numbers have none."""
    return tuple(sorted((str(name), float(power)) for name, power in _unit(text).dimensionality.items()))


def number_or_text(text: str) -> float | str:
    """A value as YAML takes it: a number where it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def split(text: str, unit: str = "N.m/A") -> tuple[float, str]:
    """Number and unit of a text such as ``7.68 mN.m/A``.

    Args:
        text: it.
        unit: of an example, for who gave no number.

    Raises:
        ParameterError: the text does not start with a number.
    """
    match = _NUMBER.match(text)
    if not match:
        kind = "a number with a unit" if _named(unit) else "a number"
        raise ParameterError(f"'{text}' is not {kind}", remedy=f"write for example '{f'7.68 {_named(unit)}'.strip()}'")
    if comma := _COMMA.match(text):
        raise ParameterError(
            f"'{text}' has a comma in its number",
            remedy=f"write a decimal point, '{comma[1]}.{comma[2]}', and no separators of thousands",
        )
    return float(match.group(1).replace("_", "")), match.group(2)


def _named(unit: str) -> str:
    """The unit, where there is one to name."""
    return "" if unit in ("1", "*") else unit


def _in(unit: str) -> str:
    """The unit in a sentence, where there is one to name."""
    return f" in {_named(unit)}" if _named(unit) else ""


def convert(value: object, unit: str) -> float:
    """A number, or a text with a unit, as a float in ``unit``; a bare number is taken to be in ``unit``.

    Where ``unit`` is ``*`` any unit fits and the result is in the coherent SI unit of what was given.

    Raises:
        ParameterError: not a number, not finite, or another kind of quantity.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ParameterError(f"{value!r} is not a number{_in(unit)}")
    if isinstance(value, str):
        number, given = split(value, "N.m/A" if unit == "*" else unit)
        try:
            scale = (coherent(given)[0] if unit == "*" else factor(given, unit)) if given else 1.0
        except ParameterError as error:
            raise ParameterError(f"'{value}': {error.message}", remedy=error.remedy) from error
    else:
        try:
            number, scale = float(value), 1.0
        except OverflowError as error:
            raise ParameterError("a whole number too large for a float", remedy=f"give a number{_in(unit)}") from error
    result = number * scale
    if not math.isfinite(result):
        raise ParameterError(f"{value!r} is not a finite number", remedy=f"give a number{_in(unit)}")
    return result


@dataclass(frozen=True)
class SameAs:
    """A default that is another parameter of the same block; both then share one symbol.

    Attributes:
        other: the parameter that stands in.
        instead: parameters that stand in before ``other`` does, the first of them that is given.
    """

    other: str
    instead: tuple[str, ...] = ()

    def choose(self, given: Container[str]) -> str:
        """The parameter that stands in, when those in ``given`` have values of their own."""
        return next((name for name in self.instead if name in given), self.other)

    def __str__(self) -> str:
        return " or ".join((*self.instead, self.other))


@dataclass(frozen=True)
class Parameter:
    """Declaration of one parameter. It feeds validation, schema, documentation, FMU variables and fitting.

    Attributes:
        name: attribute name in the block.
        unit: coherent SI unit in Modelica spelling; values are stored in it. ``*`` takes any unit and stores the value
            in the coherent SI unit of what was given.
        default: value when none is given; ``...`` means it must be given; a `SameAs` means that of another parameter.
        doc: one sentence.
        gt, ge, lt, le: open and closed bounds.
        nonzero: 0 is refused and either sign is allowed, as for the ratio of a gear; see `signed`.
        tolerance: relative uncertainty that fitting may use (0.1 is 10 %); None if it is not for fitting.
        size: name of the block's option that gives the length of a vector (by its sum, if it is a vector itself), or
            empty for a scalar.
        structural: fixes the equations' shape, so it cannot be tuned after the model is built.
    """

    name: str
    unit: str
    default: Any
    doc: str
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    tolerance: float | None = None
    size: str = ""
    structural: bool = False
    nonzero: bool = False

    @property
    def required(self) -> bool:
        """Whether the user must give a value."""
        return self.default is ...

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound, infinite where none is declared."""
        low = self.gt if self.gt is not None else self.ge
        high = self.lt if self.lt is not None else self.le
        return (-math.inf if low is None else low, math.inf if high is None else high)

    @property
    def limits(self) -> str:
        """The bounds in words, empty when there are none."""
        signs = ((">", self.gt), (">=", self.ge), ("<", self.lt), ("<=", self.le))
        stated = [f"{sign} {bound:g}" for sign, bound in signs if bound is not None]
        return " and ".join([*stated, "other than 0"] if self.nonzero else stated)

    def signed(self, value: float) -> Parameter:
        """The declaration within a model that was built with ``value``: a nonzero parameter keeps its sign."""
        if not self.nonzero:
            return self
        if value > 0:
            return replace(self, nonzero=False, gt=0.0)
        return replace(self, nonzero=False, lt=0.0)

    def check(self, value: object) -> float:
        """The value in the declared unit.

        Raises:
            ParameterError: wrong kind, unit or range.
        """
        number = convert(value, self.unit)
        outside = (
            (self.gt is not None and number <= self.gt)
            or (self.ge is not None and number < self.ge)
            or (self.lt is not None and number >= self.lt)
            or (self.le is not None and number > self.le)
            or (self.nonzero and number == 0)
        )
        if outside:
            unit = "" if self.unit in ("1", "*") else f" {self.unit}"
            raise ParameterError(f"{value!r} is out of range: {self.name} must be {self.limits}{unit}")
        return number


@dataclass(frozen=True)
class Option:
    """A choice that shapes a block's equations: a count, a switch, or one of several laws.

    Attributes:
        name: attribute name in the block.
        kind: ``int``, ``bool``, ``str``, or ``list`` for a matrix, kept as a tuple of rows.
        default: value when none is given; ``...`` means it must be given.
        doc: one sentence.
        choices: allowed texts, for ``str``.
        ge, le: bounds, for ``int``.
        size: name of an option declared before that gives the length of a vector, or empty for a single value.
    """

    name: str
    kind: type
    default: Any
    doc: str
    choices: tuple[str, ...] = ()
    ge: int | None = None
    le: int | None = None
    size: str = ""

    @property
    def required(self) -> bool:
        """Whether the user must give a value."""
        return self.default is ...

    def check(self, value: object) -> Any:
        """The value, if it is allowed.

        Raises:
            ParameterError: wrong kind or not among the choices.
        """
        from engine.errors import nearest

        if self.kind is bool and isinstance(value, bool):
            return value
        if self.kind is int and isinstance(value, int) and not isinstance(value, bool):
            if (self.ge is not None and value < self.ge) or (self.le is not None and value > self.le):
                raise ParameterError(f"{value} is out of range: {self.name} must be in [{self.ge}, {self.le}]")
            return value
        if self.kind is str and isinstance(value, str):
            if self.choices and value not in self.choices:
                raise ParameterError(f"'{value}' is not a choice for {self.name}", remedy=nearest(value, self.choices))
            return value
        if self.kind is list:
            return self._matrix(value)
        kinds = {bool: "true or false", int: "a whole number", str: "a text"}
        raise ParameterError(f"{value!r} does not fit: {self.name} is {kinds[self.kind]}")

    def _matrix(self, value: Any) -> tuple[tuple[float, ...], ...]:
        """Rows of numbers; a list of numbers is one row, a number is one row of one."""
        value = value.tolist() if hasattr(value, "tolist") else value
        rows = list(value) if isinstance(value, list | tuple) else [value]
        if not any(isinstance(row, list | tuple) for row in rows):
            rows = [rows] if rows else []
        lengths = [len(row) if isinstance(row, list | tuple) else 0 for row in rows]
        if rows and (min(lengths) == 0 or min(lengths) != max(lengths)):
            raise ParameterError(
                f"{self.name} is not a matrix: its rows have lengths {', '.join(map(str, lengths))}",
                remedy="write rows of equal length: [[1, 2], [3, 4]]",
            )
        return tuple(tuple(convert(item, "1") for item in row) for row in rows)
