"""The draft of a `recordings:` section: entries with windows, offsets, noise and roles, and why, as YAML."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.drafting.log_file import LogFile
from diagnosis.drafting.match import Match, Matches
from diagnosis.recordings.feedback import fed_back, plant_inputs
from engine.errors import FlexarmError, Where
from engine.quantity import factor

if TYPE_CHECKING:
    from scenarios.load import Scenario

REST_KEPT = 0.25
"""Longest stretch at rest before a motion that a window keeps, as a share of the motion."""
FIT = 0.6
"""Share of a single file that is fitted; the rest is held out."""
_PLAIN = re.compile(r"^[A-Za-z_/][A-Za-z0-9_./]*$")
_WORDS = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}


@dataclass
class Entry:
    """One recording of a draft.

    Attributes:
        name: of the recording.
        log: its file.
        window: first and last instant (s), as the file counts time; None for all.
        role: ``train`` or ``hold_out``.
        at_rest: whether it begins at rest.
        remarks: sentences.
    """

    name: str
    log: LogFile
    window: tuple[float, float] | None
    role: str
    at_rest: bool
    remarks: list[str] = field(default_factory=list)


@dataclass
class Draft:
    """Drafted recordings of one kind of experiment.

    Attributes:
        scenario: the model.
        matches: what the columns are.
        entries: recordings.
        loop: of all of them.
    """

    scenario: Scenario
    matches: Matches
    entries: list[Entry]
    loop: str


def draft(scenario: Scenario, logs: Sequence[LogFile], matches: Matches) -> Draft:
    """Entries for the files, with windows, and roles: the strongest excitation is fitted, a third is held out.

    Raises:
        FlexarmError: a file lacks a column that was matched.
    """
    for log in logs:
        known = [s.name for s in log.signals]
        for row in (*matches.drive, *matches.measurements):
            if row.column not in known:
                log.columns.number(row.column)
    taken = set(scenario.recordings)
    entries: list[Entry] = []
    for log in logs:
        name = _name(log.path.stem, taken)
        entries.append(Entry(name, log, _window(log), "train", log.still > 0))
    if len(entries) == 1:
        entries = _halves(entries[0], taken)
    else:
        order = sorted(range(len(entries)), key=lambda k: -_strength(entries[k].log, matches))
        # Not the strongest: held-out data beyond what was fitted ask for more than a model knows.
        for k in order[1::3][: max(1, len(entries) // 3)]:
            entries[k].role = "hold_out"
    driven = [row.end for row in matches.drive]
    loop = "open"
    if driven and fed_back(scenario.system, driven):
        loop = "reference"
    elif driven and set(driven) & set(plant_inputs(scenario.system, [])):
        loop = "closed"
    return Draft(scenario, matches, entries, loop)


def text(made: Draft, folder: Path, indent: str = "  ") -> str:
    """The entries as YAML under `recordings:`, with the evidence as comments.

    Args:
        made: the draft.
        folder: that files are named relative to.
        indent: of an entry.
    """
    lines: list[str] = []
    for number, entry in enumerate(made.entries):
        lines += [f"{indent}{line}" if line else "" for line in _entry(made, entry, folder, first=number == 0)]
    return "\n".join(lines) + "\n"


def inserted(source: str, section: str) -> str:
    """A scenario's text with entries at the end of its recordings.

    Args:
        source: the scenario.
        section: entries, indented by two.

    Raises:
        FlexarmError: its recordings are written in braces.
    """
    lines = source.rstrip("\n").split("\n")
    found = [k for k, line in enumerate(lines) if re.match(r"recordings\s*:", line)]
    if not found:
        return "\n".join([*lines, "", "recordings:", section.rstrip("\n")]) + "\n"
    begin = found[0]
    if re.match(r"recordings\s*:\s*[^#\s]", lines[begin]):
        raise FlexarmError(
            "the scenario's recordings are written on one line", Where(line=begin + 1), "write each on lines of its own"
        )
    end = begin + 1
    while end < len(lines) and (not lines[end].strip() or lines[end][0] in " \t#"):
        end += 1
    while end > begin + 1 and (not lines[end - 1].strip() or lines[end - 1].startswith("#")):
        end -= 1
    inner = next((line for line in lines[begin + 1 : end] if line.strip() and not line.strip().startswith("#")), "  ")
    own = inner[: len(inner) - len(inner.lstrip())] or "  "
    moved = [own + line[2:] if line.strip() else line for line in section.rstrip("\n").split("\n")]
    return "\n".join([*lines[:end], *moved, *lines[end:]]) + "\n"


def _name(stem: str, taken: set[str]) -> str:
    plain = re.sub(r"\W+", "_", stem, flags=re.ASCII).strip("_").lower() or "recording"
    plain = f"run_{plain}" if plain[0].isdigit() else plain
    plain = plain[:60]
    name, number = plain, 2
    while name in taken:
        name, number = f"{plain}_{number}", number + 1
    taken.add(name)
    return name


def _start(log: LogFile) -> float:
    """The first instant, as the file counts time (s)."""
    if log.time.column is None:
        return 0.0
    return float(log.columns.raw[log.time.column][0]) * factor(log.time.unit, "s")


def _window(log: LogFile) -> tuple[float, float] | None:
    """Without long stretches at rest before the first motion and after the last; None for the whole file."""
    t = log.time.seconds
    first, last = log.still, _last_motion(log)
    motion = float(t[last] - t[first])
    begin, end = float(t[0]), float(t[-1])
    if t[first] - t[0] > REST_KEPT * motion:
        begin = float(t[first]) - REST_KEPT * motion
    if t[-1] - t[last] > 2 * REST_KEPT * motion:
        end = float(t[last]) + REST_KEPT * motion
    if begin == t[0] and end == t[-1]:
        return None
    return _start(log) + begin, _start(log) + end


def _last_motion(log: LogFile) -> int:
    last = log.still + 1
    for signal in log.signals:
        values = signal.values
        tail = float(np.nanmedian(values[-max(4, len(values) // 50) :]))
        span = float(np.nanmax(values) - np.nanmin(values))
        moved = np.flatnonzero(np.abs(values - tail) > 0.03 * span)
        last = max(last, int(moved[-1]) if len(moved) else 0)
    return min(last, len(log.time.seconds) - 1)


def _halves(entry: Entry, taken: set[str]) -> list[Entry]:
    """A single file as two recordings: its first part to fit, the rest held out."""
    t = log_times(entry.log)
    begin, end = entry.window or (float(t[0]), float(t[-1]))
    middle = begin + FIT * (end - begin)
    remark = "one file alone: its later part is held out; another experiment would be a harder judge"
    return [
        Entry(entry.name, entry.log, (begin, middle), "train", entry.at_rest, [remark]),
        Entry(_name(f"{entry.name}_later", taken), entry.log, (middle, end), "hold_out", False),
    ]


def log_times(log: LogFile) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Instants of a file as it counts them (s)."""
    return np.asarray(log.time.seconds + _start(log), dtype=np.float64)


