"""What a log file says by itself: its time, the units in its names, counters, ranges at which it wraps, rest, noise."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from diagnosis.recordings import quality
from diagnosis.recordings.by_header import header
from diagnosis.recordings.columns import Columns, RecordingError, Vector, read_columns
from diagnosis.recordings.noise import noise, quantum
from diagnosis.recordings.time_axis import USUAL_STEPS
from diagnosis.recordings.wrapped_numbers import find
from engine.errors import ParameterError, Where
from engine.quantity import coherent, factor

TIME_NAMES = ("t", "time", "timestamp", "stamp", "zeit", "times", "seconds", "sec", "tsec", "clock")
COUNTER_NAMES = ("i", "k", "n", "index", "sample", "samples", "count", "row", "seq", "frame")
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Times since 1970 are at least so large in each unit."""
_WORDS = re.compile(r"[A-Za-z°]+(?:/s2?)?")
_SUFFIX = {
    "s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns", "rad": "rad", "deg": "deg", "mrad": "mrad", "rpm": "rpm",
    "mm": "mm", "um": "um", "cm": "cm", "v": "V", "mv": "mV", "a": "A", "ma": "mA", "nm": "N.m", "mnm": "mN.m",
    "kn": "kN",
    "counts": "count", "count": "count", "ticks": "count", "cts": "count", "rads": "rad/s", "degs": "deg/s",
    "radps": "rad/s", "degps": "deg/s", "mps": "m/s", "mmps": "mm/s",
}  # fmt: skip
"""Last word of a column's name -> unit; letters that are names as often as units, such as N and m, are left out."""
COUNT_STEP = 1.0
LEVELS = 10
"""A column that changes between fewer levels is a command: a machine that moves is read at more."""


@dataclass(frozen=True)
class TimeGuess:
    """The time axis of a file.

    Attributes:
        column: None if no column can be it.
        unit: of its numbers.
        seconds: from the first row, shape (rows,).
        evidence: why, in words.
        sure: whether the name or the unit says so.
    """

    column: str | None
    unit: str
    seconds: Vector
    evidence: str
    sure: bool


@dataclass
class Signal:
    """A column that changes.

    Attributes:
        name: of the column.
        values: as logged, made continuous where they wrap, shape (rows,).
        unit: that its name or its file states; empty if none.
        wrap: range in logged numbers after which it begins anew; 0 if it does not.
        signed: what ``wrap:`` calls signed numbers that were logged without their sign; empty if they are none.
        counts: whether it holds whole numbers alone.
        rest: mean over the stretch before anything moves; None without one.
        noise: standard deviation there; None without one.
    """

    name: str
    values: Vector
    unit: str
    wrap: float = 0.0
    signed: str = ""
    counts: bool = False
    rest: float | None = None
    noise: float | None = None

    @property
    def steps(self) -> int:
        """How many samples differ from the one before."""
        return int(np.count_nonzero(np.diff(self.values)))


@dataclass
class LogFile:
    """A log file as far as it can be understood without a model.

    Attributes:
        path: the file.
        columns: as read.
        time: its axis.
        signals: columns that change.
        constant: columns that do not, or hold words.
        still: rows before anything moves.
        notes: what was assumed in reading it, in sentences.
    """

    path: Path
    columns: Columns
    time: TimeGuess
    signals: list[Signal]
    constant: list[str]
    still: int = 0
    notes: list[str] = field(default_factory=list)

    def signal(self, name: str) -> Signal:
        """The column of that name that changes."""
        return next(s for s in self.signals if s.name == name)


def look(path: Path, *, time: str | None = None, interval: float | None = None, form: str = "") -> LogFile:
    """Read a file, and say what its columns are.

    Args:
        path: the file.
        time: column that is the time; guessed if None.
        interval: between samples (s), for a file without a time column.
        form: format of a file whose name does not tell it.

    Raises:
        RecordingError: it cannot be read, or has no time and no interval is given.
    """
    columns = read_columns(path, like=time or "", form=form)
    if time is None and interval is None and columns.others:
        # Of several clocks, the one of most columns leads.
        clocks = [other.clock for other in columns.others.values() if other.clock]
        best = max(dict.fromkeys(clocks), key=clocks.count, default="")
        if clocks.count(best) > len(columns.names):
            columns = read_columns(path, like=best, form=form)
    axis = _even(columns, interval) if interval is not None else _time(columns, time)
    signals, constant = [], []
    for name in columns.names:
        if name == axis.column:
            continue
        found = None if name in columns.odd else _signal(name, columns.raw[name], columns.units)
        if found is None:
            constant.append(name)
        else:
            signals.append(found)
    signals += _of_other_clocks(columns, axis)
    if not signals:
        raise RecordingError(f"no column of '{path}' changes", Where(str(path)), "is it the right file?")
    made = LogFile(path, columns, axis, signals, constant, notes=list(columns.notes))
    _rest(made)
    return made


def stated_unit(name: str, units: dict[str, str]) -> str:
    """The unit that a column's head, the file, or the last word of its name states; empty if none is known."""
    head, inside = header(name)
    round_brackets = re.search(r"\(([^)]*)\)\s*$", name)
    words = _WORDS.findall(head.replace("_", " "))
    last = _SUFFIX.get(words[-1].lower().replace("/", ""), "") if len(words) > 1 else ""
    for unit in (inside, units.get(name, ""), round_brackets.group(1) if round_brackets else "", last):
        if unit in ("count", "counts"):
            return "count"
        if unit:
            try:
                coherent(unit)
            except ParameterError:
                continue
            return unit
    return ""


def _even(columns: Columns, interval: float) -> TimeGuess:
    if not interval > 0:
        raise RecordingError(f"an interval of {interval:g} s", None, "give a time above zero")
    return TimeGuess(None, "s", interval * np.arange(len(columns), dtype=float), "the interval as given", True)


