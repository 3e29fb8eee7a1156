"""Recordings held against each other, their own clock and the nominal model, before any fit: numbers and warnings."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.problems import outlying, problem
from diagnosis.recordings import quality
from diagnosis.recordings.noise import Noise, noise, rests
from diagnosis.recordings.types import Recorded, Recording
from diagnosis.verdict.recording_checks import Compared, Remark, compared, screen
from engine.errors import FlexarmError
from scenarios.load import Scenario

SAME_DRIVE = 0.02
"""Difference of two drives, as a share of their size, up to which the experiment was repeated."""


@dataclass(frozen=True)
class SignalRow:
    """What was found of a recorded signal.

    Attributes:
        name, unit: of the model's signal.
        time: instants (s), shape (samples,).
        measured, simulated: shape (samples,), the latter of the model as given, NaN if it could not be simulated.
        noise: see `diagnosis.recordings.noise.Noise`; in ``unit``.
        stated: standard deviation that the user stated; None if none.
        spikes: numbers of the samples that are left out.
        rests: stretches at rest, first and last instant (s).
        correlation, gain: of the measured against the simulated signal; NaN if it could not be simulated.
        delay: time (s) by which the measured one is behind the simulated one, where that is clear; else None.
        lines: frequencies (Hz) of lines that no input holds.
    """

    name: str
    unit: str
    time: Array
    measured: Array
    simulated: Array
    noise: Noise
    stated: float | None
    spikes: tuple[int, ...]
    rests: tuple[tuple[float, float], ...]
    correlation: float
    gain: float
    delay: float | None
    lines: tuple[float, ...]

    @property
    def span(self) -> float:
        """Range of the measured values."""
        there = self.measured[np.isfinite(self.measured)]
        return float(np.ptp(there)) if there.size else 0.0

    def numbers(self) -> dict[str, Any]:
        """Everything but curves, ready for JSON."""
        return {
            "unit": self.unit,
            "range": self.span,
            "quantum": self.noise.quantum or None,
            "noise": self.stated if self.stated is not None else self.noise.sigma,
            "noise_from": "stated" if self.stated is not None else self.noise.source,
            "noise_between_samples": self.noise.logged,
            "noise_at_rest": self.noise.at_rest if math.isfinite(self.noise.at_rest) else None,
            "spikes": len(self.spikes),
            "correlation": self.correlation if math.isfinite(self.correlation) else None,
            "gain": self.gain if math.isfinite(self.gain) else None,
            "delay": self.delay,
            "lines": list(self.lines),
        }


@dataclass(frozen=True)
class Examined:
    """A recording over time.

    Attributes:
        recording: as read.
        clock: of its samples.
        signals: in the order of its measurements.
    """

    recording: Recording
    clock: quality.Clock
    signals: tuple[SignalRow, ...]

    def numbers(self) -> dict[str, Any]:
        """Everything but curves, ready for JSON."""
        return {
            "file": self.recording.file,
            "samples": len(self.recording.time),
            "duration": float(self.recording.time[-1]),
            "interval": self.clock.interval,
            "jitter": self.clock.jitter,
            "drift": self.clock.drift,
            "dropped": self.clock.dropped,
            "signals": {row.name: row.numbers() for row in self.signals},
            "notes": list(self.recording.notes),
        }


@dataclass(frozen=True)
class Examination:
    """What was found of all recordings.

    Attributes:
        recordings: those over time.
        remarks: warnings, the gravest first.
        repeats: pairs of recordings of one experiment: names, signal, and the standard deviation between them over that
            of the noise.
    """

    recordings: tuple[Examined, ...]
    remarks: tuple[Remark, ...]
    repeats: tuple[tuple[str, str, str, float], ...]

    def numbers(self) -> dict[str, Any]:
        """Everything but curves, ready for JSON."""
        return {
            "recordings": {one.recording.name: one.numbers() for one in self.recordings},
            "warnings": [{"text": r.text, "grave": r.grave} for r in self.remarks],
            "repeats": [dict(zip(("one", "other", "signal", "over_noise"), row, strict=True)) for row in self.repeats],
        }


def examine(
    scenario: Scenario, recordings: Sequence[Recorded], progress: Callable[[float], None] | None = None
) -> Examination:
    """Hold recordings against their clocks, each other and the nominal model.

    Args:
        scenario: the model.
        recordings: as read; they need not have the same drives and measurements.
        progress: called with the fraction done, from 0 to 1.

    Raises:
        FlexarmError: recordings that do not fit the scenario.
    """
    groups = _alike(recordings)
    made: list[Examined] = []
    remarks: list[Remark] = []
    for number, group in enumerate(groups):
        posed = problem(scenario, group)
        remarks += screen(posed)
        beside = {(one.experiment.name, one.name): one for one in compared(posed)}
        own = {e.name: e for e in over_time(posed.experiments)}
        for recording in group:
            if isinstance(recording, Recording):
                made.append(_examined(recording, own[recording.name], posed.model.outputs, beside))
        if progress:
            progress((number + 1) / len(groups))
    remarks += [r for one in made for r in _own_remarks(one)]
    repeats = _repeats(made)
    for one, other, signal, apart in repeats:
        if apart > 2:
            text = (
                f"'{signal}' differs between '{one}' and '{other}', the same experiment, by {apart:.2g} times the "
                "noise: no model can do better than that"
            )
            remarks.append(Remark(text, False))
    unique = sorted(dict.fromkeys(remarks), key=lambda r: not r.grave)
    return Examination(tuple(made), tuple(unique), tuple(repeats))


def warnings_about(scenario: Scenario, recordings: Sequence[Recorded]) -> list[str]:
    """What a diagnosis would warn of before it searches, graver things first; recordings need not be alike.

    Recordings of which no problem can be posed are passed over.
    """
    remarks: list[Remark] = []
    for group in _alike(recordings):
        with contextlib.suppress(FlexarmError):
            remarks += screen(problem(scenario, group))
    return [remark.text for remark in sorted(dict.fromkeys(remarks), key=lambda r: not r.grave)]


def _alike(recordings: Sequence[Recorded]) -> list[list[Recorded]]:
    """Recordings with the same drives and measurements, which make one problem."""
    groups: dict[Any, list[Recorded]] = {}
    for recording in recordings:
        names: Any = recording.name
        if isinstance(recording, Recording):
            names = tuple(c.name for c in (*recording.drive, *recording.measurements))
        groups.setdefault(names, []).append(recording)
    return list(groups.values())


def _examined(
    recording: Recording, e: TimeExperiment, outputs: Sequence[Any], beside: dict[tuple[str, str], Compared]
) -> Examined:
    rows = []
    drives = [channel.values for channel in recording.drive]
    time = np.asarray(recording.time)
    for k, (channel, variable) in enumerate(zip(recording.measurements, outputs, strict=True)):
        factor = e.logged[k] / channel.logged if e.logged and channel.logged else 1.0
        values = channel.values * factor
        found = noise(time, values, drives)
        stated = channel.noise * factor if channel.noise is not None else None
        one = beside.get((recording.name, variable.name))
        simulated, correlation, gain, delay = np.full(len(time), math.nan), math.nan, math.nan, None
        if one is not None:
            simulated = np.interp(time, e.time, one.simulated)
            correlation, gain = one.likeness
            best, left = one.shift
            delay = best * e.interval if left < 1 and abs(correlation) > 0.5 else None
        resting = rests(values, drives, found.logged) if drives else []
        even = quality.clock(time).jitter < 1e-3 * float(np.median(np.diff(time)))
        rows.append(
            SignalRow(
                variable.name,
                variable.unit,
                time,
                values,
                simulated,
                found,
                stated,
                tuple(np.flatnonzero(outlying(recording, variable.unit, values, stated or found.sigma)).tolist()),
                tuple((float(time[part.start]), float(time[part.stop - 1])) for part in resting),
                correlation,
                gain,
                delay,
                tuple(quality.lines(values, drives, float(np.median(np.diff(time))))) if even else (),
            )
        )
    stamps = recording.stamps if recording.stamps is not None else time
    return Examined(recording, quality.clock(np.asarray(stamps)), tuple(rows))


def _own_remarks(one: Examined) -> list[Remark]:
    name = one.recording.name
    found = [Remark(f"recording '{name}': {text}", False) for text in one.clock.remarks]
    for row in one.signals:
        where = f"'{row.name}' of recording '{name}'"
        if row.lines:
            at = ", ".join(f"{f:.4g} Hz" for f in row.lines)
            text = (
                f"{where} has lines at {at} that no input holds: hum, a resonance of the sensor's mount, or what is "
                f"above {0.5 / one.clock.interval:.4g} Hz and folds back, where nothing was filtered before sampling"
            )
            found.append(Remark(text, False))
        if row.noise.quantum and row.span < 20 * row.noise.quantum:
            text = f"{where} moves over {row.span / row.noise.quantum:.0f} steps of its resolution: it tells little"
            found.append(Remark(text, False))
        noisy = row.stated if row.stated is not None else row.noise.sigma
        if row.stated is not None and row.noise.logged > 3 * row.stated:
            text = (
                f"{where} jitters by {row.noise.logged:.2g} {row.unit} between samples, and its noise is stated as "
                f"{row.stated:.2g}"
            )
            found.append(Remark(text, False))
        if noisy > 0.2 * row.span:
            found.append(Remark(f"{where} moves over {row.span / noisy:.1f} times its noise: it tells little", False))
    return found


def _repeats(made: Sequence[Examined]) -> list[tuple[str, str, str, float]]:
    found = []
    for one, other in combinations(made, 2):
        a, b = one.recording, other.recording
        if len(a.time) != len(b.time) or not a.drive or [c.name for c in a.drive] != [c.name for c in b.drive]:
            continue
        if dict(a.settings) != dict(b.settings):
            continue
        pairs = list(zip(a.drive, b.drive, strict=True))
        if any(np.std(x.values - y.values) > SAME_DRIVE * np.std(x.values) for x, y in pairs):
            continue
        for p, q in zip(one.signals, other.signals, strict=True):
            apart = float(np.nanstd(p.measured - q.measured)) / math.sqrt(2)
            level = p.stated if p.stated is not None else p.noise.sigma
            if level > 0:
                found.append((a.name, b.name, p.name, apart / level))
    return found
