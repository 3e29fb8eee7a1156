"""Frequency-response tables as experiments: each row is a sine of its own amplitude, simulated until it repeats.

A residual is the reading in dB (re the amplitude of the input) minus the simulated one, over the row's noise. Without a
table to hold out, every second row of a table is held out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.frequency_response.period import PeriodicSolution
from diagnosis.frequency_response.periodic_solver import PeriodicSolver
from diagnosis.frequency_response.sine_model import sine_model
from diagnosis.recordings.columns import RecordingError
from diagnosis.recordings.types import FrequencyTable
from diagnosis.thresholds import FITTING, TABLES
from engine.errors import FlexarmError, ParameterError, SimulationError, nearest
from engine.model import Model
from engine.quantity import factor
from scenarios.load import Scenario

DECIBEL = 20 / math.log(10)

UNSEEN = ("delay", "sensor_bias", "torque_ripple", "outside_vibration", "direction_dependent_friction")
"""Effects that amplitudes of periodic answers do not show: they shift the answer, or it does not repeat with them.

Of friction that differs between the directions they show the mean, which is Coulomb friction.
"""


class BroydenJacobian:
    """A Jacobian that is kept over a few short steps and brought up to date from the residuals alone (Broyden)."""

    def __init__(self) -> None:
        self.x: Array | None = None
        self.r, self.J, self.age = np.zeros(0), np.zeros((0, 0)), 0

    def fresh(self, x: Array, r: Array, J: Array) -> None:
        """Take over one that was computed."""
        self.x, self.r, self.J, self.age = np.array(x), r, J, 0

    def moved(self, x: Array, r: Array) -> Array | None:
        """The Jacobian at ``x``, or None if it is to be computed anew: after a long step, no step, or several."""
        if self.x is None or len(self.x) != len(x) or len(self.r) != len(r):
            return None
        step = np.asarray(x) - self.x
        length = float(np.abs(step).max(initial=0.0))
        if self.age >= TABLES.kept or length > TABLES.near or length < 1e-9:
            return None
        self.J = self.J + np.outer((r - self.r) - self.J @ step, step) / float(step @ step)
        self.x, self.r, self.age = np.array(x), r, self.age + 1
        return self.J


@dataclass(frozen=True, kw_only=True)
class TableExperiment(Experiment):
    """Rows of a frequency-response table.

    ``measured`` is in dB re the input's amplitude, ``time`` counts the rows, ``sigma`` is the median noise in dB.

    Attributes:
        frequency: rad/s, shape (rows,).
        amplitude: of the sine (SI), shape (rows,).
        relative: noise of each reading over ``sigma``, shape (rows, signals).
        answers: of the model.
        input, unit: what the sine drives, and in which unit.
        note: what was done with the table.
        orbits: periodic answers at the latest linearisation, by row; the next ones start there.
        slope: the latest Jacobian.
        latest: the latest answers, by parameters.
    """

    sparse: ClassVar[bool] = True

    frequency: Array
    amplitude: Array
    relative: Array
    answers: PeriodicSolver
    input: str
    unit: str
    note: str = ""
    solutions: dict[int, PeriodicSolution] = field(default_factory=dict, compare=False)
    slope: BroydenJacobian = field(default_factory=BroydenJacobian, compare=False)
    latest: dict[Any, list[PeriodicSolution]] = field(default_factory=dict, compare=False)

    @property
    def lowest_frequency(self) -> float:
        """Lowest frequency (rad/s) of the table."""
        return float(self.frequency.min())

    @property
    def highest_frequency(self) -> float:
        """Highest frequency (rad/s) of the table."""
        return float(self.frequency.max())

    def lowest(self, share: float) -> TableExperiment:
        """The rows of the lowest frequencies, as a share of all."""
        return self.rows(np.argsort(self.frequency, kind="stable")[: round(share * len(self.time))])

    @property
    def interval(self) -> float:
        """1: rows are independent, and a block of them is one row."""
        return 1.0

    @property
    def shortest(self) -> float:
        """The shortest time (s) that it resolves: a third of a radian at the highest frequency."""
        return 1 / (3 * float(self.frequency.max()))

    @property
    def longest(self) -> float:
        """The longest time constant (s) that it can tell from a longer one: three radians at the lowest frequency."""
        return 3 / float(self.frequency.min())

    def cut(self, share: float) -> TableExperiment:
        """The same: there is no horizon to grow."""
        return self

    def squares(self, r: Array) -> Array:
        """The squares; of held-out rows they grow in proportion beyond a few sigma: a misread row does not decide."""
        if self.role != "hold_out":
            return super().squares(r)
        size = np.abs(r)
        return np.where(size < TABLES.credible, size**2, 2 * TABLES.credible * size - TABLES.credible**2)

    def rows(self, keep: NDArray[np.int64]) -> TableExperiment:
        """Some of the rows."""
        return _part(self, keep, self.name, self.role, self.note)

    def residual(self, simulated: Array) -> Array:
        """(measured - simulated) / noise, shape (rows, signals); ``simulated`` in dB."""
        return np.asarray((self.measured - simulated) / (self.sigma * self.relative))

    def in_units(self, r: Array) -> Array:
        """Residuals (rows, signals) in dB."""
        return np.asarray(r * self.sigma * self.relative)

    def outputs(
        self, model: Model, parameters: dict[str, float], starts: dict[str, float], longest: float | None
    ) -> Array:
        """Simulated amplitudes in dB re the input's, shape (rows, signals).

        Raises:
            SimulationError: the model diverges.
        """
        return self.decibels(self.solved(parameters, self.solutions))

    def solved(self, parameters: dict[str, float], near: dict[int, PeriodicSolution]) -> list[PeriodicSolution]:
        """The periodic answer of each row; the latest ones are kept, for a fit asks for them twice."""
        key = tuple(sorted(parameters.items()))
        found = self.latest.get(key)
        if found is None:
            found = self.answers.solve(parameters, self.frequency, self.amplitude, near)
            while len(self.latest) >= TABLES.latest:
                self.latest.pop(next(iter(self.latest)), None)
            self.latest[key] = found
        return found

    def decibels(self, solutions: Sequence[PeriodicSolution]) -> Array:
        """Amplitudes in dB re the input's; an answer of zero is far below every reading."""
        return self._decibels(np.array([o.amplitudes for o in solutions]))

    def _decibels(self, amplitudes: Array) -> Array:
        return np.asarray(DECIBEL * np.log(np.maximum(amplitudes / self.amplitude[:, None], 1e-30)))

    def linearised(
        self,
        model: Model,
        free: Sequence[FreeParameter],
        x: Array,
        starts: dict[str, float],
        longest: float | None,
        only: Sequence[int] | None = None,
    ) -> tuple[Array, Array]:
        """Residual, flat, and its Jacobian by differences, of all variables.

        Raises:
            SimulationError: the model diverges.
        """

        def at(there: Array) -> dict[str, float]:
            return {f.name: f.value(v) for f, v in zip(free, there, strict=True) if not f.recording}

        base = self.solved(at(x), self.solutions)
        near = dict(enumerate(base))
        self.solutions.update(near)
        r = self.residual(self.decibels(base)).ravel()
        J = self.slope.moved(x, r)
        if J is not None:
            return np.clip(r, -FITTING.huge, FITTING.huge), J
        J = np.zeros((len(r), len(free)))
        moves = []
        for i in range(len(free)):
            for h in (TABLES.difference, -TABLES.difference):
                there = np.array(x, dtype=float)
                there[i] += h
                # At a bound the parameter does not move: look the other way.
                if free[i].value(there[i]) != free[i].value(x[i]):
                    moves.append((i, h, at(there)))
                    break
        found = self.answers.near([values for _, _, values in moves], base, self.frequency, self.amplitude)
        for (i, h, _), amplitudes in zip(moves, found, strict=True):
            J[:, i] = (self.residual(self._decibels(amplitudes)).ravel() - r) / h
        if not np.isfinite(J).all() or np.abs(J).max(initial=0.0) > FITTING.huge**2:
            raise SimulationError("the sensitivities grow without bound")
        self.slope.fresh(x, r, J)
        return np.clip(r, -FITTING.huge, FITTING.huge), J

    def on_variant(
        self, scenario: Scenario, inputs: Sequence[str], outputs: Sequence[str], others: Sequence[Experiment]
    ) -> tuple[Model, list[Experiment]]:
        """The model with the sine's input open, and the tables with its periodic answers.

        Raises:
            FlexarmError: the variant has no meaning.
        """
        answers = _answers(scenario, inputs[0], self.unit, list(outputs), self.answers.largest_step)
        mine = [
            replace(e, answers=answers, input=inputs[0], solutions={}, slope=BroydenJacobian(), latest={})
            for e in tables(others)
        ]
        return answers.plain, list(mine)

    def fingerprint(self) -> list[Array]:
        """Frequencies, amplitudes, readings and their noise."""
        return [self.frequency, self.amplitude, self.measured, self.sigma, self.relative]

    def disturbed_inputs(self, size: float, delay: float) -> list[TableExperiment]:
        """Nothing: the amplitude of a sine is what the table is relative to."""
        return []

    def largest_inputs(self, count: int) -> Array:
        """The largest amplitude of the sine, shape (1,)."""
        return np.array([float(np.abs(self.amplitude).max())])

    def spans(
        self, scenario: Scenario, model: Model, names: Sequence[str], longest: float | None
    ) -> dict[str, tuple[float, float]]:
        """Peak to peak and root mean square of signals in the nominal model's periodic answers.

        Each is a mean over the rows' logarithms.
        """
        answers = _answers(scenario, self.input, self.unit, list(names), None)
        found = replace(self, answers=answers, solutions={}, latest={}).solved({}, {})
        ranges = np.array([2 * o.amplitudes for o in found])
        rms = np.array([o.rms for o in found])
        tops = [np.exp(np.mean(np.log(np.maximum(values, 1e-30)), axis=0)) for values in (ranges, rms)]
        return {name: (float(tops[0][k]), float(tops[1][k])) for k, name in enumerate(names)}

    def unseen_effects(self) -> tuple[str, ...]:
        """Effects that amplitudes of periodic answers do not show."""
        return UNSEEN

    def where_residual_is_large(self, r: Array, names: Sequence[str]) -> tuple[str, str]:
        """At which rows half of the residual's energy lies, and where it is largest in dB."""
        energy = np.sum(r**2, axis=1)
        order = np.argsort(-energy)
        count = int(np.searchsorted(np.cumsum(energy[order]), 0.5 * energy.sum())) + 1
        where = ", ".join(f"{w:g}" for w in sorted(self.frequency[order[:count]])[:8])
        more = ", ..." if count > 8 else ""
        left = r * self.sigma * self.relative
        row, k = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        side = "below" if left[row, k] > 0 else "above"
        return (
            f"half of it in {count} of {len(r)} rows, at {where}{more} rad/s",
            f"largest at {self.frequency[row]:g} rad/s, where the model is {abs(left[row, k]):.2g} dB {side} the "
            f"reading of {names[int(k)]}",
        )


