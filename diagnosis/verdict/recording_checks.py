"""What looks wrong with a recording itself: units, signs, shifted columns, clipped or frozen sensors, clocks, spikes.

The nominal model is far enough from the truth to be diagnosed, and near enough to show that a signal is some sixty
times too large, upside down, a few samples early, or cut off. Nothing is repaired here: the user is told.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.frequency_response.table_experiment import TableExperiment, tables
from diagnosis.recordings import quality
from diagnosis.thresholds import RECORDING_CHECKS
from engine.errors import ParameterError, SimulationError
from engine.ports import MOTION

UNITS = (
    (180 / math.pi, "degrees taken for radians"),
    (math.pi / 180, "radians taken for degrees"),
    (30 / math.pi, "revolutions per minute taken for radians per second"),
    (math.pi / 30, "radians per second taken for revolutions per minute"),
    (1 / (2 * math.pi), "revolutions taken for radians"),
    (1e3, "thousandths taken for the unit itself"),
    (1e-3, "the unit itself taken for thousandths"),
)

_MOTION = tuple(unit for kind in MOTION.values() for _, unit in kind[:2])


@dataclass(frozen=True)
class Remark:
    """Something odd about a recording.

    Attributes:
        text: a sentence.
        grave: whether no effect of the catalogue should be named with confidence while it stands.
        refutable: whether a model that leaves only noise refutes it: a shift in time, an end of a sensor's range.
        scales: signals of which it says that one is scaled wrongly, and how many times too large that is.
        turned: signal of which it says that its sign is wrong, if it says that.
    """

    text: str
    grave: bool
    refutable: bool = False
    scales: tuple[tuple[str, float], ...] = ()
    turned: str | None = None

    def is_met_by(self, signal: str, scale: float) -> bool:
        """Whether it says no more than that a signal is so many times too large."""
        return any(name == signal and scale > 0 and _is_near(scale, said) for name, said in self.scales)


def screen(problem: Problem, x: Array | None = None) -> list[Remark]:
    """Hold a model against every recording over time, and remark on what no physics explains.

    Args:
        problem: of the model.
        x: search vector; absent: the parameters as the user gave them.
    """
    found: list[Remark] = []
    zero = np.zeros(len(problem.free)) if x is None else x
    for table in tables(problem.experiments):
        with contextlib.suppress(SimulationError):
            found += _level(table, problem.simulate(zero, table))
    for e in over_time(problem.experiments):
        found += _by_itself(e, [v.name for v in problem.model.outputs], [v.unit for v in problem.model.outputs])
    beside = compared(problem, zero)
    for one in beside:
        there = np.isfinite(one.measured)
        if int(there.sum()) >= 4 * RECORDING_CHECKS.farthest:
            found += _scale(one) + _clipped(one.where, one.measured[there], one.simulated[there])
    found += _assumed(problem)
    found += _shifts(beside) + _common_gain(beside, problem)
    # What a late column or a wrong unit leaves over, another clock would explain in part.
    found += clocks(problem) if not any(remark.grave for remark in found) else []
    return list(dict.fromkeys([*_upside_down(beside), *found]))


def _assumed(problem: Problem) -> list[Remark]:
    """What was found of files that their descriptions leave open."""
    told: dict[str, list[str]] = {}
    for (_, name, *keys, key), value in problem.assumed.items():
        if key == "clock":
            text = "stamps stray about an even clock, and samples are taken to be evenly spaced"
        elif key == "hold":
            text = f"'{keys[-1]}' is taken for a straight line between samples"
        elif key == "sampled":
            text = "what is measured in a row is taken to be read before the row's input acts"
        else:
            text = "what nothing measures at the start is taken to be let go of out of equilibrium"
        said = value if isinstance(value, str) else f"[{', '.join(value)}]"
        told.setdefault(f"{text}: the model follows them better ('{key}: {said}')", []).append(f"'{name}'")
    return [Remark(f"in {' and '.join(names)}, {text}", grave=False) for text, names in told.items()]


def compared(problem: Problem, x: Array | None = None) -> list[Compared]:
    """Every signal of every recording over time beside a model's, the nominal one's by default, where that runs."""
    made = []
    zero = np.zeros(len(problem.free)) if x is None else x
    for e in over_time(problem.experiments):
        try:
            simulated = e.sampled(problem.simulate(zero, e))
        except (ParameterError, SimulationError):
            continue
        simulated = simulated - np.where(e.from_first, simulated[0], 0.0)
        made += [Compared(v.name, e, e.measured[:, k], simulated[:, k]) for k, v in enumerate(problem.model.outputs)]
    return made


@dataclass(frozen=True)
class Compared:
    """A recorded signal beside the nominal model's.

    Attributes:
        name: of the signal.
        experiment: it belongs to.
        measured, simulated: shape (samples,); the former NaN where nothing was recorded.
    """

    name: str
    experiment: TimeExperiment
    measured: Array
    simulated: Array

    @property
    def where(self) -> str:
        """The signal in words."""
        return f"'{self.name}' of recording '{self.experiment.name}'"

    @cached_property
    def likeness(self) -> tuple[float, float]:
        """Correlation, and the signed factor of the measured against the simulated signal."""
        there = np.isfinite(self.measured)
        return _likeness(self.measured[there], self.simulated[there])

    @cached_property
    def shift(self) -> tuple[int, float]:
        """Samples by which the recording is late (early if below zero), and the error left of that without a shift.

        (0, 1.0) where the two are not alike, or samples are not evenly spaced.
        """
        e, far = self.experiment, RECORDING_CHECKS.farthest
        there = np.flatnonzero(np.isfinite(self.measured))
        if e.uneven or len(there) < 0.9 * len(self.measured) or len(self.measured) < 4 * far:
            return 0, 1.0
        if abs(self.likeness[0]) < RECORDING_CHECKS.alike:
            return 0, 1.0
        y = np.interp(np.arange(len(self.measured)), there, self.measured[there])
        inner, ones = slice(far, len(y) - far), np.ones(len(y) - 2 * far)
        left: dict[int, float] = {}
        for k in range(-far, far + 1):
            a = np.column_stack([np.roll(self.simulated, k)[inner], ones])
            left[k] = float(np.sum((y[inner] - a @ np.linalg.lstsq(a, y[inner], rcond=None)[0]) ** 2))
        best = min(left, key=lambda k: left[k])
        return best, left[best] / left[0] if left[0] > 0 else 1.0


def _by_itself(e: TimeExperiment, names: Sequence[str], units: Sequence[str]) -> list[Remark]:
    """What is wrong with the signals of a recording whatever the model."""
    found = []
    drives = _drives(e)
    found += [Remark(f"in recording '{e.name}', {text}", fitted, refutable=True) for text, fitted in e.wraps.items()]
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        where, values = f"'{name}' of recording '{e.name}'", e.measured[:, k]
        spiked = e.outliers[k] if e.outliers else 0
        if spiked:
            found.append(Remark(f"{spiked} of {len(values)} samples of {where} are spikes and were left out", False))
        told = unit not in _MOTION or bool(e.wraps)
        jumps = None if told else quality.wraps(values, e.logged[k] if e.logged else 1.0)
        if jumps is not None:
            size, count, of = jumps
            text = (
                f"{where} jumps {count} time{'s' if count > 1 else ''} by {size:.4g} {unit}, {of} of the logged "
                f"numbers: does it wrap? Give the range as 'wrap:'"
            )
            found.append(Remark(text, True))
        for part in quality.frozen(values):
            since, until = e.time[part.start], e.time[part.stop - 1]
            text = f"{where} keeps one value from {since:.4g} s to {until:.4g} s and then jumps: was the sensor stuck?"
            found.append(Remark(text, True, refutable=True))
        often = quality.every(values)
        if often > 1:
            found.append(
                Remark(f"{where} has a new value at every {often}. sample only: it is late by up to that", False)
            )
        if e.loop == "open" and not e.uneven:
            ahead = quality.early(values, drives)
            if ahead:
                text = (
                    f"{where} answers the input {ahead} sample{'s' if ahead > 1 else ''} before it comes: is the "
                    "drive's column late?"
                )
                found.append(Remark(text, True, refutable=True))
    return found + _kinematics(e, names)


def _drives(e: TimeExperiment) -> list[Array]:
    """The inputs at the samples."""
    if e.drive is None:
        return []
    time = np.asarray(e.drive.time, dtype=float)
    values = np.asarray(e.drive.values, dtype=float).reshape(len(time), -1)
    return [np.interp(e.time, time, column) for column in values.T]


def _kinematics(e: TimeExperiment, names: Sequence[str]) -> list[Remark]:
    """Speeds of a flange whose integral is another motion than its position's."""
    found = []
    for kind in MOTION.values():
        for i, name in enumerate(names):
            flange, _, quantity = name.rpartition(".")
            other = f"{flange}.{kind[1][0]}"
            if quantity != kind[0][0] or other not in names:
                continue
            position, speed = e.measured[:, i], e.measured[:, names.index(other)]
            there = np.isfinite(position) & np.isfinite(speed)
            if there.sum() < RECORDING_CHECKS.farthest:
                continue
            t, x, v = e.time[there], position[there], speed[there]
            way = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
            a = np.column_stack([way, t - t[0], np.ones(len(t))])
            solved, *_ = np.linalg.lstsq(a, x, rcond=None)
            rest = x - a @ solved
            moved = way - np.polyval(np.polyfit(t, way, 1), t)
            if float(moved @ moved) <= 0 or float(rest @ rest) > RECORDING_CHECKS.odd_way * float(moved @ moved):
                continue
            if abs(math.log(abs(solved[0]) or 1e-9)) > RECORDING_CHECKS.way or solved[0] < 0:
                text = (
                    f"'{name}' of recording '{e.name}' moves {solved[0]:.4g} times as far as '{other}' says: is one of "
                    "them scaled wrongly, or does the clock run wrong?"
                )
                times = float(solved[0])
                scales = ((name, times), (other, 1 / times)) if times > 0 else ()
                found.append(Remark(text, not _is_near(abs(times), 1.0), scales=scales))
    return found


