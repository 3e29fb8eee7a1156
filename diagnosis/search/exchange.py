"""A held-out recording that is fitted after all, since no other shows what is missing."""

from __future__ import annotations

from dataclasses import replace

from diagnosis.recordings.types import Recorded
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import SEARCH


def exchanged(fitter: CandidateFitter, model: ScoredModel, price: float) -> tuple[list[Recorded], str] | None:
    """The recordings with a held-out one moved to training, where only held-out data show a mismatch.

    An effect that no training recording excites cannot be fitted, such as an amplifier that saturates in the held-out
    recordings alone. The one that shows most is fitted, or, where no other shows it, every other part of it.

    Args:
        fitter: of the study.
        model: the best one.
        price: what a further effect costs.
    """
    base, x, problem = fitter.base, model.fit.x, model.fit.problem
    if len(base.held_out) < 2 or problem.leftover(x, problem.training).unexplained > price:
        return None
    shown = {e.name: problem.leftover(x, [e]).unexplained for e in problem.held_out}
    worst = max(shown, key=lambda name: shown[name])
    if shown[worst] < price + SEARCH.effort:
        return None
    told = f"'{worst}' shows a mismatch that the training recordings do not show: "
    if any(left > price for name, left in shown.items() if name != worst):
        moved = [replace(r, role="train") if r.name == worst else r for r in fitter.recordings]
        return moved, told + "it was fitted too, and the rest is held out"
    parts = next(r for r in fitter.recordings if r.name == worst).split(SEARCH.part)
    if parts is None:
        return None
    rows = [r for r in fitter.recordings if r.name != worst]
    return [*rows, *parts], told + f"of it, every other {SEARCH.part:g} s was fitted and the rest held out"