def _answers(scenario: Scenario, drive: str, unit: str, signals: list[str], step: float | None) -> PeriodicSolver:
    """The model with and without a sine on its input."""
    from diagnosis.recordings.types import Channel

    channels = tuple(Channel(name, "", np.zeros(0)) for name in signals)
    table = FrequencyTable("", "", drive, np.zeros(0), np.zeros(0), unit, channels)
    return PeriodicSolver(scenario.build([drive], signals), sine_model(scenario, table), step)


def prepared(scenario: Scenario, given: Sequence[FrequencyTable]) -> tuple[Model, list[Experiment]]:
    """The model with the tables' input open, and the tables as experiments.

    Without a table to hold out, rows are held out in turn: the first, third, fifth ... are fitted.

    Raises:
        FlexarmError: a table that does not fit the scenario or the others, or has too few rows.
    """
    first = given[0]
    names = [channel.name for channel in first.responses]
    inputs = scenario.system.inputs()
    for table in given:
        if table.drive not in inputs:
            raise RecordingError(f"'{table.drive}' is not an input", remedy=nearest(table.drive, inputs))
        if table.drive != first.drive or [channel.name for channel in table.responses] != names:
            raise FlexarmError(
                f"table '{table.name}' has another drive or other signals than '{first.name}'",
                remedy="give tables with the same drive and responses",
            )
    split = not any(table.role == "hold_out" for table in given)
    experiments: list[Experiment] = []
    answers = _answers(scenario, first.drive, first.amplitude_unit, names, _finest(given))
    for table in given:
        whole = _experiment(table, answers)
        if not split or table.role == "repeat" or len(whole.time) < 2 * TABLES.fewest:
            experiments.append(whole)
            continue
        order = np.argsort(whole.frequency, kind="stable")
        for role, begin, which in (("train", 0, "odd"), ("hold_out", 1, "even")):
            keep = order[begin::2]
            note = f"table '{table.name}': the odd rows in order of frequency are fitted, the even ones are held out"
            experiments.append(_part(whole, keep, f"{table.name} ({which} rows)", role, note))
    return answers.plain, experiments


