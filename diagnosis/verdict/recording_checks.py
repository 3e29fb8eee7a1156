"""What looks wrong with a recording itself: units, signs, shifted columns, clipped sensors.

The nominal model is far enough from the truth to be diagnosed, and near enough to show that a signal is some sixty
times too large, upside down, a few samples early, or cut off. Nothing is repaired here: the user is told.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import over_time
from diagnosis.frequency_response.table_experiment import TableExperiment, tables
from diagnosis.thresholds import RECORDING_CHECKS
from engine.errors import SimulationError

UNITS = (
    (180 / math.pi, "degrees taken for radians"),
    (math.pi / 180, "radians taken for degrees"),
    (30 / math.pi, "revolutions per minute taken for radians per second"),
    (math.pi / 30, "radians per second taken for revolutions per minute"),
    (1 / (2 * math.pi), "revolutions taken for radians"),
    (1e3, "thousandths taken for the unit itself"),
    (1e-3, "the unit itself taken for thousandths"),
)


@dataclass(frozen=True)
class Remark:
    """Something odd about a recording.

    Attributes:
        text: a sentence.
        grave: whether no effect of the catalogue should be named with confidence while it stands.
        refutable: whether a model that leaves only noise refutes it: a shift in time, an end of a sensor's range.
    """

    text: str
    grave: bool
    refutable: bool = False


def screen(problem: Problem, x: Array | None = None) -> list[Remark]:
    """Hold a model against every recording over time, and remark on what no physics explains.

    Args:
        problem: of the model.
        x: search vector; absent: the parameters as the user gave them.
    """
    found: list[Remark] = []
    alike: dict[str, list[float]] = {}
    zero = np.zeros(len(problem.free)) if x is None else x
    for table in tables(problem.experiments):
        with contextlib.suppress(SimulationError):
            found += _level(table, problem.simulate(zero, table))
    for e in over_time(problem.experiments):
        try:
            simulated = e.sampled(problem.simulate(zero, e))
        except SimulationError:
            continue
        simulated = simulated - np.where(e.from_first, simulated[0], 0.0)
        for k, variable in enumerate(problem.model.outputs):
            there = np.isfinite(e.measured[:, k])
            if int(there.sum()) < 4 * RECORDING_CHECKS.farthest:
                continue
            where = f"'{variable.name}' of recording '{e.name}'"
            y, s = e.measured[there, k], simulated[there, k]
            alike.setdefault(variable.name, []).append(_likeness(y, s)[0])
            found += _scale(where, y, s) + _clipped(where, y, s)
            if there.all() and not e.uneven:
                found += _shifted(where, y, s, e.interval)
    return list(dict.fromkeys([*_upside_down(alike), *found]))


def _upside_down(alike: dict[str, list[float]]) -> list[Remark]:
    """Signals that run against the model in all recordings; in one alone a resonance beside the input may do that."""
    found = []
    for name, correlations in alike.items():
        clear = [c for c in correlations if abs(c) >= RECORDING_CHECKS.alike]
        if clear and max(clear) < 0:
            often = f"in {len(clear)} of {len(correlations)} recordings" if len(correlations) > 1 else ""
            text = f"'{name}' runs against the model {often} (correlation {min(clear):.2f})".replace("  ", " ")
            found.append(Remark(f"{text}: is its sign right?", True))
    return found


def _level(e: TableExperiment, simulated: Array) -> list[Remark]:
    """A table that lies above or below the model by a unit's factor at nearly every frequency."""
    found = []
    for k, apart in enumerate((e.measured - simulated).T):
        middle = float(np.median(apart))
        if np.median(np.abs(apart - middle)) > RECORDING_CHECKS.level * abs(middle):
            continue
        gain = 10 ** (middle / 20)
        found += [
            Remark(f"signal {k + 1} of table '{e.name}' is {gain:.3g} times as large as the model's: {guess}?", True)
            for factor, guess in UNITS
            if abs(math.log(gain / factor)) < RECORDING_CHECKS.near
        ]
    return found


