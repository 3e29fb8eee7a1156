"""The rules of the choice: when an effect pays, which of those that do equally well is taken, and what rivals it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.recordings.types import Recorded
from diagnosis.search.equivalent_effects import KNOWN
from diagnosis.search.scored_model import ScoredModel, at_end, by_chance, gain_band, outside_tolerances
from diagnosis.thresholds import PREFERENCE

NESTED = {
    "coulomb_friction": ("stribeck_friction", "direction_dependent_friction"),
    "joint_flexibility": ("hardening_spring", "backlash", "hysteresis"),
    # A further body that is heavy, stiffly held or both is no further body.
    "viscous_friction": ("extra_mode",),
    "stray_spring": ("extra_mode",),
    "payload": ("extra_mode",),
    "lag": (),
}
"""Effect: those that contain it, so that equal merit speaks for it."""

NESTED_ANYWHERE = {"offset": ("stray_spring",)}
"""The same wherever they are: a soft spring at rest outside the range of its angle is nearly a constant torque."""


def noise_floor(trial: ScoredModel) -> float:
    """Noise floor of chi2: 1 for the stated noise, more where the residual shows more white noise than stated.

    Missing samples are ignored.
    """
    problem, levels = trial.fit.problem, list[float]()
    for e in problem.judged:
        found = e.noise_levels(problem.residual(trial.fit.x, e))
        if found is None:
            return 1.0
        levels += found
    return max(1.0, float(np.mean(levels))) if levels else 1.0


def unexplained(trial: ScoredModel, floor: float) -> bool:
    """Whether more than noise is left over, of the held-out data and of those that were fitted.

    Where the fitted data are at the floor, a small held-out excess is attributed to the parameters' uncertainty.
    """
    left = trial.hold_out - floor
    fitted = trial.fit.chi2 - floor > PREFERENCE.fitted * floor
    return (fitted or left > PREFERENCE.far * floor) and left > max(PREFERENCE.least * floor, by_chance(trial))


def missing(refit: ScoredModel) -> bool:
    """Whether so much is left over that something is missing, even if no effect accounts for it."""
    return refit.hold_out - noise_floor(refit) > max(PREFERENCE.unknown, by_chance(refit))


def worth_adding(better: ScoredModel, worse: ScoredModel) -> bool:
    """Whether the better model reduces the held-out excess by enough, beyond the bootstrap band."""
    floor = noise_floor(better)
    share = PREFERENCE.pays if len(better.effects) == 1 or not worse.effects else PREFERENCE.pays_again
    gain = worse.hold_out - better.hold_out
    return gain > share * (worse.hold_out - floor) and gain_band(better, worse)[0] > 0 and unexplained(worse, floor)


def reaches_floor(refit: ScoredModel, chosen: ScoredModel) -> bool:
    """Whether the amended model leaves little more than noise of what it was fitted to and of what it was not.

    Where the fitted data are at the floor, more may be left of the others: what the parameters are uncertain by.
    """
    floor = noise_floor(chosen)
    left, before = chosen.hold_out - floor, refit.hold_out - floor
    if chosen.fit.chi2 - floor > _little(refit.fit.chi2 - floor, floor):
        return False
    uncertain = min(PREFERENCE.uncertain * before, PREFERENCE.uncertain_at_most * floor)
    at_floor = chosen.fit.chi2 - floor < PREFERENCE.fitted * floor
    return left < max(_little(before, floor), uncertain if at_floor else 0.0)


def _little(before: float, floor: float) -> float:
    """How much above the floor a right law may leave of what was there before."""
    return max(PREFERENCE.reached * floor, min(PREFERENCE.left_over * before, PREFERENCE.left_at_most * floor))


def explained(refit: ScoredModel, chosen: ScoredModel) -> float:
    """Share of the held-out excess that a model explains; where there is no excess, the share of the prior cost."""
    floor = noise_floor(chosen)
    if not unexplained(refit, floor):
        return min(max(1 - chosen.prior_cost / max(refit.prior_cost, 1e-9), 0.0), 1.0)
    if _of_tables(refit):
        # Parameters bent far out of their tolerances follow a few rows: that explains nothing.
        return min(max((refit.merit - chosen.merit) / (refit.merit - floor), 0.0), 1.0)
    return min(max((refit.hold_out - chosen.hold_out) / (refit.hold_out - floor), 0.0), 1.0)


def _of_tables(trial: ScoredModel) -> bool:
    return trial.fit.problem.sparse


def accounts_for_mismatch(recordings: Sequence[Recorded], refit: ScoredModel, chosen: ScoredModel) -> bool:
    """Whether what was found accounts for the mismatch: to the floor where the noise was stated, else most of it.

    Where the noise of every signal is stated, a law that is right reaches it; one that only resembles the missing one
    leaves a share of the mismatch.
    """
    least = PREFERENCE.explains if unexplained(refit, noise_floor(chosen)) else 1 - PREFERENCE.relieves
    if not chosen.effects or explained(refit, chosen) < least:
        return False
    if implausible(refit, chosen):
        return False
    stated = all(r.noise_stated for r in recordings)
    return reaches_floor(refit, chosen) if stated else True


def implausible(refit: ScoredModel, chosen: ScoredModel) -> list[str]:
    """Sizes of effects at their limit, and parameters far outside their tolerances that the refit left within."""
    return [*at_end(chosen), *sorted(_bent(chosen) - _bent(refit))]


def _bent(trial: ScoredModel) -> set[str]:
    """Parameters of the user's that stand far outside their tolerances."""
    return {
        f.name for f, x in zip(trial.fit.problem.free, trial.fit.x, strict=True) if f.prior and abs(x) > PREFERENCE.bent
    }


