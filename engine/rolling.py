"""Find what repeats in straight-line code, such as the links of a chain, so that it can be written as loops.

A step through code that is larger than the instruction cache waits for instructions: the links of an arm, each written
out, took three times as long for twice as many. What repeats is found by the shapes of the lines alone, and it stays
where it is: a loop computes the same values from the same values in the same order.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_TURNS, LEAST_SAVED = 3, 60
"""Turns of a loop, and lines that it saves, below which lines are left as they are."""

_WINDOW, _CANDIDATES = 12, 16
"""Lines alike that make a period worth a look, and how many periods get one."""

_PARTS = 20
"""Parts that a section may come in; what goes on otherwise at every other turn is not worth the search."""


@dataclass(frozen=True)
class Section:
    """Lines from ``first`` on that come in ``turns`` turns of ``period`` lines, alike from turn to turn."""

    first: int
    period: int
    turns: int

    @property
    def end(self) -> int:
        """The line after the last."""
        return self.first + self.period * self.turns

    def turn_and_slot(self, line: int) -> tuple[int, int]:
        """Of a line inside."""
        return divmod(line - self.first, self.period)


@dataclass(frozen=True)
class Line:
    """A line of code.

    Attributes:
        shape: equal for lines that differ in nothing but which values they read.
        reads: what it reads: the number of an earlier line, or None for what comes from elsewhere; in order.
    """

    shape: Hashable
    reads: tuple[int | None, ...]


def sections(lines: Sequence[Line]) -> list[Section]:
    """What repeats, in order, without overlaps."""
    numbers: dict[Hashable, int] = {}
    codes = np.array([numbers.setdefault(line.shape, len(numbers)) for line in lines], dtype=np.int64)
    periods, alive = _periods(codes), _alive(lines)
    found: list[Section] = []
    while (best := _longest(codes, periods, alive)) is not None:
        # No line is alike to one that is taken, nor to one that turned out to be irregular.
        codes[best.first : best.end] = -1 - np.arange(best.first, best.end)
        found += _regular(lines, best)
    return sorted(found, key=lambda section: section.first)


def _periods(codes: NDArray[np.int64]) -> list[int]:
    """The most frequent distances between stretches of some lines that are alike, shortest first."""
    if len(codes) < 2 * _WINDOW:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(codes, _WINDOW)
    weights = np.array([pow(1_000_003, k, 1 << 61) for k in range(_WINDOW)], dtype=np.int64)
    with np.errstate(over="ignore"):
        sums = (windows * weights).sum(axis=1)
    order = np.argsort(sums, kind="stable")
    same = sums[order][1:] == sums[order][:-1]
    distances = np.diff(order)[same]
    counts = np.bincount(distances[distances > 0], minlength=1)
    chosen = np.argsort(-counts, kind="stable")[:_CANDIDATES]
    return sorted(int(period) for period in chosen if counts[period] > 0)


def _alive(lines: Sequence[Line]) -> NDArray[np.int64]:
    """How many values are needed across the beginning of each line."""
    last: dict[int, int] = {}
    for k, line in enumerate(lines):
        for read in line.reads:
            if read is not None:
                last[read] = k
    change = np.zeros(len(lines) + 2, dtype=np.int64)
    for line_number, used in last.items():
        change[line_number + 1] += 1
        change[used + 1] -= 1
    return np.cumsum(change)


def _longest(codes: NDArray[np.int64], periods: Sequence[int], alive: NDArray[np.int64]) -> Section | None:
    """The section that saves most lines; it begins where fewest values are carried from turn to turn."""
    best, saved = None, LEAST_SAVED - 1
    for period in periods:
        same = np.concatenate([[0], codes[period:] == codes[:-period], [0]]).astype(np.int8)
        edges = np.flatnonzero(np.diff(same))
        if not len(edges):
            continue
        lengths = edges[1::2] - edges[::2]
        k = int(lengths.argmax())
        length, first = int(lengths[k]), int(edges[2 * k])
        turns = length // period + 1
        if turns >= LEAST_TURNS and (turns - 1) * period > saved:
            spare = length % period
            middle = first + turns // 2 * period
            first += int(np.argmin(alive[middle : middle + spare + 1]))
            best, saved = Section(first, period, turns), (turns - 1) * period
    return best


def _regular(lines: Sequence[Line], section: Section) -> list[Section]:
    """The section, or parts of it, in which each line reads what is alike from turn to turn."""
    found: list[Section] = []
    for _ in range(_PARTS):
        at = _irregular(lines, section) or section.turns
        part = Section(section.first, section.period, at)
        if at >= LEAST_TURNS and (at - 1) * section.period >= LEAST_SAVED:
            found.append(part)
        section = Section(part.end, section.period, section.turns - at)
        if section.turns < LEAST_TURNS:
            break
    return found


def _irregular(lines: Sequence[Line], section: Section) -> int | None:
    """The first turn that reads otherwise than those before it; each may read its own values and the last turn's."""
    found = None
    for slot in range(section.period):
        here = range(section.first + slot, section.end, section.period)
        for place in range(len(lines[here[0]].reads)):
            sources = [_source(section, turn, lines[k].reads[place]) for turn, k in enumerate(here)]
            goes_on = sources[1] if sources[0] is None and (sources[1] is None or sources[1][0] == 1) else sources[0]
            turn = next((k for k, source in enumerate(sources) if k and source != goes_on), None)
            if turn is not None:
                found = min(found or turn, turn)
    return found


def _source(section: Section, turn: int, read: int | None) -> tuple[int, int] | None:
    """How many turns ago a value was made, and in which slot; None if not inside."""
    if read is None or read < section.first:
        return None
    made, slot = section.turn_and_slot(read)
    return turn - made, slot