def _time(columns: Columns, wanted: str | None) -> TimeGuess:
    if wanted is not None:
        values = columns.number(wanted)
        unit, why, sure = _time_unit(wanted, values, columns.units)
        return TimeGuess(wanted, unit, _seconds(values, unit), f"as given; {why}", sure)
    best: tuple[float, str] | None = None
    for number, name in enumerate(columns.names):
        values = columns.raw[name]
        if name in columns.odd or len(values) < 3 or not np.isfinite(values).all() or np.diff(values).min() <= 0:
            continue
        steps = np.diff(values)
        plain = header(name)[0].lower().strip()
        last = re.split(r"[._ /]", plain)[-1]
        known = plain in TIME_NAMES or last in TIME_NAMES or any(word in plain for word in ("time", "zeit"))
        counter = last in COUNTER_NAMES and bool(np.all(steps == 1))
        even = float(np.median(np.abs(steps - np.median(steps))) / np.median(steps))
        score = 4.0 * known - 3.0 * counter + 1.0 * (even < 0.2) - 0.1 * number
        if best is None or score > best[0]:
            best = (score, name)
    if best is None:
        raise RecordingError(
            f"no column of '{columns.file}' increases from row to row, as time does",
            Where(columns.file),
            f"name it with --time, or give --interval '2 ms'; there are {', '.join(columns.names[:12])}",
        )
    name = best[1]
    unit, why, sure = _time_unit(name, columns.raw[name], columns.units)
    named = best[0] > 3
    evidence = ("its name, and it increases" if named else "it increases, and steps evenly") + f"; {why}"
    return TimeGuess(name, unit, _seconds(columns.raw[name], unit), evidence, named and sure)


def _time_unit(name: str, values: Vector, units: dict[str, str]) -> tuple[str, str, bool]:
    """Unit of a time, why, and whether it is stated."""
    stated = stated_unit(name, units)
    if stated:
        try:
            factor(stated, "s")
            return stated, f"{stated} by its name", True
        except ParameterError:
            pass
    for least, unit in _EPOCHS:
        if abs(float(values[0])) >= least:
            return unit, f"counted from 1970 in {unit}", True
    step = float(np.median(np.diff(values)))
    for unit, (low, high) in USUAL_STEPS.items():
        if low <= step <= high:
            return unit, f"a step of {step:g} is usual in {unit}", True
    return "s", f"a step of {step:g} is usual in no unit", False


def _seconds(values: Vector, unit: str) -> Vector:
    return np.asarray((values - values[0]) * factor(unit, "s"), dtype=float)


def _of_other_clocks(columns: Columns, axis: TimeGuess) -> list[Signal]:
    """Columns of other topics or groups, between their samples as far as they reach; read, they are joined on time."""
    if axis.column is None:
        return []
    seconds = factor(axis.unit, "s")
    leading = columns.raw[axis.column] * seconds
    made = []
    for name, other in columns.others.items():
        if other.time is None or name == other.clock or len(other.values) < 4:
            continue
        there = np.isfinite(other.time) & np.isfinite(other.values)
        if there.sum() < 4 or np.diff(other.time[there]).min() < 0:
            continue
        own = other.time[there] * seconds
        found = _signal(
            name, np.interp(leading, own, other.values[there], left=np.nan, right=np.nan), columns.units, join=True
        )
        made += [found] if found is not None else []
    return made


def _signal(name: str, values: Vector, units: dict[str, str], *, join: bool = False) -> Signal | None:
    there = np.isfinite(values)
    if there.sum() < 4 or np.ptp(values[there]) == 0:
        return None
    unit = stated_unit(name, units)
    whole = not join and bool(np.all(values[there] == np.round(values[there]))) and quantum(values) >= COUNT_STEP
    made = Signal(name, values.copy(), unit, counts=whole)
    scale = factor(unit, "rad") if unit and _is_angle(unit) else 1.0
    jumps = quality.wraps(values * scale, scale)
    if jumps is not None:
        size = jumps[0] / scale
        # The jump is the range less what was moved meanwhile; the range itself is a round number.
        ranges = [2.0**k for k in range(8, 33)] + [360.0, 2 * np.pi]
        near = min(ranges, key=lambda r: abs(np.log(r / size)))
        made.wrap = near if abs(np.log(near / size)) < 0.05 else size
    wrapped = find(values, turns=False)
    if wrapped is not None:
        made.signed, made.wrap = wrapped.word, wrapped.size
    if made.wrap:
        made.values[there] = np.unwrap(values[there], period=made.wrap)
    return made


def _is_angle(unit: str) -> bool:
    try:
        factor(unit, "rad")
    except ParameterError:
        return False
    return True


def _rest(log: LogFile) -> None:
    """Find the rows before anything moves, and the level and noise of every column there."""
    first = len(log.columns)
    for signal in log.signals:
        values = signal.values
        found = noise(log.time.seconds, values)
        span = float(np.nanmax(values) - np.nanmin(values))
        begin = float(np.nanmedian(values[: max(4, min(16, len(values) // 50))]))
        commands = 0 < span < LEVELS * found.quantum
        least = 0.5 * found.quantum if commands else max(8 * found.sigma, 0.01 * span, 2.5 * found.quantum)
        moved = np.flatnonzero(np.abs(values - begin) > least)
        first = min(first, int(moved[0]) if len(moved) else first)
    log.still = max(first - 1, 0)
    if log.still < 20:
        log.still = 0
        return
    for signal in log.signals:
        part = signal.values[: log.still]
        part = part[np.isfinite(part)]
        if len(part):
            signal.rest = float(part.mean())
            spread = float(part.std())
            signal.noise = spread if log.still >= 50 and spread > 0 else None