def complexity_cost(trial: ScoredModel) -> float:
    """What a model costs before it explains anything: its parameters, and how far those of the user had to move."""
    return trial.prior_cost + trial.size * math.log(max(trial.samples, 2))


def equally_good(best: ScoredModel, trials: Sequence[ScoredModel], before: ScoredModel) -> list[ScoredModel]:
    """The trials that do as well as the best one on held-out data, as far as the data can tell.

    A model that misses the fitted recordings by far does not qualify: what is missing may hardly show in the others.

    Args:
        best: one of them, or the one that was chosen.
        trials: models.
        before: the model without what they add.
    """
    rows, left = [], min(max(best.hold_out - noise_floor(best), 0.0), PREFERENCE.least)
    for t in trials:
        apart = (t.merit - best.merit) * best.samples / max(best.hold_out, 1.0)
        if (
            t.merit - best.merit < max(PREFERENCE.near * best.merit, left)
            or gain_band(best, t)[0] <= 0
            or apart < PREFERENCE.decisive
        ):
            rows.append(t)
    if _of_tables(best):
        return rows
    least = min([best.fit.chi2, *(t.fit.chi2 for t in rows)])
    slack = max(PREFERENCE.least * max(least, 1.0), PREFERENCE.left_over * (before.fit.chi2 - least))
    return [t for t in rows if t.fit.chi2 - least < slack]


def choose(parent: ScoredModel, trials: Sequence[ScoredModel]) -> ScoredModel:
    """The model to prefer to its parent, or the parent; of those that do equally well, the least complex one.

    Args:
        parent: the model without what the trials add.
        trials: with one effect more, best first.
    """
    if not trials:
        return parent
    if not parent.effects and not unexplained(parent, noise_floor(trials[0])):
        return _freed(parent, trials) if outside_tolerances(parent) else parent
    able = [t for t in trials if not at_end(t)]
    if able and reaches_floor(parent, able[0]):
        trials = able  # an effect at its limit fits well only because it imitates another
    best = min(equally_good(trials[0], trials, parent), key=lambda t: (complexity_cost(t), t.merit))
    return best if worth_adding(best, parent) else parent


def with_parameter_freed(chosen: ScoredModel, pairs: Sequence[ScoredModel]) -> ScoredModel:
    """The pair with one freed parameter that brings all others back within their tolerances.

    Args:
        chosen: the best model found.
        pairs: of a freed parameter and an effect.
    """
    if not outside_tolerances(chosen) or len(chosen.effects) > 1:
        return chosen
    mine = {c.key for c in chosen.effects}
    able = [t for t in pairs if mine <= {c.key for c in t.effects} and t.hold_out < PREFERENCE.alike * chosen.hold_out]
    best = min(able, key=lambda t: t.fit.cost, default=chosen)
    return best if chosen.fit.cost - best.fit.cost > PREFERENCE.decisive * max(best.fit.chi2, 1.0) else chosen


