"""The models of a study as they are reported: with the parameters of least squared error.

A search weighs models by likelihoods in which slow errors count little, since it must not take them for physics. Who is
given a model asks that it follow his recordings as closely as it can, those that were not fitted too. At the sensors'
noise both fits are one. Far above it, where no model is exact, an effect may serve the likelihood alone: it is told
only if held-out recordings are followed better with it at the least squared error too. Nor is a model fitted so closely
that its parameters, which would have to make up for every nuisance, could not be believed.
"""

from __future__ import annotations

from dataclasses import replace

from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.posterior import credible, is_simpler, misses, slight, strained, worse
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Study
from diagnosis.thresholds import EVIDENCE


def as_reported(fitter: CandidateFitter, found: Study) -> Study:
    """The study with the user's model, and every credible one, fitted to the least squared error.

    Args:
        fitter: of the study.
        found: the study, as the search has left it.
    """
    tried = {m.keys: m for m in (found.refit, *found.trials)}
    closest: dict[frozenset[str], ScoredModel] = {}

    def reported(model: ScoredModel, *richer: ScoredModel) -> ScoredModel:
        """The model at its least squared error; an amended one as it is, if only its parameters there are far off."""
        if model.keys not in closest:
            end = fitter.closest(model, richer)
            bends = model.effects and strained(end, found.tried) and not strained(model, found.tried)
            closest[model.keys] = model if bends else end
        return closest[model.keys]

    def believed(model: ScoredModel) -> ScoredModel:
        """The model, or the simpler one that follows held-out recordings better, or none for what is slight.

        One that leaves more than twice as much of them is not fitted for that: it would only cost time.
        """
        end = reported(model)
        if slight(reported(found.refit), end):
            return found.refit
        if not misses(end.unseen):
            return model
        left = float(end.unseen.energy.sum())
        simpler = [s for s in tried.values() if is_simpler(s, model)]
        able = [s for s in simpler if left > (1 - EVIDENCE.most) * float(s.unseen.energy.sum())]
        simpler = [s for s in able if worse(end, reported(s, end))]
        return believed(max(simpler, key=lambda s: s.log_evidence)) if simpler else model

    reported(found.refit)
    odds, notes = dict(found.odds), list(found.notes)
    for model in credible([m for m in tried.values() if m.keys in odds], odds):
        told = believed(model)
        if told is not model:
            odds[told.keys] = odds.get(told.keys, 0.0) + odds.pop(model.keys)
            less = "the recordings that were not fitted are followed less closely with it"
            little = "it explains little of what is no more than the noise without it"
            why = little if slight(reported(found.refit), reported(model)) else less
            notes.append(
                f"{model.label} is likelier than {told.label}, but at the least squared error {why}: it is not told"
            )
    chosen = reported(max((m for m in tried.values() if m.keys in odds), key=lambda m: odds[m.keys]))
    trials = [closest.get(m.keys, m) for m in found.trials]
    trials.sort(key=lambda m: -odds.get(m.keys, 0.0))
    return replace(
        found, refit=reported(found.refit), chosen=chosen, trials=tuple(trials), odds=odds, notes=tuple(notes)
    )