def _is_near(factor: float, other: float) -> bool:
    """Whether two factors, neither of them negative, are one but for what a fit or noise may make of them."""
    return abs(math.log(max(factor, 1e-9) / other)) <= RECORDING_CHECKS.near


def clocks(problem: Problem) -> list[Remark]:
    """A clock that is a share off, where that explains what no parameter within its tolerance can.

    The clock's rate is sought among a few, since the phase of an oscillation is not linear in it; beside each the
    residual is taken to be linear in the parameters, and in the rate's last correction.
    """
    trained = over_time(problem.training)
    zero = np.zeros(len(problem.free))
    if not trained:
        return []

    def error(rate: float) -> float:
        return sum(float(np.sum(r**2)) for r in problem.residuals(zero, [_stretched(e, rate) for e in trained]))

    rates = (0.0, *(sign * rate for rate in RECORDING_CHECKS.clock_rates for sign in (1, -1)))
    nearest = min(rates, key=error)
    try:
        without = _clock_fit(problem, trained, 0.0)[1]
        rate, gained = _clock_fit(problem, trained, nearest, free=True)
    except (ParameterError, SimulationError):
        return []
    if abs(rate) < RECORDING_CHECKS.clock or gained > RECORDING_CHECKS.halved * without:
        return []
    text = (
        f"times that are {100 * abs(rate):.2g} % {'longer' if rate > 0 else 'shorter'} than logged would explain "
        f"{100 * (1 - gained / without):.0f} % of what no parameter within its tolerance does: is the clock right?"
    )
    return [Remark(text, False)]


