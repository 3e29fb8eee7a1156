"""A held-out recording that is fitted after all, since no other shows what is missing."""

from __future__ import annotations

from dataclasses import replace

from diagnosis.recordings.types import Recorded
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.posterior import excess, loudest, misses
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import EVIDENCE, SEARCH


def exchanged(
    fitter: CandidateFitter, model: ScoredModel, price: float, *, searched: bool = False
) -> tuple[list[Recorded], str] | None:
    """The recordings with a held-out one moved to training, where only held-out data show a mismatch.

    An effect that no training recording excites cannot be fitted, such as an amplifier that saturates in the held-out
    recordings alone. The one that shows most is fitted, or, where no other shows it, every other part of it.

    Nuisances are in all recordings. Where the fitted ones show some, they must leave no more than a sensor's noise may
    be taken for, unless the search for what they show is over. A held-out recording then counts if much more than that
    is left of it, by the user's model, too: what only the model misses refutes it. Once the search is over, it counts
    if that is more than nuisances are: a share of what the model explains of it.

    Args:
        fitter: of the study.
        model: the best one.
        price: what a further effect costs.
        searched: whether no effect that is listed explains more of the fitted recordings.
    """
    x, problem = model.fit.x, model.fit.problem
    fitted = problem.leftover(x, problem.training)
    noisy = fitted.unexplained > price
    missing = misses(fitted)
    if noisy and missing and not searched:
        return None
    beyond = EVIDENCE.stated * (loudest(fitted) if missing else 1.0)
    refit, shown = fitter.refit.fit, dict[str, float]()
    given = {e.name: e for e in refit.problem.held_out}
    for e in problem.held_out:
        left, before = problem.leftover(x, [e]), refit.problem.leftover(refit.x, [given[e.name]])
        little = missing and excess(left) < EVIDENCE.share * float(before.energy.sum() - left.energy.sum())
        if not noisy or (min(loudest(before), loudest(left)) > beyond and not little):
            shown[e.name] = left.unexplained
    worst = max(shown, key=lambda name: shown[name], default="")
    if not worst or shown[worst] < price + SEARCH.effort:
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
