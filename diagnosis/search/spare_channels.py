"""Columns that were logged and not fitted, held against what each rival predicts for them.

A motor's current or a tachometer beside an encoder may tell two effects apart that fit as well as one another. Such a
column is no part of any fit: its gain and offset are taken as they suit each model, for a drive's own sensors are
seldom calibrated, and what is left over then is evidence like any other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.leftover import left_by
from diagnosis.estimation.parameters import Array
from diagnosis.recordings.types import Recording
from diagnosis.search.fitter import CandidateFitter, end_of
from diagnosis.search.partial_fit import place_of, standing
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import LEAST_ODDS, SpareEvidence, Study
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import FlexarmError


def settled_by_spare_channels(fitter: CandidateFitter, found: Study) -> Study:
    """The study with its probabilities as the spare columns change them; as it is where there are none, or no rival.

    Models that the columns were held against share out among them what they had together; others keep what they had.

    Args:
        fitter: of the study; all its recordings have the same spare signals.
        found: the study.

    Raises:
        FlexarmError: a spare signal that the model does not have.
    """
    over_time = [r for r in fitter.recordings if isinstance(r, Recording)]
    names = [c.name for r in over_time[:1] for c in r.spare]
    if not names:
        return found
    models = [m for m in (found.refit, *found.trials) if found.odds.get(m.keys, 0.0) >= LEAST_ODDS]
    if len(models) < 2:
        return found
    wide = fitter.again([_in_order(r, names).with_spare() for r in over_time])
    first = [v.name for v in wide.base.model.outputs].index(names[0])
    heard = []
    for model in models:
        try:
            heard.append(_heard(wide, model, first, names))
        except FlexarmError:
            continue  # what is put in there hides the signal, or cannot be simulated
    if len(heard) < 2:
        return found
    best = max(one.log_likelihood for one in heard)
    weights = {one.model: found.odds[one.model] * _odds(one.log_likelihood - best) for one in heard}
    together = sum(found.odds[keys] for keys in weights) / sum(weights.values())
    odds = {**found.odds, **{keys: weight * together for keys, weight in weights.items()}}
    trials = sorted(found.trials, key=lambda m: -odds.get(m.keys, 0.0))
    chosen = max((m for m in (found.refit, *trials) if m.keys in odds), key=lambda m: odds[m.keys])
    told = (*found.notes, _sentence(heard, {m.keys: m.label for m in models}, names))
    return replace(found, odds=odds, trials=tuple(trials), chosen=chosen, notes=told, spare=tuple(heard))


def _sentence(heard: Sequence[SpareEvidence], labels: Mapping[frozenset[str], str], names: Sequence[str]) -> str:
    """What the columns say, in a sentence."""
    best, second = sorted(heard, key=lambda one: -one.log_likelihood)[:2]
    by = best.log_likelihood - second.log_likelihood
    what = f"the spare signals {', '.join(names)}" if len(names) > 1 else f"the spare signal {names[0]}"
    if by < EVIDENCE.temperature * SEARCH.effort:  # odds below twenty to one
        return f"{what} was held against {len(heard)} rivals and does not tell them apart"
    odds = f"{_odds(by):.0f} to 1" if _odds(-by) > LEAST_ODDS else f"more than {1 / LEAST_ODDS:.0f} to 1"
    return f"{what} speaks for {labels[best.model]} rather than {labels[second.model]}, {odds}"


def _odds(by: float) -> float:
    """Odds of two models by a difference of evidence, tempered as it is between effects."""
    return math.exp(by / EVIDENCE.temperature)


def _in_order(recording: Recording, names: Sequence[str]) -> Recording:
    """The recording with its spare signals in an order."""
    return replace(recording, spare=tuple(sorted(recording.spare, key=lambda c: names.index(c.name))))


def _heard(wide: CandidateFitter, model: ScoredModel, first: int, names: Sequence[str]) -> SpareEvidence:
    """What the spare columns, from the ``first`` on, say of a model as it was fitted without them.

    Raises:
        FlexarmError: it cannot be built or simulated with them.
    """
    made = wide.build(model.effects, end_of(model).built, whole=True) if model.effects else wide.base
    ended = standing(model.fit)
    x = np.array([f.position(ended.get(place_of(f), f.start)) for f in made.free])
    made = replace(made, internal_step=model.fit.problem.internal_step)
    likely, correlations = _as_it_suits(made.experiments, made.residuals(x, made.experiments), first)
    return SpareEvidence(model.keys, likely, dict(zip(names, correlations, strict=True)))


def _as_it_suits(
    experiments: Sequence[Experiment], residuals: Sequence[Array], first: int
) -> tuple[float, list[float]]:
    """Log-likelihood of the columns from the ``first`` on, and the correlation of each with what is predicted.

    Args:
        experiments: as recorded.
        residuals: of a model, in standard deviations of the noise, shape (samples, signals) each.
        first: number of the first spare signal.
    """
    left = [np.zeros_like(r) for r in residuals]
    correlations = []
    for k in range(first, residuals[0].shape[1]):
        known = [np.isfinite(e.measured[:, k]) for e in experiments]
        measured = [e.measured[at, k] for e, at in zip(experiments, known, strict=True)]
        noise = [np.full(len(m), e.sigma[k]) for e, m in zip(experiments, measured, strict=True)]
        parts = zip(measured, residuals, known, noise, strict=True)
        shown, sigma = np.concatenate(measured), np.concatenate(noise)
        predicted = np.concatenate([m - r[at, k] * s for m, r, at, s in parts])
        spread = float(np.std(predicted) * np.std(shown))
        correlations.append(float(np.mean((predicted - predicted.mean()) * shown)) / spread if spread > 0 else 0.0)
        columns = np.column_stack([predicted, np.ones(len(predicted))])
        gain, offset = np.linalg.lstsq(columns / sigma[:, None], shown / sigma, rcond=None)[0]
        rest = np.split((shown - gain * predicted - offset) / sigma, np.cumsum([len(m) for m in measured])[:-1])
        for rows, at, values in zip(left, known, rest, strict=True):
            rows[at, k] = values
    return left_by(experiments, left).log_likelihood, correlations