def _finest(tables: Sequence[FrequencyTable]) -> float | None:
    return min((t.largest_step for t in tables if t.largest_step is not None), default=None)


def _part(whole: TableExperiment, keep: NDArray[np.int64], name: str, role: str, note: str) -> TableExperiment:
    return replace(
        whole,
        name=name,
        role=role,
        note=note,
        time=np.arange(len(keep), dtype=float),
        measured=whole.measured[keep],
        frequency=whole.frequency[keep],
        amplitude=whole.amplitude[keep],
        relative=whole.relative[keep],
        solutions={},
        slope=BroydenJacobian(),
        latest={},
    )


def _experiment(table: FrequencyTable, answers: PeriodicSolver) -> TableExperiment:
    rows = len(table.frequency)
    if rows < TABLES.fewest:
        raise RecordingError(f"table '{table.name}' has {rows} rows", remedy=f"a fit needs at least {TABLES.fewest}")
    measured, noise = [], []
    for channel, variable in zip(table.responses, answers.plain.outputs, strict=True):
        try:
            scale = factor(channel.unit, variable.unit)
        except ParameterError as error:
            raise RecordingError(f"'{channel.name}' in table '{table.name}': {error.message}") from None
        level = DECIBEL * np.log(channel.values * scale / table.amplitude)
        measured.append(level)
        if channel.noise is not None:
            noise.append(DECIBEL * channel.noise / channel.values)
        else:
            grain = quantum(channel.values) / math.sqrt(12) * DECIBEL / channel.values
            noise.append(np.hypot(grain, scatter(table.frequency, level)))
    sigma = np.array([float(np.median(n)) for n in noise])
    return TableExperiment(
        name=table.name,
        role=table.role,
        time=np.arange(rows, dtype=float),
        measured=np.column_stack(measured),
        sigma=sigma,
        frequency=np.asarray(table.frequency),
        amplitude=np.asarray(table.amplitude),
        relative=np.column_stack(noise) / sigma,
        answers=answers,
        input=table.drive,
        unit=table.amplitude_unit,
    )


