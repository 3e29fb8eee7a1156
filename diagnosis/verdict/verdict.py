"""The verdict: what was found, how sure it is, what it cannot be told from, and what to measure next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.effects.spring import is_linear_spring
from diagnosis.estimation.least_squares import Fit, Interval, with_covariance
from diagnosis.search.equivalent_effects import NESTED
from diagnosis.search.force_recovery import Curve, RecoveredForce, place_of, recover
from diagnosis.search.posterior import credible, explained, floor, may_imitate, misses, price, probability, strained
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import LEAST_ODDS, Study
from diagnosis.thresholds import EVIDENCE, INTERVALS, SEARCH
from diagnosis.verdict.experiment_design import Proposal, propose
from diagnosis.verdict.recording_checks import Remark, screen
from diagnosis.verdict.wording import finding_sentence, nothing_sentence, traits, warnings_of

_GAINS = ("sensor_scale", "uneven_gain")
"""Effects that make up for a wrong unit, sign or size of a column whatever it holds."""

WEAKEST = ("unknown", "tie", "wrong_parameter", "named")
"""Statuses of findings, the weakest first."""


@dataclass(frozen=True)
class Diagnosis:
    """The result of `flexarm.diagnose`.

    Attributes:
        study: everything that was tried.
        verdict: ``named``, ``none``, ``tie``, ``unknown`` or ``wrong_parameter``.
        findings: one dictionary per finding; see ``diagnosis.json``.
        rivals: trials that the data cannot exclude, best first.
        proposal: the experiment that would separate them, if there are any.
        warnings: what makes the verdict less sure.
        fit: the chosen model's fit with its intervals.
        recovered: the force that is missing where something was found, without a name.
    """

    study: Study
    verdict: str
    findings: tuple[dict[str, Any], ...]
    rivals: tuple[ScoredModel, ...]
    proposal: Proposal | None
    warnings: tuple[str, ...]
    fit: Fit
    recovered: RecoveredForce | None = None

    @property
    def evidence(self) -> tuple[Curve, ...]:
        """The recovered force against what it may depend on, the curve that explains most first."""
        return self.recovered.curves if self.recovered else ()

    def numbers(self) -> dict[str, Any]:
        """The verdict as it stands in ``diagnosis.json``."""
        study = self.study
        best = study.chosen
        return {
            "verdict": self.verdict,
            "findings": list(self.findings),
            "place_odds": study.place_odds,
            "rivals": [
                {
                    "effects": [c.key for c in t.effects],
                    "log_evidence": math.log(study.odds[t.keys] / study.odds[best.keys]),
                    "hold_out_chi2": t.hold_out,
                    "parameters": t.added(),
                }
                for t in self.rivals
            ],
            "fit": fit_table(study),
            "next_experiment": self.proposal.numbers() if self.proposal else None,
            "warnings": list(self.warnings),
            "ended_early": study.ended_early,
            "remaining": dict(zip(("when", "frequency"), traits(study.chosen), strict=True)),
            "not_tried": [{"effect": effect, "reason": why} for effect, why in study.failures],
            "recovered_force": self.recovered.numbers() if self.recovered else None,
            "spare_channels": [
                {
                    "effects": sorted(one.model),
                    "log_likelihood": one.log_likelihood - max(s.log_likelihood for s in study.spare),
                    "correlations": dict(one.correlations),
                }
                for one in study.spare
            ],
            "trials": [
                {
                    "effects": [c.key for c in t.effects],
                    "train_chi2": t.fit.chi2,
                    "hold_out_chi2": t.hold_out,
                    "converged": t.fit.converged,
                    "probability": study.odds.get(t.keys, 0.0),
                }
                for t in study.trials
            ],
        }


def fit_table(study: Study) -> dict[str, Any]:
    """Per role and model: nrmse (per cent) and chi2 of each signal."""
    refit = study.refit.fit
    models = {
        "nominal": replace(refit, x=np.zeros(len(refit.problem.free))),
        "refit": refit,
        "amended": study.chosen.fit,
    }
    table: dict[str, Any] = {"train": {}, "hold_out": {}}
    for name, made in models.items():
        for role, experiments in (("train", made.problem.training), ("hold_out", made.problem.held_out)):
            found = made.problem.by_signal(made.x, experiments)
            table[role][name] = {signal: asdict(row) for signal, row in found.items()}
    return table


ENDED_EARLY = (
    "the time that was allowed was over before the search was: what is told may have rivals that were not tried, and "
    "what remains may be an effect that was not; without the limit the search goes on to its end"
)


def judge(study: Study) -> Diagnosis:
    """Turn a study into a verdict."""
    chosen, refit = study.chosen, study.refit
    made = with_covariance(chosen.fit, chosen.hold_out - floor(chosen))
    found = _remarks(study)
    early = (ENDED_EARLY,) if study.ended_early else ()
    warnings = (*early, *study.notes, *(remark.text for remark in found), *warnings_of(study))
    if not chosen.effects:
        status = "unknown" if _missing(study) else "none"
        near = study.trials[0].effects[0] if status == "unknown" and study.trials else None
        force = recover(study, *place_of(near, study)) if near else None
        return Diagnosis(study, status, (_nothing(study, status, near),), (), None, warnings, made, force)
    models = [m for m in (refit, *study.trials) if m.keys in study.odds]
    others = tuple(m for m in credible(models, study.odds) if m is not chosen)
    share = explained(refit, chosen)
    improbable = may_imitate(refit, chosen) or strained(chosen, study.tried) or bool(chosen.at_an_end)
    intervals = {i.name: i for i in made.intervals()}
    findings = []
    for k, effect in enumerate(chosen.effects):
        agree = [t for t in others if _says_the_same(t, effect)]
        odds = probability(effect.key, study.odds) + sum(study.odds[t.keys] for t in agree)
        against = [t for t in others if effect.key not in t.keys and not _says_the_same(t, effect)]
        untold = untold_sizes(study, effect, made.intervals(), against)
        if effect.effect == "unknown" or improbable or untold or any(r.grave for r in found):
            status = "unknown"
        elif odds < EVIDENCE.probability and against:
            status = "tie"
        else:
            status = "wrong_parameter" if effect.effect == "wrong_parameter" else "named"
        findings.append(_finding(study, k, status, share, odds, intervals, against, untold))
    weakest = min((f["status"] for f in findings), key=WEAKEST.index)
    proposal = propose([chosen, *others], refit.fit.problem.model) if others else None
    force = recover(study, *place_of(chosen.effects[0], study))
    return Diagnosis(study, weakest, tuple(findings), others, proposal, warnings, made, force)


def _says_the_same(model: ScoredModel, effect: Candidate) -> bool:
    """Whether a model without effects has the parameter far from its value that another says is wrong."""
    if model.effects or effect.freed is None:
        return False
    return effect.freed.name in model.far_off


def untold_sizes(
    study: Study, effect: Candidate, intervals: Sequence[Interval], rivals: Sequence[ScoredModel]
) -> list[str]:
    """Sizes without any bound of a law that contains a simpler one which was not fitted in its place.

    What does as well whatever makes it richer is that simpler law, or another one that contains it. Where the simpler
    law was fitted, the evidence has told which of them it is. A rival that has it instead, as on the other shaft of a
    gear, is told beside the richer one. Where the law took the place of a spring of the user's, that spring is the
    simpler law.
    """
    own = study.scenario.system.blocks.get(effect.place)
    if own is not None and is_linear_spring(own):
        return []
    simpler = {name for name, richer in NESTED.items() if effect.effect in richer}
    fitted = {c.effect for m in study.trials for c in m.effects if c.place == effect.place}
    told = {c.effect for m in rivals for c in m.effects}
    if not simpler or simpler & (fitted | told):
        return []
    rows = {i.name: i.numbers() for i in intervals}
    sizes = {k.name: rows.get(f"{effect.name}.{k.name}") for k in effect.parameters}
    return [name for name, row in sizes.items() if row and row["low"] is None and row["high"] is None]


def _missing(study: Study) -> bool:
    """Whether more than a further effect costs is unexplained, and of a recording more than the noise itself."""
    refit = study.refit
    worthwhile = refit.left.unexplained > price(study.tried) + SEARCH.effort
    return worthwhile and misses(refit.left)


def _remarks(study: Study) -> list[Remark]:
    """What is odd about the recordings beside the amended model; what that does not show, it refutes.

    A wrong unit or sign is no more refuted by a model that has found a gain for it, or has bent its parameters. What
    says no more than what was found of a sensor is no objection to it.
    """
    chosen = study.chosen
    again = screen(chosen.fit.problem, chosen.fit.x)
    if chosen.effects and not chosen.far_off and not any(c.effect in _GAINS or c.freed for c in chosen.effects):
        return again
    stays = [_unless_found(remark, chosen) for remark in screen(study.refit.fit.problem) if not remark.refutable]
    return list(dict.fromkeys([*stays, *(remark for remark in again if remark.refutable)]))


def _unless_found(remark: Remark, chosen: ScoredModel) -> Remark:
    """A remark, but not a grave one if it says no more than what a model has found.

    That is a sensor's wrong scale, or a sensor that shows sizes without signs.
    """
    fitted = chosen.fit.parameters()
    scales = [(c.place, fitted[f"{c.name}.gain"]) for c in chosen.effects if c.effect == "sensor_scale"]
    rectified = [c.place for c in chosen.effects if c.effect == "rectified_sensor"]
    met = remark.turned in rectified or any(remark.is_met_by(*one) for one in scales)
    return replace(remark, grave=False) if met else remark


def _finding(
    study: Study,
    k: int,
    status: str,
    share: float,
    odds: float,
    intervals: dict[str, Any],
    others: Sequence[ScoredModel],
    untold: Sequence[str],
) -> dict[str, Any]:
    chosen = study.chosen
    effect = chosen.effects[k]
    parameters = {}
    names = [f"{effect.name}.{parameter.name}" for parameter in effect.parameters]
    names += [effect.freed.name] if effect.freed else []
    for name in names:
        found = intervals.get(name)
        if found is not None:
            row = found.numbers()
            if effect.freed:
                row["factor"] = found.value / found.start if found.start else math.inf
            parameters[name.rpartition(".")[2]] = row
    for parameter in effect.parameters:
        if parameter.fixed:
            parameters[parameter.name] = _chosen_size(study, parameter, study.chosen.sizes[k][parameter.name])
    when, frequency = traits(study.refit)
    name = effect.effect if status != "unknown" else "unknown"
    return {
        "status": status,
        "effect": name,
        "place": effect.place,
        "block": effect.block,
        "indistinguishable_from": [t.label for t in others],
        "conditional_on": _conditional(study.chosen.fit, effect.name),
        "when": when,
        "frequency": frequency,
        "sentence": finding_sentence(effect, status, share, study, others, untold),
        "probability": min(odds, 1 - LEAST_ODDS),
        "explained": share,
        "remaining": 1 - share,
        "parameters": parameters,
    }


def _chosen_size(study: Study, parameter: EffectParameter, value: float) -> dict[str, Any]:
    """A size that is not fitted but chosen, as a parameter; one in time is known as well as the input's timing is."""
    half = 1.96 * INTERVALS.input_timing * study.scales.sample if parameter.unit == "s" else 0.0
    return {"value": value, "low": max(value - half, 0.0), "high": value + half, "unit": parameter.unit}


def _conditional(made: Fit, name: str) -> list[str]:
    """Parameters that the data do not settle, on which the finding's own sizes depend."""
    named = " ".join(made.weak)
    return [f.name for f in made.problem.free if f.prior and f.name in named and not f.name.startswith(name)]


def _nothing(study: Study, status: str, near: Candidate | None) -> dict[str, Any]:
    """The finding that there is nothing to find, or nothing with a name: then it is told where an effect did best."""
    when, frequency = traits(study.refit)
    return {
        "status": status,
        "effect": status,
        "place": near.place if near else "",
        "block": near.block if near else "",
        "indistinguishable_from": [],
        "conditional_on": [],
        "when": when if status == "unknown" else "",
        "frequency": frequency if status == "unknown" else "",
        "sentence": nothing_sentence(study, status, near),
        "probability": min(sum(share for keys, share in study.odds.items() if not keys), 1 - LEAST_ODDS),
        "explained": 0.0,
        "remaining": 1.0 if status == "unknown" else 0.0,
        "parameters": {},
    }