def _strength(log: LogFile, matches: Matches) -> float:
    """Excitation of a file: what drives, or what is measured."""
    columns = [row.column for row in (matches.drive or matches.measurements)]
    return float(np.sum([np.nanstd(s.values) for s in log.signals if s.name in columns]))


def _entry(made: Draft, entry: Entry, folder: Path, *, first: bool) -> list[str]:
    log = entry.log
    lines = [f"{entry.name}:"]
    lines += [f"  # {remark}" for remark in entry.remarks]
    lines.append(f"  file: {_quoted(_relative(log.path, folder))}")
    if log.time.column is None:
        step = float(np.median(np.diff(log.time.seconds)))
        lines.append(f"  time: {{interval: {step:.9g} s}}")
    else:
        unit = f", unit: {log.time.unit}" if log.time.unit != "s" else ""
        doubt = "" if log.time.sure else "to be confirmed: "
        why = f"  # {doubt}{log.time.evidence}" if first else ""
        lines.append(f"  time: {{column: {_quoted(log.time.column)}{unit}}}{why}")
    if entry.window is not None:
        lines.append(f"  window: [{entry.window[0]:.9g} s, {entry.window[1]:.9g} s]")
    if made.matches.drive:
        lines.append("  drive:")
        lines += [_row(row, log, first=first, drives=True) for row in made.matches.drive]
    lines.append("  measurements:")
    lines += [_row(row, log, first=first, drives=False) for row in made.matches.measurements]
    if not entry.at_rest:
        lines.append("  initial: {state: as_measured}" + ("  # it does not begin at rest" if first else ""))
    if made.loop != "open":
        lines.append(f"  loop: {made.loop}")
    if entry.role != "train":
        lines.append(f"  role: {entry.role}")
    return lines


def _row(row: Match, log: LogFile, *, first: bool, drives: bool) -> str:
    signal = next((s for s in log.signals if s.name == row.column), None)
    parts = [f"column: {_quoted(row.column)}", f"unit: {_quoted(row.unit)}"]
    if row.counts_per_rev:
        parts.append(f"counts_per_rev: {row.counts_per_rev:g}")
    if row.scale:
        parts.append(f"scale: {row.scale}")
    if row.sign < 0:
        parts.append("sign: -1")
    own = row.unit if row.unit not in ("1", "count") else ""
    if signal is not None:
        span = float(np.nanmax(signal.values) - np.nanmin(signal.values))
        level, signed = signal.rest, row.unit != "count" and signal.signed
        if signed and level is not None and level >= signal.wrap / 2:
            level -= signal.wrap
        doubt = max(3 * (signal.noise or 0.0) / math.sqrt(max(log.still, 1)), 1e-3 * span)
        if level is not None and abs(level) > doubt:
            parts.append(f"offset: {f'{level:.6g} {own}'.strip()}")
        if signed:
            parts.append(f"wrap: {signed}")
        elif not drives and signal.wrap:
            parts.append(
                f"wrap: {'true' if _whole_turn(signal.wrap, row.unit) else f'{signal.wrap:.9g} {own}'.strip()}"
            )
        if not drives and signal.noise and row.unit != "count" and not row.scale:
            parts.append(f"noise: {signal.noise:.3g} {own}".strip())
    why = f"  # {row.evidence}" if first else ""
    return f"    {row.end}: {{{', '.join(parts)}}}{why}"


def _whole_turn(wrap: float, unit: str) -> bool:
    return (unit == "deg" and wrap == 360.0) or (unit == "rad" and abs(wrap - 2 * math.pi) < 1e-9)


def _relative(path: Path, folder: Path) -> str:
    """A file as a scenario in that folder names it; by the variable where it lies in the folder of recordings."""
    base = os.environ.get("FLEXARM_RECORDINGS", "")
    if base and path.resolve().is_relative_to(Path(base).resolve()):
        return f"$FLEXARM_RECORDINGS/{path.resolve().relative_to(Path(base).resolve()).as_posix()}"
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return str(path.resolve())


def _quoted(value: str) -> str:
    if (_PLAIN.match(value) and value.lower() not in _WORDS) or value.startswith("$FLEXARM_RECORDINGS/"):
        return value
    return json.dumps(value, ensure_ascii=False)