def _clock_fit(
    problem: Problem, trained: Sequence[TimeExperiment], rate: float, *, free: bool = False
) -> tuple[float, float]:
    """Rate of the clock, and the error that parameters, and the rate where it is ``free``, leave beside ``rate``.

    Raises:
        FlexarmError: the model cannot be simulated or differentiated there.
    """
    zero, step = np.zeros(len(problem.free)), RECORDING_CHECKS.clock_step
    parts = [problem.linearised(zero, _stretched(e, rate)) for e in trained]
    r, J = np.concatenate([r for r, _ in parts]), np.vstack([J for _, J in parts])
    weights = problem.prior(zero)[1]
    if free:
        ends = [
            np.concatenate([r.ravel() for r in problem.residuals(zero, [_stretched(e, rate + side) for e in trained])])
            for side in (step, -step)
        ]
        J = np.column_stack([J, (ends[0] - ends[1]) / (2 * step)])
        weights = np.column_stack([weights, np.zeros(len(weights))])
    # What a model leaves over anyway is no white noise of the sensor's size: the tolerances count against that.
    level, left, x = math.sqrt(max(float(np.mean(r**2)), 1.0)), 0.0, zero
    for _ in range(3):
        a, b = np.vstack([J, level * weights]), np.concatenate([r, np.zeros(len(weights))])
        x = np.linalg.lstsq(a, -b, rcond=None)[0]
        left = float(np.sum((b + a @ x) ** 2))
        level = math.sqrt(max(left / len(r), 1.0))
    return rate + (float(x[-1]) if free else 0.0), left