def quantum(values: Array) -> float:
    """The largest step of which all readings are multiples; that of their last digit if chance could make one.

    Readings off a plot, a counter or a coarse converter are multiples of a step, whatever digits they are printed with.
    """
    clean = np.unique(np.asarray(values, dtype=float))
    digit = _last_digit(clean)
    top = float(clean[-1])
    # A reading agrees with a step by chance with probability 2 * 0.08, and a few may be misprinted; that many steps may
    # be tried before chance alone would have made one.
    wrong = len(clean) // 15
    chance = math.comb(len(clean), wrong) * 0.16 ** (len(clean) - wrong - 1)
    most = min(0.01 / chance, 0.3 * top / digit, 20_000.0)
    if most < 2:
        return digit
    counts = np.arange(1.0, most, 0.04)
    for part in np.array_split(counts, max(1, len(counts) // 20_000)):
        number = clean[:, None] / top * part
        off = np.sort(np.abs(number - np.round(number)), axis=0)[len(clean) - 1 - wrong]
        good = np.flatnonzero(off < 0.08)
        if len(good):
            number = np.round(clean * part[good[0]] / top)
            return float(clean @ number / (number @ number))
    return digit


def _last_digit(values: Array) -> float:
    for places in range(-3, 13):
        if np.all(np.abs(np.round(values, places) - values) <= 1e-12 * np.abs(values)):
            return float(10.0**-places)
    return float(10.0**-12)


def scatter(frequency: Array, level: Array) -> float:
    """Standard deviation (dB) of readings about the cubic through the two neighbours on either side, robustly."""
    order = np.argsort(frequency, kind="stable")
    w, y = np.log(np.asarray(frequency)[order]), np.asarray(level)[order]
    keep = np.concatenate([[True], np.diff(w) > 1e-9])
    w, y = w[keep], y[keep]
    found = []
    for i in range(2, len(w) - 2):
        at = [i - 2, i - 1, i + 1, i + 2]
        weights = [np.prod([(w[i] - w[k]) / (w[j] - w[k]) for k in at if k != j]) for j in at]
        found.append((y[i] - float(np.dot(weights, y[at]))) / math.sqrt(1 + float(np.dot(weights, weights))))
    return 1.4826 * float(np.median(np.abs(found))) if len(found) >= 3 else 0.0


def tables(experiments: Sequence[Experiment]) -> list[TableExperiment]:
    """Those of some experiments that are tables."""
    return [e for e in experiments if isinstance(e, TableExperiment)]
