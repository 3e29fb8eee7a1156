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


class CompilerUnavailable(FlexarmError):
    """No C compiler could be run."""


def nearest(name: str, allowed: Iterable[str]) -> str:
    """A sentence that names the nearest allowed name, or all of them when there are few."""
    names = list(dict.fromkeys(allowed))
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    if not names:
        return "none is allowed here"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"allowed: {shown}"