def _stretched(e: TimeExperiment, share: float) -> TimeExperiment:
    """The experiment as a clock would have logged it that ran slower by a share."""
    drive = e.drive
    if drive is not None:
        drive = replace(drive, time=np.asarray(drive.time, dtype=float) * (1 + share))
    return replace(e, time=e.time * (1 + share), step=e.step * (1 + share), drive=drive)


def _upside_down(beside: Sequence[Compared]) -> list[Remark]:
    """Signals that run against the model in all recordings; in one alone a resonance beside the input may do that."""
    found = []
    alike: dict[str, list[float]] = {}
    for one in beside:
        alike.setdefault(one.name, []).append(one.likeness[0])
    for name, correlations in alike.items():
        clear = [c for c in correlations if abs(c) >= RECORDING_CHECKS.alike]
        if clear and max(clear) < 0:
            often = f"in {len(clear)} of {len(correlations)} recordings" if len(correlations) > 1 else ""
            text = f"'{name}' runs against the model {often} (correlation {min(clear):.2f})".replace("  ", " ")
            found.append(Remark(f"{text}: is its sign right?", True, turned=name))
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


def _scale(one: Compared) -> list[Remark]:
    correlation, gain = one.likeness
    if abs(correlation) < RECORDING_CHECKS.alike or not gain:
        return []
    return [
        Remark(
            f"{one.where} is {abs(gain):.3g} times as large as the model's (correlation {correlation:.2f}): {guess}?",
            True,
        )
        for factor, guess in UNITS
        if abs(math.log(abs(gain) / factor)) < RECORDING_CHECKS.near
    ]


def _common_gain(beside: Sequence[Compared], problem: Problem) -> list[Remark]:
    """All signals larger or smaller than the model's by one factor: what drives the model is scaled wrongly."""
    driven = [one for one in beside if one.experiment.drive is not None]
    gains = [abs(one.likeness[1]) for one in driven if abs(one.likeness[0]) >= RECORDING_CHECKS.alike]
    if not gains or len(gains) < len(driven) or min(gains) <= 0:
        return []
    logs = np.log(gains)
    middle = float(np.median(logs))
    if np.ptp(logs) > RECORDING_CHECKS.one_gain or abs(middle) < RECORDING_CHECKS.gain:
        return []
    if any(abs(middle - math.log(factor)) < RECORDING_CHECKS.near for factor, _ in UNITS):
        return []
    inputs = " and ".join(f"'{v.name}'" for v in problem.model.inputs)
    every = "every signal" if len(gains) > 1 else driven[0].where
    text = (
        f"{every} is {math.exp(middle):.3g} times as large as the model's: is the drive of {inputs} logged at "
        f"{math.exp(-middle):.3g} times its value, or a gain (torque constant, resistance, ratio) far off?"
    )
    return [Remark(text, False)]


