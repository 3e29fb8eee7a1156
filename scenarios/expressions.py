"""Arithmetic in the values of a scenario: ``0.5 * $mass * $radius^2``, with units checked.

A value that holds a ``$name`` and more than it, or that begins with ``=``, is an expression::

    parameters:
      mass: 2 kg
      radius: 50 mm
      inertia: 0.5 * $mass * $radius^2
    blocks:
      disc: {type: Inertia, inertia: $inertia}
      rope: {type: Pulley, radius: $radius - 2 mm}
      plate: {type: Mass, mass: "= 7850 kg/m3 * 0.2 m * 0.3 m * 5 mm"}

It knows ``+ - * / ^`` (or ``**``), brackets, numbers with or without a unit, ``pi`` and the `FUNCTIONS`; ``2 m^3`` is
two cubic metres, ``(2 m)^3`` eight. Sums need one unit, exponents and functions pure numbers; angles count as pure
numbers, and a frequency in hertz is in rad/s as everywhere. The parser is a recursive descent over these and nothing
else: no names but parameters, no code.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engine.errors import ParameterError
from engine.quantity import base_units, coherent, convert, split

PLAIN = re.compile(r"\s*\$[A-Za-z_]\w*\s*")
"""The name of a parameter alone."""

FUNCTIONS = ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "abs", "min", "max")
LONGEST = 1000
"""Characters of an expression."""
DEEPEST = 40
"""Brackets within brackets, and parameters within parameters."""

_SYMBOL = r"[A-Za-zµμΩ°%]+(?:\^?\d+)?"
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    rf"(?:\s*(?P<unit>(?:1/)?{_SYMBOL}(?:\.{_SYMBOL})*(?:/(?:{_SYMBOL}|\({_SYMBOL}(?:[./]{_SYMBOL})*\)))*(?![\w$(])))?"
    r"|\$(?P<name>[A-Za-z_]\w*)|(?P<word>[A-Za-z_]\w*)|(?P<sign>\*\*|[-+*/^(),]))"
)

Powers = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Amount:
    """A value in SI units, a number or a symbol, and the powers of its base units; angles count as numbers."""

    value: Any
    powers: Powers = ()

    @property
    def unit(self) -> str:
        """Spelling of the unit: ``kg.m2/s2``."""
        parts: dict[bool, list[str]] = {True: [], False: []}
        for symbol, power in self.powers:
            parts[power > 0].append(symbol + (f"{abs(power):g}" if abs(power) != 1 else ""))
        below = ".".join(parts[False])
        return (".".join(parts[True]) or "1") + (
            f"/({below})" if len(parts[False]) > 1 else f"/{below}" if below else ""
        )


_SYMBOLS = {
    "meter": "m",
    "kilogram": "kg",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
}

Leaf = Callable[[str], Amount]


def is_expression(value: object) -> bool:
    """Whether a value is more than a number, a text with a unit or the name of a parameter."""
    if not isinstance(value, str):
        return False
    return value.lstrip().startswith("=") or ("$" in value and not PLAIN.fullmatch(value))


def amount(value: object) -> Amount:
    """A number or a text with a unit, as an amount."""
    unit = split(value)[1] if isinstance(value, str) else ""
    return Amount(convert(value, "*"), powers(unit))


def powers(unit: str) -> Powers:
    """Powers of base units, angles left out; ``*`` has none."""
    if unit in ("", "1", "*"):
        return ()
    found = base_units(coherent(unit)[1])[1]
    return tuple(sorted((_SYMBOLS[name], power) for name, power in found.items() if name in _SYMBOLS and power))


def evaluate(text: str, leaf: Leaf) -> Amount:
    """The value of an expression.

    Args:
        text: the expression.
        leaf: the amount of a parameter by its name.

    Raises:
        ParameterError: it cannot be read, or units do not fit; the message shows the place in it.
    """
    return _Parser(text, leaf).result()


@dataclass
class _Parser:
    text: str
    leaf: Leaf
    place: int = 0
    depth: int = 0
    kind: str = field(default="", init=False)
    token: str = field(default="", init=False)
    unit: str = field(default="", init=False)

    def result(self) -> Amount:
        if len(self.text) > LONGEST:
            raise ParameterError(f"an expression has at most {LONGEST} characters")
        start = re.match(r"\s*=", self.text)
        self.place = start.end() if start else 0
        self.next()
        try:
            found = self.sum()
        except (OverflowError, ZeroDivisionError, ValueError) as error:
            raise self.wrong(f"it cannot be worked out: {error}") from None
        if self.kind:
            raise self.wrong(
                f"'{self.text[self.start : self.place].strip()}' is not expected here", "write * between factors"
            )
        if isinstance(found.value, int | float) and not math.isfinite(found.value):
            raise self.wrong("its value is not finite")
        return found

    def next(self) -> None:
        while self.place < len(self.text) and self.text[self.place].isspace():
            self.place += 1
        self.start = self.place
        if self.place == len(self.text):
            self.kind = self.token = ""
            return
        found = _TOKEN.match(self.text, self.place)
        if not found:
            self.token = self.text[self.place]
            raise self.wrong(f"'{self.token}' has no meaning")
        self.kind = str(found.lastgroup if found.lastgroup != "unit" else "number")
        self.token, self.unit = found[self.kind], found["unit"] or ""
        self.place = found.end()

    def wrong(self, message: str, remedy: str = "") -> ParameterError:
        shown = self.text if len(self.text) <= 80 else f"{self.text[:70]}..."
        return ParameterError(f"'{shown}' at character {self.start + 1}: {message}", remedy=remedy)

    def takes(self, *signs: str) -> str:
        found = self.token if self.kind == "sign" and self.token in signs else ""
        if found:
            self.next()
        return found

    def sum(self) -> Amount:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.wrong(f"more than {DEEPEST} brackets within brackets")
        left = self.product()
        while sign := self.takes("+", "-"):
            right = self.product()
            self.same(left, right, "added" if sign == "+" else "subtracted")
            left = Amount(left.value + right.value if sign == "+" else left.value - right.value, left.powers)
        self.depth -= 1
        return left

    def same(self, left: Amount, right: Amount, what: str) -> None:
        if left.powers != right.powers:
            raise self.wrong(f"{left.unit} and {right.unit} cannot be {what}", "give each number its unit")

    def product(self) -> Amount:
        left = self.signed()
        while sign := self.takes("*", "/"):
            right = self.signed()
            value = left.value * right.value if sign == "*" else left.value / right.value
            left = Amount(value, _combined(left.powers, right.powers, 1 if sign == "*" else -1))
        return left

    def signed(self) -> Amount:
        sign = self.takes("+", "-")
        if sign:
            self.depth += 1
            if self.depth > DEEPEST:
                raise self.wrong("too many signs")
            found = self.signed()
            self.depth -= 1
            return Amount(-found.value, found.powers) if sign == "-" else found
        return self.power()

    def power(self) -> Amount:
        base = self.atom()
        if not self.takes("^", "**"):
            return base
        exponent = self.signed()
        self.pure(exponent, "an exponent")
        if not base.powers:
            return Amount(base.value**exponent.value, ())
        if not isinstance(exponent.value, int | float):
            raise self.wrong(f"{base.unit} cannot be raised to a power that depends on a parameter")
        share = float(exponent.value)
        return Amount(base.value**share, tuple((s, p * share) for s, p in base.powers if p * share))

    def pure(self, found: Amount, what: str) -> None:
        if found.powers:
            raise self.wrong(f"{what} must be a pure number, and this is in {found.unit}")

    def atom(self) -> Amount:
        kind, token, unit = self.kind, self.token, self.unit
        if kind == "number":
            try:
                found = amount(f"{token} {unit}".strip())
            except ParameterError as error:
                known = unit in FUNCTIONS or unit == "pi"
                raise self.wrong(error.message, f"write {token} * {unit}" if known else error.remedy) from None
            self.next()
            return found
        if kind == "name":
            found = self.leaf(token)
            self.next()
            return found
        if kind == "word":
            self.next()
            return self.word(token)
        if self.takes("("):
            found = self.sum()
            if not self.takes(")"):
                raise self.wrong("a bracket is not closed")
            return found
        raise self.wrong(f"a value is missing before '{token}'" if token else "it ends where a value should follow")

    def word(self, word: str) -> Amount:
        if word == "pi":
            return Amount(math.pi)
        if word not in FUNCTIONS:
            raise self.wrong(
                f"'{word}' is no function", f"a parameter is written ${word}; functions: {', '.join(FUNCTIONS)}, and pi"
            )
        if not self.takes("("):
            raise self.wrong(f"'{word}' needs brackets")
        given = [self.sum()]
        while self.takes(","):
            given.append(self.sum())
        if not self.takes(")"):
            raise self.wrong("a bracket is not closed")
        wanted = 2 if word in ("min", "max") else 1
        if len(given) != wanted:
            raise self.wrong(f"{word} takes {wanted} value{'s' if wanted > 1 else ''}, not {len(given)}")
        if word in ("min", "max"):
            self.same(given[0], given[1], "compared")
        elif word == "sqrt":
            return Amount(_call(word, given), tuple((s, p / 2) for s, p in given[0].powers))
        elif word != "abs":
            self.pure(given[0], f"the argument of {word}")
        return Amount(_call(word, given), given[0].powers)


def _combined(left: Powers, right: Powers, sign: int) -> Powers:
    made = dict(left)
    for symbol, power in right:
        made[symbol] = made.get(symbol, 0.0) + sign * power
    return tuple(sorted((symbol, power) for symbol, power in made.items() if power))


def _call(word: str, given: list[Amount]) -> Any:
    values = [one.value for one in given]
    if all(isinstance(value, int | float) for value in values):
        own: Mapping[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max}
        return own[word](*values) if word in own else getattr(math, word)(*values)
    import casadi

    return getattr(casadi, {"abs": "fabs", "min": "fmin", "max": "fmax"}.get(word, word))(*values)
