"""Errors that say what was given, where, what is allowed, and the nearest right name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Where:
    """A place in the user's file: file name, line (1-based), and the path of keys that leads there."""

    file: str = ""
    line: int = 0
    path: str = ""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.file and self.line else self.file
        return f"{place}: {self.path}" if place and self.path else place or self.path


class FlexarmError(Exception):
    """A problem with what the user gave, explained so that the user can repair it.

    Args:
        message: what is wrong, repeating the value received.
        where: the place in the user's file, if known.
        remedy: what to do about it.
        signal: the signal it is about, by its full name, if it is about one; who knows where the user named it adds the
            place.
    """

    def __init__(self, message: str, where: Where | None = None, remedy: str = "", *, signal: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.remedy = remedy
        self.signal = signal

    def at(self, where: Where) -> FlexarmError:
        """The same error with its place filled in, unless it already knows one."""
        if self.where is None:
            self.where = where
        return self

    def __str__(self) -> str:
        place = f"{_short(str(self.where))}: " if self.where and str(self.where) else ""
        remedy = f"\n  {self.remedy}" if self.remedy else ""
        return _printable(f"{place}{_short(self.message)}{remedy}")


LONGEST = 1000
"""Characters of a message; what was given may be a megabyte of text."""


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 200]} ... {text[-190:]}"


def _printable(text: str) -> str:
    """Characters as escapes that no stream can write, or that a terminal would obey: halves, controls, turns."""
    return "".join(c if c == "\n" or c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class ParameterError(FlexarmError):
    """A parameter's value, unit or name cannot be used."""


class ConnectionProblem(FlexarmError):
    """Blocks are wired in a way that has no meaning."""


class StructureError(FlexarmError):
    """The assembled equations cannot be solved: a massless node, a closed loop of ties, an algebraic loop."""


class SimulationError(FlexarmError):
    """A simulation could not be carried to its end."""


class TrimError(FlexarmError):
    """There is no equilibrium, or more than one and nothing says which."""


class CompilerUnavailable(FlexarmError):
    """No C compiler could be run."""


NEAR = 0.71
"""Likeness (`difflib.SequenceMatcher.ratio`) from which a name is suggested in place of another."""
MOST_SHOWN = 700
"""Characters of a list of names."""


def nearest(name: str, allowed: Iterable[str]) -> str:
    """A sentence that names the nearest allowed name, or else what is allowed: all, or how many more there are."""
    names = list(dict.fromkeys(allowed))
    if not names:
        return "none is allowed here"
    likeness = {other: _likeness(name, other) for other in names}
    near = sorted((other for other in names if likeness[other][0] >= NEAR), key=lambda other: likeness[other])[::-1]
    if near:
        equal = [f"'{other}'" for other in near if likeness[other][0] == likeness[near[0]][0]][:3]
        return f"did you mean {' or '.join([', '.join(equal[:-1]), equal[-1]] if len(equal) > 1 else equal)}?"
    shown, length = 0, 0
    while shown < len(names) and (shown < 3 or length + len(names[shown]) <= MOST_SHOWN):
        length += len(names[shown]) + 2
        shown += 1
    more = f", and {len(names) - shown} more" if shown < len(names) else ""
    return f"allowed: {', '.join(names[:shown])}{more}"


def _likeness(name: str, other: str) -> tuple[float, float]:
    """Likeness from 0 to 1, and that of the letters, which decides between equals.

    Two letters in the other order, a part between dots, a beginning or an ending are nearer than letters that happen
    to agree.
    """
    a, b = name.lower(), other.lower()
    letters = difflib.SequenceMatcher(None, b, a).ratio()
    if a == b:
        return 1.0, letters
    if len(a) == len(b) and sum(x != y for x, y in zip(a, b, strict=True)) == 2 and sorted(a) == sorted(b):
        return max(0.95, letters), letters
    if len(a) >= 3 and (f".{a}." in f".{b}." or b.startswith(f"{a}_") or b.endswith(f"_{a}")):
        return max(0.9, letters), letters
    if (len(a) >= 3 and b.startswith(a)) or (len(a) >= 4 and b.endswith(a)):
        return max(0.8, letters), letters
    return letters, letters
