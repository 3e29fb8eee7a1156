"""What a verdict says of frequency-response tables: remarks, the next rows to measure, and the figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.frequency_response.table_experiment import BroydenJacobian, TableExperiment, tables
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Study
from diagnosis.thresholds import NEXT_EXPERIMENT, WORDING
from engine.errors import SimulationError


def remarks(problem: Problem) -> list[str]:
    """What makes names given from these tables less sure, in sentences."""
    given = tables(problem.experiments)
    if not given:
        return []
    rows = list(dict.fromkeys(e.note for e in given if e.note))
    fitted = [e for e in given if e.role != "hold_out"]
    if len({round(float(a), 9) for e in fitted for a in e.amplitude}) == 1:
        rows.append(
            f"all rows have one amplitude ({fitted[0].amplitude[0]:g} {fitted[0].unit}): effects that depend on "
            "amplitude are hard to tell apart"
        )
    if all(len(e.time) < WORDING.few_rows for e in given):
        count = sum(len(e.time) for e in given)
        rows.append(f"{count} rows are few: small gains on held-out rows may be chance")
    return rows


def absorbed(study: Study) -> list[str]:
    """What parameters took up where a table shows nothing missing once they have moved within their tolerances."""
    refit = study.refit
    if (
        not tables(refit.fit.problem.experiments)
        or study.chosen.effects
        or study.nominal[1] < WORDING.absorbed * max(refit.hold_out, 1.0)
    ):
        return []
    moved = [(f.name, f.value(x) / f.start - 1) for f, x in zip(refit.fit.problem.free, refit.fit.x, strict=True)]
    moved.sort(key=lambda pair: -abs(pair[1]))
    shown = ", ".join(f"{name} by {100 * share:+.1f} %" for name, share in moved[:4] if abs(share) > WORDING.moved)
    return [
        f"the parameters took up a mismatch of {study.nominal[1]:.3g} times the floor within their tolerances "
        f"({shown}): "
        "if these values are known, say so under 'tolerances:' in the scenario and diagnose again"
    ]


def row_menu(e: TableExperiment) -> dict[str, tuple[str, Array, Array]]:
    """Rows worth measuring: kind -> (what to do, frequencies, amplitudes); as many readings each."""
    top = float(e.amplitude.max())
    order = np.sort(e.frequency)
    made: dict[str, tuple[str, Array, Array]] = {}
    picks = np.unique(order[np.round(np.linspace(0, len(order) - 1, NEXT_EXPERIMENT.frequencies)).astype(int)])
    shares = np.array(NEXT_EXPERIMENT.amplitudes)
    made["amplitude_sweep"] = (
        "repeat some frequencies at several amplitudes",
        np.repeat(picks, len(shares)),
        np.tile(top * shares, len(picks)),
    )
    whole = np.unique(order[np.round(np.linspace(0, len(order) - 1, len(picks) * len(shares))).astype(int)])
    made["repeat"] = ("repeat the table", whole, np.full(len(whole), top))
    made["half_amplitude"] = ("repeat the table at half the amplitude", whole, np.full(len(whole), top / 2))
    between = np.sqrt(whole[1:] * whole[:-1])
    made["between"] = ("read between the frequencies of the table", between, np.full(len(between), top))
    return made


@dataclass(frozen=True)
class Choice:
    """Rows to measure next.

    Attributes:
        kind, sentence: name in the menu, and what to do.
        rows: frequencies and amplitudes.
        predictions: label of each model -> its prediction in dB, shape (rows, signals).
        factors: label of each rival -> expected log Bayes factor against the model that leads.
    """

    kind: str
    sentence: str
    rows: TableExperiment
    predictions: dict[str, Array]
    factors: dict[str, float]


def choose_rows(models: Sequence[ScoredModel]) -> Choice | None:
    """The rows of the menu that separate most rivals from the model that leads, the first.

    Returns:
        None if the models were not fitted to tables or cannot be simulated there.
    """
    given = tables(models[0].fit.problem.experiments)
    if not given:
        return None
    first = given[0]
    best: tuple[float, Choice] | None = None
    for kind, (sentence, frequency, amplitude) in row_menu(first).items():
        rows = _rows(first, frequency, amplitude)
        predictions: dict[str, Array] = {}
        for model in models:
            own = tables(model.fit.problem.experiments)[0]
            try:
                predictions[model.label] = model.fit.problem.simulate(model.fit.x, _rows(own, frequency, amplitude))
            except SimulationError:
                continue
        if models[0].label not in predictions or len(predictions) < 2:
            continue
        lead = predictions[models[0].label]
        factors = {label: _factor(lead, made, rows) for label, made in predictions.items() if made is not lead}
        worth = sum(min(value, NEXT_EXPERIMENT.enough) for value in factors.values())
        if best is None or worth > best[0]:
            best = worth, Choice(kind, sentence, rows, predictions, factors)
    return best[1] if best else None


def _factor(a: Array, b: Array, rows: TableExperiment) -> float:
    """Expected log Bayes factor of two predictions, after a gain of each signal that a refit could absorb."""
    apart = a - b
    return 0.5 * float(np.sum(((apart - apart.mean(axis=0)) / rows.sigma) ** 2))


def _rows(e: TableExperiment, frequency: Array, amplitude: Array) -> TableExperiment:
    """The experiment with other rows, read as finely in proportion."""
    shape = (len(frequency), e.measured.shape[1])
    return replace(
        e,
        time=np.arange(len(frequency), dtype=float),
        frequency=frequency,
        amplitude=amplitude,
        measured=np.zeros(shape),
        relative=np.ones(shape),
        solutions={},
        slope=BroydenJacobian(),
        latest={},
    )


def draw(axes: Any, models: Mapping[str, Fit], colours: Mapping[str, str], k: int) -> None:
    """A table against models: amplitudes above, what each leaves over below; held-out rows are ringed.

    Args:
        axes: two axes.
        models: by name.
        colours: of the recording and of each model.
        k: which signal.
    """
    above, below = axes
    for label, fit in models.items():
        given = tables(fit.problem.experiments)
        frequency = np.concatenate([e.frequency for e in given])
        order = np.argsort(frequency)
        left = np.concatenate([(fit.problem.residual(fit.x, e) * e.sigma * e.relative)[:, k] for e in given])
        measured = np.concatenate([e.measured[:, k] for e in given])
        if label == next(iter(models)):
            held = np.concatenate([np.full(len(e.time), e.role == "hold_out") for e in given])
            above.semilogx(frequency, measured, ".", color=colours["recording"], label="recording")
            above.semilogx(
                frequency[held], measured[held], "o", mfc="none", color=colours["recording"], ms=8, label="held out"
            )
        style = "-" if label == "amended" else "--"
        above.semilogx(frequency[order], (measured - left)[order], style, color=colours[label], lw=1.2, label=label)
        below.semilogx(frequency[order], left[order], style, color=colours[label], marker=".", lw=0.9, label=label)
