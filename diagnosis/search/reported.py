"""The models of a study as they are reported: with the parameters of least squared error.

A search weighs models by likelihoods in which slow errors count little, since it must not take them for physics. Who is
given a model asks that it follow his recordings as closely as it can, those that were not fitted too. At the sensors'
noise both fits are one.
"""

from __future__ import annotations

from dataclasses import replace

from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.posterior import credible
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Study


def as_reported(fitter: CandidateFitter, found: Study) -> Study:
    """The study with the user's model, and every credible one, fitted to the least squared error.

    Args:
        fitter: of the study.
        found: the study, as the search has left it.
    """
    known = [m for m in (found.refit, *found.trials) if m.keys in found.odds]
    told = {m.keys: fitter.closest(m) for m in {id(m): m for m in (found.refit, *credible(known, found.odds))}.values()}

    def as_told(model: ScoredModel) -> ScoredModel:
        return told.get(model.keys, model)

    trials = tuple(as_told(m) for m in found.trials)
    return replace(found, refit=as_told(found.refit), chosen=as_told(found.chosen), trials=trials)