def _freed(refit: ScoredModel, trials: Sequence[ScoredModel]) -> ScoredModel:
    """The single change that lets all other parameters stay within their tolerances, if one does."""
    able = _relieving(refit, refit, trials)
    best = min(able, key=lambda t: (t.fit.cost, t.effects[0].effect != "wrong_parameter"), default=refit)
    return best if refit.fit.cost - best.fit.cost > PREFERENCE.believed**2 else refit


def _relieving(refit: ScoredModel, chosen: ScoredModel, trials: Sequence[ScoredModel]) -> list[ScoredModel]:
    """Single changes that take most of the strain away; what only follows the noise closer does not."""
    able = [t for t in trials if t.size == 1 and t.hold_out < PREFERENCE.alike * chosen.hold_out]
    return [t for t in able if t.prior_cost < PREFERENCE.relieves * refit.prior_cost]


def rivals(chosen: ScoredModel, refit: ScoredModel, trials: Sequence[ScoredModel]) -> tuple[ScoredModel, ...]:
    """Other models with as many effects that the held-out data cannot tell from the chosen one.

    A model that contains the chosen one does not qualify, nor one that costs much more before it explains as much.
    """
    others = [t for t in trials if len(t.effects) == len(chosen.effects) and not _same(t, chosen)]
    pair = set(KNOWN.get(chosen.effects[0].effect, ())) if len(chosen.effects) == 1 else set()
    others += [t for t in trials if len(t.effects) > 1 and {c.effect for c in t.effects} == pair]
    if not unexplained(refit, noise_floor(chosen)):
        able = _relieving(refit, chosen, others)
        return tuple(t for t in able if t.fit.cost - chosen.fit.cost < PREFERENCE.decisive)
    alike = [t for t in equally_good(chosen, others, refit) if not at_end(t)]
    if _of_tables(chosen) and not outside_tolerances(chosen):
        # A model that needs further parameters outside their tolerances does not qualify.
        alike = [t for t in alike if not outside_tolerances(t)]
    rows = [
        t
        for t in alike
        if not _contains(t, chosen)
        and complexity_cost(t) - complexity_cost(chosen) < PREFERENCE.costly * PREFERENCE.decisive
    ]
    # The simpler law was taken for its simplicity; a richer one is a rival if it does better beyond chance.
    richer = [t for t in others if _contains(t, chosen) and t.merit < (1 + PREFERENCE.least) * chosen.merit]
    rows += [t for t in richer if better(t, chosen)]
    found: dict[frozenset[str], ScoredModel] = {}
    for t in sorted(rows, key=lambda t: t.merit):
        found.setdefault(frozenset(c.key for c in t.effects), t)
    rows = list(found.values())
    return tuple(t for t in rows if not any(_contains(t, s) and not better(t, s) for s in rows if s is not t))


def better(one: ScoredModel, other: ScoredModel) -> bool:
    """Whether a law does clearly better than another, on held-out data beyond chance or on the fitted ones."""
    held = other.hold_out - one.hold_out > PREFERENCE.richer * other.hold_out and gain_band(one, other)[0] > 0
    return held or other.fit.chi2 - one.fit.chi2 > PREFERENCE.richer * other.fit.chi2


def _same(one: ScoredModel, other: ScoredModel) -> bool:
    return {c.key for c in one.effects} == {c.key for c in other.effects}


def _contains(larger: ScoredModel, smaller: ScoredModel) -> bool:
    """Whether each effect of one model is in the other, or in a richer effect of it."""
    return all(any(_is_in(a, b) for b in larger.effects) for a in smaller.effects)


def _is_in(a: Candidate, b: Candidate) -> bool:
    if b.place == a.place and (b.effect == a.effect or b.effect in NESTED.get(a.effect, ())):
        return True
    return b.effect in NESTED_ANYWHERE.get(a.effect, ())
