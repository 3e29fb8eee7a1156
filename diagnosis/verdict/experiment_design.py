"""The next experiment: of a menu of inputs, the one on which the rivals' predictions differ most."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.frequency_response.table_experiment import tables
from diagnosis.search.equivalent_effects import NESTED
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import NEXT_EXPERIMENT
from diagnosis.verdict.table_report import choose_rows
from engine.errors import FlexarmError
from engine.model import Model
from engine.simulate import Drive

NOTHING = "no_input"
"""Kind of a proposal where no input of the menu separates any two rivals."""

REMEDY = "only another sensor, or taking the part out, tells these apart"


@dataclass(frozen=True)
class Proposal:
    """An input to run on the rig.

    Attributes:
        kind: name in the menu, or `NOTHING`; then it is the input on which they differ most.
        sentence: what to do.
        separates: the rivals' labels.
        expected: smallest expected log Bayes factor between two rivals that are separated.
        time, drive: instants (s) and input, shape (n,).
        input, unit: name and unit of the driven input.
        predictions: what each rival predicts, label -> shape (n, signals).
        signals: names of the signals.
        axis: what ``time`` is: for the rows of a table to measure, frequencies, with ``drive`` the amplitudes.
    """

    kind: str
    sentence: str
    separates: tuple[str, ...]
    expected: float
    time: Array
    drive: Array
    input: str
    unit: str
    predictions: dict[str, Array]
    signals: tuple[str, ...]
    axis: str = "t [s]"

    @property
    def separating(self) -> bool:
        """Whether the input separates any of the rivals."""
        return self.kind != NOTHING

    def numbers(self) -> dict[str, Any]:
        """As it stands in ``diagnosis.json``."""
        return {
            "kind": self.kind,
            "sentence": self.sentence,
            "separates": list(self.separates),
            "expected_log_bayes_factor": self.expected,
        }


def menu(size: float, sample: float = NEXT_EXPERIMENT.step) -> dict[str, tuple[str, Array, Array]]:
    """Inputs worth trying: name -> (what to do, instants, values).

    Args:
        size: the largest input recorded so far; none of them goes beyond it.
        sample: time (s) between the samples that are recorded; nothing changes faster than they show.
    """
    t: Array = np.arange(0.0, NEXT_EXPERIMENT.duration + 1e-9, NEXT_EXPERIMENT.step)
    rise = np.clip(t / NEXT_EXPERIMENT.duration, 0, 1)
    short = max(NEXT_EXPERIMENT.quick, 5 * sample)
    high = 0.5 / short
    low = min(0.5, high / 4)
    sweep = np.sin(2 * np.pi * low * NEXT_EXPERIMENT.duration / np.log(high / low) * ((high / low) ** rise - 1))
    made = {
        "slow_sine": ("apply a sine of 0.5 Hz", np.sin(np.pi * t)),
        "ramp": ("ramp slowly up and down through zero", 1 - 4 * np.abs(rise - 0.5)),
        "reversal": ("reverse a constant input every second", np.sign(np.sin(np.pi * t + 1e-9))),
        "push": (
            "push one way for half of the time, then the other way",
            np.where(t < NEXT_EXPERIMENT.duration / 2, 1.0, -1.0),
        ),
        "levels": ("apply levels of random size and direction, half a second each", _held(t, 0.5, levels=True)),
    }
    for bit in [b for b in (max(0.1, 4 * short), 4 * short, 2 * short, short) if b < NEXT_EXPERIMENT.duration / 20]:
        told = f"apply a random binary sequence with bits of {1e3 * bit:g} ms"
        made[f"prbs_{1e3 * bit:g}ms"] = (told, _held(t, bit))
    made |= {
        "chirp": (f"apply a sine whose frequency rises from {low:g} to {high:g} Hz", sweep),
        "amplitude_sweep": ("apply a 1 Hz sine whose amplitude grows", rise * np.sin(2 * np.pi * t)),
        "fast_amplitude_sweep": ("apply a 4 Hz sine whose amplitude grows", rise * np.sin(8 * np.pi * t)),
        "free_decay": ("drive for a second, then let it coast", np.where(t < 1.0, 1.0, 0.0)),
        "both_ways_decay": ("drive back for a second, then let it coast", np.where(t < 1.0, -1.0, 0.0)),
    }
    return {kind: (told, t, size * values) for kind, (told, values) in made.items()}


def _held(t: Array, hold: float, levels: bool = False) -> Array:
    """Random values, each held for a time: levels, or the two ends."""
    place = np.floor(t / hold + 1e-6).astype(int)
    random = np.random.default_rng(7)
    values = random.uniform(-1.0, 1.0, place[-1] + 1) if levels else random.choice([-1.0, 1.0], place[-1] + 1)
    return np.asarray(values[place])


def propose(rivals: Sequence[ScoredModel], given: Model, most: int = 8) -> Proposal | None:
    """The input of the menu that best separates the rivals.

    A rival that is a richer form of another one cannot be separated from it where the simpler one is right, so that
    the simpler one stands for both.

    Args:
        rivals: fitted models, first the one that leads.
        given: the user's model, whose input the experiment drives: that of a rival may lie before what was put in.
        most: number of rivals that are compared.
    """
    problem = rivals[0].fit.problem
    if tables(problem.experiments):
        return propose_rows(rivals, problem)
    e = over_time(problem.experiments)[0]
    kept = [r for r in rivals if r is rivals[0] or not any(_richer(r, other) for other in rivals)][:most]
    if e.drive is None or len(problem.model.inputs) != 1 or len(kept) < 2:
        return None
    size = max(
        float(np.abs(np.asarray(x.drive.values)).max()) for x in over_time(problem.experiments) if x.drive is not None
    )
    pairs = list(itertools.combinations(range(len(kept)), 2))
    held = [_held_by(r) for r in kept]
    driven, signals = given.inputs[0], tuple(v.name for v in given.outputs)
    best: Proposal | None = None
    most_worth = -math.inf
    highest = dict.fromkeys(pairs, 0.0)
    for kind, (sentence, time, drive) in menu(size, e.shortest).items():
        try:
            made = [_predict(r, time, drive) for r in kept]
        except FlexarmError:
            continue
        gaps = {(i, j): min(_gap(made[i], made[j], held[j]), _gap(made[j], made[i], held[i])) for i, j in pairs}
        highest = {pair: max(highest[pair], gap) for pair, gap in gaps.items()}
        # What is beyond enough to separate two counts for little, so that every pair counts.
        worth = sum(math.log1p(gap) for gap in gaps.values())
        if worth > most_worth:
            apart = min((gap for gap in gaps.values() if gap >= NEXT_EXPERIMENT.separated), default=max(gaps.values()))
            shown = {r.label: m.values for r, m in zip(kept, made, strict=True)}
            best = Proposal(kind, sentence, tuple(shown), apart, time, drive, driven.name, driven.unit, shown, signals)
            most_worth = worth
    return _worded(best, _alike(kept, highest), len(kept)) if best else None


def _alike(kept: Sequence[ScoredModel], highest: dict[tuple[int, int], float]) -> list[list[str]]:
    """Labels of rivals, group by group, that no input of the menu separates from each other."""
    groups: list[list[int]] = []
    for k in range(len(kept)):
        mine = next((g for g in groups if all(highest[j, k] < NEXT_EXPERIMENT.separated for j in g)), None)
        if mine is None:
            groups.append([k])
        else:
            mine.append(k)
    return [[kept[k].label for k in g] for g in groups if len(g) > 1]


def _richer(one: ScoredModel, other: ScoredModel) -> bool:
    """Whether a model is another one with some of its effects in a richer form at the same place."""
    if len(one.effects) != len(other.effects) or {c.key for c in one.effects} == {c.key for c in other.effects}:
        return False
    mine = [(c.effect, c.place) for c in one.effects]
    return all(any((e, c.place) in mine for e in (c.effect, *NESTED.get(c.effect, ()))) for c in other.effects)


def _worded(found: Proposal, alike: Sequence[list[str]], count: int) -> Proposal:
    """The proposal, with a sentence on the rivals that no input of the menu separates."""
    rows = [f"{', '.join(g[:-1])} and {g[-1]} answer alike to every input tried" for g in alike]
    if not rows:
        return found
    if len(alike[0]) == count:
        return replace(found, kind=NOTHING, sentence=f"{rows[0]}: {REMEDY}")
    return replace(found, sentence=f"{'; '.join([found.sentence, *rows])}: {REMEDY}")


def propose_rows(rivals: Sequence[ScoredModel], problem: Problem) -> Proposal | None:
    """The rows of a frequency-response table to measure next."""
    found = choose_rows(rivals)
    if found is None:
        return None
    apart = {label: value for label, value in found.factors.items() if value >= NEXT_EXPERIMENT.separated}
    return Proposal(
        found.kind,
        found.sentence,
        (rivals[0].label, *apart),
        min((apart or found.factors).values()),
        found.rows.frequency,
        found.rows.amplitude,
        found.rows.input,
        found.rows.unit,
        found.predictions,
        tuple(v.name for v in problem.model.outputs),
        "frequency [rad/s]",
    )


@dataclass(frozen=True)
class _Prediction:
    """What a rival does on an input: outputs, shape (n, signals); flat, in standard deviations; and their slopes."""

    values: Array
    scaled: Array
    slopes: Array


def _predict(trial: ScoredModel, time: Array, drive: Array) -> _Prediction:
    """Outputs from rest at the instants that would be recorded, or more often, and what the free parameters change.

    Raises:
        FlexarmError: the simulation fails.
    """
    fit = trial.fit
    e = over_time(fit.problem.experiments)[0]
    every = max(1, math.ceil(e.shortest / NEXT_EXPERIMENT.step - 1e-6))
    step = e.shortest / every
    rows = step * np.arange(int(time[-1] / step + 1e-6) + 1, dtype=float)
    silent, given = np.zeros((len(rows), e.measured.shape[1])), Drive(time, drive[:, None])
    played = TimeExperiment(
        name="next",
        role="train",
        time=rows,
        step=step,
        every=1,
        drive=given,
        measured=silent,
        sigma=e.sigma,
        from_first=e.from_first,
    )
    values = fit.problem.simulate(fit.x, played)[: len(rows)]
    slopes = -fit.problem.linearised(fit.x, played)[1]
    scaled = (values - np.where(e.from_first, values[0], 0.0)) / e.sigma
    weight = every**-0.5
    shown = np.stack([np.interp(time, rows, column) for column in values.T], axis=1)
    return _Prediction(shown, weight * scaled.ravel(), weight * slopes)


def _held_by(trial: ScoredModel) -> Array:
    """How firmly the recordings and the tolerances hold the search vector of a rival, shape (free, free)."""
    fit = trial.fit
    weights = fit.problem.prior(fit.x)[1]
    held = weights.T @ weights
    for e in fit.problem.training:
        with contextlib.suppress(FlexarmError):
            J = fit.problem.linearised(fit.x, e)[1]
            held = held + NEXT_EXPERIMENT.independent * J.T @ J
    return np.asarray(held)


def _gap(truth: _Prediction, other: _Prediction, held: Array) -> float:
    """Expected log Bayes factor for a rival that is true, against another one refitted to all recordings and this one.

    The refit is linear, and held by what the other one was fitted to before.
    """
    apart = truth.scaled - other.scaled
    pull = other.slopes.T @ apart
    bend = NEXT_EXPERIMENT.independent * other.slopes.T @ other.slopes + held
    moved = np.linalg.lstsq(bend, NEXT_EXPERIMENT.independent * pull, rcond=1e-12)[0]
    return max(0.0, 0.5 * NEXT_EXPERIMENT.independent * float(apart @ apart - pull @ moved))
