"""Numbers that began anew at the end of their range: signed ones that were stored without a sign, and counters.

A register of n bits holds 0 to 2^n - 1. A signed number in it is a two's complement: -1 is stored as 2^n - 1, and a
logger that reads it without the sign jumps by nearly 2^n wherever the number passes zero. A counter that turns jumps
at the same places, but has been everywhere in between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import Vector

SIGNED = {"int8": 8, "int16": 16, "int32": 32}
"""Bits of signed numbers, by the word of ``wrap:`` that stands for them."""

TURNS = {**{2.0**bits: f"2^{bits}" for bits in range(8, 33)}, 360.0: "360", 2 * math.pi: "2 pi"}
"""Ranges after which a counter or an angle begins anew, in the numbers as they were logged."""

EDGE = 0.25
"""Share of a range at either of its ends in which a signed number lies; one that goes farther nearly overflows."""

DISTINCT = 16
"""Different numbers from which a column is one of numbers, and not of a few levels such as 0 and 255."""

ROOM = 0.02
"""Share of its range by which a counter that turned may miss the ends of it."""

ABRUPT = 4.0
"""How many times as large as the largest other step the jump of a counter is."""


@dataclass(frozen=True)
class Wrapped:
    """What a column looks like.

    Attributes:
        word: what ``wrap:`` calls a signed number; empty for a counter that turned.
        size: its range, in the numbers as they were logged.
        name: of that range.
        after: rows in which it has just jumped, shape (rows,).
    """

    word: str
    size: float
    name: str
    after: NDArray[np.bool_]


def find(values: Vector, *, turns: bool) -> Wrapped | None:
    """Jumps from one end of a register's range to the other, from one row to the next.

    Args:
        values: numbers as they were logged, shape (rows,); NaN where there is none.
        turns: whether they may count turns or be an angle. Of other columns, such as a command, one jump between the
            ends of a range tells nothing.

    Returns:
        What they look like; None where nothing jumps so.
    """
    known = np.flatnonzero(np.isfinite(values))
    numbers = values[known]
    if len(numbers) < DISTINCT or numbers.min() < -ROOM or len(np.unique(numbers)) < DISTINCT:
        return None
    found = _signed(numbers) or (_turning(numbers) if turns else None)
    if found is None:
        return None
    word, size, name, jumps = found
    after = np.zeros(len(values), dtype=bool)
    after[known[1:][jumps]] = True
    return Wrapped(word, size, name, after)


def _signed(numbers: Vector) -> tuple[str, float, str, NDArray[np.bool_]] | None:
    """Whole numbers at both ends of a register and nowhere in between."""
    if np.any(numbers != np.round(numbers)):
        return None
    for word, bits in SIGNED.items():
        size = 2.0**bits
        low, high = numbers < EDGE * size, numbers >= (1 - EDGE) * size
        if numbers.max() < size and high.any() and low.any() and bool(np.all(low | high)):
            return word, size, f"2^{bits}", low[1:] != low[:-1]
    return None


def _turning(numbers: Vector) -> tuple[str, float, str, NDArray[np.bool_]] | None:
    """Numbers that reach both ends of a range, and jump from one to the other faster than they ever move."""
    steps = np.abs(np.diff(numbers))
    for size, name in TURNS.items():
        if numbers.max() > size or numbers.max() < (1 - ROOM) * size or numbers.min() > ROOM * size:
            continue
        jumps = steps > size / 2
        rest = float(steps[~jumps].max(initial=0.0))
        if jumps.any() and rest > 0 and ABRUPT * rest < float(steps[jumps].min()):
            return "", size, name, jumps
    return None


def signed(values: Vector, word: str) -> Vector:
    """Numbers of a register with their sign.

    Args:
        values: 0 to 2^n - 1, or signed already, shape (rows,).
        word: a key of `SIGNED`.
    """
    size = 2.0 ** SIGNED[word]
    return np.where(values >= size / 2, values - size, values)


def outside(values: Vector, word: str) -> NDArray[np.bool_]:
    """Rows that no register of that many bits holds, with a sign or without, shape (rows,)."""
    size = 2.0 ** SIGNED[word]
    return np.isfinite(values) & ((values >= size) | (values < -size / 2))