def _likeness(y: Array, s: Array) -> tuple[float, float]:
    """Correlation, and the factor of the measured against the simulated signal."""
    y, s = y - y.mean(), s - s.mean()
    power, size = float(s @ s), float(y @ y)
    if not (power > 0 and size > 0):
        return 0.0, 0.0
    correlation = float(y @ s) / math.sqrt(power * size)
    return correlation, math.copysign(math.sqrt(size / power), correlation)


def _scale(where: str, y: Array, s: Array) -> list[Remark]:
    correlation, gain = _likeness(y, s)
    if abs(correlation) < RECORDING_CHECKS.alike:
        return []
    found = []
    for factor, guess in UNITS:
        if abs(math.log(abs(gain) / factor)) < RECORDING_CHECKS.near:
            found.append(
                Remark(
                    f"{where} is {abs(gain):.3g} times as large as the model's (correlation {correlation:.2f}): "
                    f"{guess}?",
                    True,
                )
            )
    return found


def _shifted(where: str, y: Array, s: Array, interval: float) -> list[Remark]:
    """A whole number of samples by which the recording is early or late."""
    if _likeness(y, s)[0] < RECORDING_CHECKS.alike:
        return []
    inner = slice(RECORDING_CHECKS.farthest, len(y) - RECORDING_CHECKS.farthest)
    left: dict[int, float] = {}
    for k in range(-RECORDING_CHECKS.farthest, RECORDING_CHECKS.farthest + 1):
        a = np.column_stack([np.roll(s, k)[inner], np.ones(len(y) - 2 * RECORDING_CHECKS.farthest)])
        left[k] = float(np.sum((y[inner] - a @ np.linalg.lstsq(a, y[inner], rcond=None)[0]) ** 2))
    best = min(left, key=lambda k: left[k])
    if best == 0 or left[best] > RECORDING_CHECKS.halved * left[0]:
        return []
    samples = f"{abs(best)} sample{'s' if abs(best) > 1 else ''} ({abs(best) * interval:g} s)"
    if best < 0:
        text = f"{where} is {samples} ahead of the model, before its cause: is a column shifted against the time?"
        return [Remark(text, True, refutable=True)]
    text = f"{where} is {samples} behind the model: there is a delay, or a column is shifted against the time"
    return [Remark(text, False)]


def _clipped(where: str, y: Array, s: Array) -> list[Remark]:
    """Runs of equal samples at an extreme, entered at speed, while the model goes on."""
    span = float(np.ptp(y))
    gain = _likeness(y, s)[1]
    moves = np.abs(np.diff(y))
    usual = float(np.median(moves[moves > 0])) if (moves > 0).any() else 0.0
    found = []
    for extreme, sign in ((float(y.max()), 1.0), (float(y.min()), -1.0)):
        at = np.concatenate([[False], y == extreme, [False]])
        begins, ends = np.flatnonzero(~at[:-1] & at[1:]), np.flatnonzero(at[:-1] & ~at[1:])
        runs = [
            (b, e) for b, e in zip(begins, ends, strict=True) if e - b >= RECORDING_CHECKS.run and b > 0 and e < len(y)
        ]
        abrupt = [(b, e) for b, e in runs if min(moves[b - 1], moves[e - 1]) >= RECORDING_CHECKS.abrupt * usual]
        held = sum(e - b for b, e in abrupt)
        model = y.mean() + gain * (s - s.mean()) if gain else y
        beyond = any((sign * (model[b:e] - extreme)).max() > RECORDING_CHECKS.beyond * span for b, e in abrupt)
        if len(abrupt) >= RECORDING_CHECKS.runs or (abrupt and beyond):
            side, runs_said = (
                "largest" if sign > 0 else "smallest",
                f"{len(abrupt)} run{'s' if len(abrupt) > 1 else ''}",
            )
            text = f"{where} stays at its {side} value, {extreme:g}, for {held} samples in {runs_said}"
            found.append(Remark(f"{text}: is the sensor at the end of its range?", True, refutable=True))
    return found
