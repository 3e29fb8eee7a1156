"""From evidence to probabilities: which models are believed, what each finding's odds are, and what ties.

A model is as probable as its evidence and its price say: each effect was chosen from as many as were tried, and costs
the logarithm of that number. A model that owes to one of its effects, or to the richer one of two laws, less than
`EVIDENCE.share` of what can be explained at all is not believed: nuisances that nobody asks for are that large. Nor is
one that an effect makes worse on recordings that were not fitted. What brings down to the sensors' noise what another
model leaves above it is believed, however little that is beside a strong effect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.search.equivalent_effects import NESTED, NESTED_ANYWHERE, one_law
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import EVIDENCE


def value(model: ScoredModel, tried: int) -> float:
    """Evidence of a model less the price of its effects.

    Args:
        model: which.
        tried: number of effects at places that it was chosen from.
    """
    return model.log_evidence - prices(model.effects) * price(tried)


def price(tried: int) -> float:
    """What an effect costs that was chosen from as many as were tried."""
    return math.log(max(tried, 2))


def prices(effects: Sequence[Candidate]) -> int:
    """How many effects a model counts as having: two that are known to be one law count as one."""
    return len(effects) - one_law(effects)


def energy(model: ScoredModel) -> float:
    """What a model leaves over of all recordings, and what its parameters cost, in variances of the noise."""
    return float(model.left.energy.sum()) + model.strain


def believed(models: Sequence[ScoredModel], refit: ScoredModel) -> list[ScoredModel]:
    """The models that owe enough to each of their effects, and to each law that is richer than another.

    Args:
        models: all that were fitted, the refit among them.
        refit: the model without effects.
    """
    explained = energy(refit) - min(energy(m) for m in models)
    return [m for m in models if not any(_owes_little(m, simpler, explained) for simpler in models if simpler is not m)]


def _owes_little(model: ScoredModel, simpler: ScoredModel, explained: float) -> bool:
    if not _simpler(simpler, model):
        return False
    relief = 0.5 * max(simpler.strain - model.strain, 0.0)
    unlikelier = model.unseen.log_likelihood < simpler.unseen.log_likelihood - relief
    worse = unlikelier and float(model.unseen.energy.sum()) >= float(simpler.unseen.energy.sum())
    little = energy(simpler) - energy(model) < EVIDENCE.share * explained
    # Nuisances are several: one effect does not bring them down to the noise.
    return worse or (little and not (misses(simpler) and not misses(model)))


def complete(model: ScoredModel, refit: ScoredModel) -> bool:
    """Whether a model with effects leaves so little that no further effect could be believed.

    What a fit that did not converge leaves is not missing physics, unless it is much.
    """
    left = float(np.sum(model.left.energy - model.left.noise * model.left.count))
    least = EVIDENCE.share if model.fit.converged else EVIDENCE.rough
    return bool(model.effects) and left < least * (energy(refit) - energy(model))


def misses(model: ScoredModel) -> bool:
    """Whether more is left over of a signal of a held-out recording than a sensor's noise may be taken for."""
    left = model.unseen
    for signal in {k for k, _ in left.names}:
        own = [i for i, (k, _) in enumerate(left.names) if k == signal]
        energy, count = left.energies[:, own].sum(axis=1), left.counts[:, own].sum(axis=1)
        if (energy > EVIDENCE.stated * left.noise[own[0]] * count).any():
            return True
    return False


def _simpler(one: ScoredModel, other: ScoredModel) -> bool:
    """Whether one model is another without an effect, or with a simpler law in the place of a richer one."""
    mine, theirs = set(one.keys), set(other.keys)
    if mine < theirs:
        return len(theirs) - len(mine) == 1
    lost = [c for c in one.effects if c.key not in theirs]
    more = [c for c in other.effects if c.key not in mine]
    return len(lost) == len(more) == 1 and one.size < other.size and is_in(lost[0], more[0])


def is_in(a: Candidate, b: Candidate) -> bool:
    """Whether an effect is a special case of another one."""
    if b.place == a.place and (b.effect == a.effect or b.effect in NESTED.get(a.effect, ())):
        return True
    return b.effect in NESTED_ANYWHERE.get(a.effect, ())


def probabilities(models: Sequence[ScoredModel], tried: int) -> dict[frozenset[str], float]:
    """How probable each model is, by its effects.

    What evidence claims is tempered: no model of noise is exact.
    """
    values = np.array([value(m, tried) for m in models]) / EVIDENCE.temperature
    weights = np.exp(np.maximum(values - values.max(), -700.0))
    shares = weights / weights.sum()
    return {m.keys: float(share) for m, share in zip(models, shares, strict=True)}


def probability(key: str, odds: Mapping[frozenset[str], float]) -> float:
    """How probable it is that an effect is there, at its place."""
    return sum(share for keys, share in odds.items() if key in keys)


def credible(models: Sequence[ScoredModel], odds: Mapping[frozenset[str], float]) -> list[ScoredModel]:
    """The most probable models that hold `EVIDENCE.probability` together, best first."""
    found, total = [], 0.0
    for model in sorted(models, key=lambda m: -odds[m.keys]):
        found.append(model)
        total += odds[model.keys]
        if total >= EVIDENCE.probability:
            break
    return found


def place_odds(models: Iterable[ScoredModel], odds: Mapping[frozenset[str], float]) -> dict[str, float]:
    """How probable it is that something acts at each place, the most probable first."""
    found: dict[str, float] = {}
    for model in models:
        if model.keys not in odds:
            continue
        for place in {c.place for c in model.effects if not c.freed}:
            found[place] = found.get(place, 0.0) + odds[model.keys]
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def floor(model: ScoredModel) -> float:
    """Mean squared residual that the sensors' noise alone leaves."""
    return float(np.sum(model.left.noise * model.left.count) / np.sum(model.left.count))


def relieved(refit: ScoredModel, model: ScoredModel) -> float:
    """Share of what the refitted model leaves unexplained that a model explains, or of the strain if that is bent."""
    shares = [1 - model.room / refit.room] if refit.room > 0 else [0.0]
    if refit.bent:
        shares.append(1 - model.strain / refit.strain)
    return max(*shares, 0.0)


def explained(refit: ScoredModel, model: ScoredModel) -> float:
    """Share of the held-out excess that a model explains, or of `relieved` if that is more."""
    excess = refit.hold_out - floor(model)
    of_excess = (refit.hold_out - model.hold_out) / excess if excess > 0 else 0.0
    return min(max(of_excess, relieved(refit, model), 0.0), 1.0)