def _shifts(beside: Sequence[Compared]) -> list[Remark]:
    """Whole numbers of samples by which recordings are early or late; the drive's column where all are alike."""
    found, early = [], []
    for one in beside:
        best, left = one.shift
        if best == 0 or left > RECORDING_CHECKS.halved:
            continue
        samples = f"{abs(best)} sample{'s' if abs(best) > 1 else ''} ({abs(best) * one.experiment.interval:g} s)"
        if best < 0:
            early.append(best)
            text = (
                f"{one.where} is {samples} ahead of the model, before its cause: is a column shifted against the time?"
            )
            found.append(Remark(text, True, refutable=True))
        else:
            text = (
                f"{one.where} is {samples} behind the model: there is a delay, or a column is shifted against the time"
            )
            found.append(Remark(text, False))
    if len(early) > 1 and len(early) == len(beside) and max(early) - min(early) <= 1:
        late = abs(round(float(np.median(early))))
        text = (
            f"every signal is {late} sample{'s' if late > 1 else ''} ahead of the model, before its cause: the drive's "
            "column is late by that"
        )
        return [Remark(text, True, refutable=True)]
    return found


def _clipped(where: str, y: Array, s: Array) -> list[Remark]:
    """Runs of equal samples at an extreme that the signal reaches at speed, and the model crosses.

    A joint that friction holds still comes to rest first; its model does not go on beyond either. Within a sensor's own
    step, such as an encoder's count, every model goes beyond what was recorded.
    """
    span = float(np.ptp(y))
    step = float(np.diff(np.unique(y)).min(initial=span))
    gain = _likeness(y, s)[1]
    moves = np.abs(np.diff(y))
    usual = math.sqrt(float(np.mean(moves**2))) if len(moves) else 0.0
    found = []
    for extreme, sign in ((float(y.max()), 1.0), (float(y.min()), -1.0)):
        at = np.concatenate([[False], y == extreme, [False]])
        begins, ends = np.flatnonzero(~at[:-1] & at[1:]), np.flatnonzero(at[:-1] & ~at[1:])
        model = y.mean() + gain * (s - s.mean()) if gain else y
        clipped = [
            (b, e)
            for b, e in zip(begins.tolist(), ends.tolist(), strict=True)
            if e - b >= RECORDING_CHECKS.run
            and b > RECORDING_CHECKS.approach
            and e + RECORDING_CHECKS.approach < len(y)
            and _speed(moves, b, e) >= RECORDING_CHECKS.abrupt * usual
            and (sign * (model[b:e] - extreme)).max() > max(RECORDING_CHECKS.beyond * span, step)
        ]
        if clipped:
            side = "largest" if sign > 0 else "smallest"
            held, runs = sum(e - b for b, e in clipped), f"{len(clipped)} run{'s' if len(clipped) > 1 else ''}"
            text = f"{where} stays at its {side} value, {extreme:g}, for {held} samples in {runs}"
            found.append(
                Remark(f"{text}, and the model goes beyond: is the sensor at the end of its range?", True, True)
            )
    return found


def _speed(moves: Array, begin: int, end: int) -> float:
    """Mean move of the samples by which a run is entered or left, whichever is slower."""
    few = RECORDING_CHECKS.approach
    return float(min(moves[begin - few : begin].mean(), moves[end - 1 : end - 1 + few].mean()))
