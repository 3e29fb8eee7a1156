"""From evidence to probabilities: which models are believed, what each finding's odds are, and what ties.

A model is as probable as its evidence and its price say: each effect was chosen from many, and each wrong parameter
from all of the user's. Nuisances that nobody asks for may still have much evidence, since they show in many bands of
frequency, and account for little: a model that owes to one of its effects, or to the richer one of two laws, less than
`EVIDENCE.share` of what can be explained at all is told as the simpler model, and speaks for that. So models compete
with the nuisances that fit beside each of them. Nuisances are several, and bend no parameters: what takes away nearly
all that another model leaves above the sensors' noise is none, however little that is beside a strong effect, nor is
what lets bent parameters return to their values. What an effect makes worse on recordings that were not fitted is not
believed at all, nor is one where the user's model leaves no more than noise, unless it takes away most of that. A
richer law is no nuisance by itself: it stands for one only where others do as well, in its place or beside the simpler
law; where they do nearly as well, both are told, as likely as their evidence says. One from which the fitted recordings
gain nothing is told as the simpler one, whatever the others gain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.leftover import Leftover
from diagnosis.search.equivalent_effects import NESTED, NESTED_ANYWHERE, one_law
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import EVIDENCE, SEARCH


def value(model: ScoredModel, tried: int) -> float:
    """Evidence of a model less the price of its effects.

    Args:
        model: which.
        tried: number of effects at places that it was chosen from.
    """
    freed = sum(1 for c in model.effects if c.freed)
    parameters = model.own + freed if freed else 0
    return model.log_evidence - (prices(model.effects) - freed) * price(tried) - freed * price(parameters)


def price(number: int) -> float:
    """What an effect costs that was chosen from so many, or a wrong parameter that was.

    That an effect is missing is taken for as likely as that a parameter is wrong, and each of a kind for as likely as
    another.
    """
    return math.log(2 * max(number, 1))


def prices(effects: Sequence[Candidate]) -> int:
    """How many effects a model counts as having: two that are known to be one law count as one."""
    return len(effects) - one_law(effects)


def energy(model: ScoredModel) -> float:
    """What a model leaves over of all recordings, and what its parameters cost, in variances of the noise."""
    return float(model.left.energy.sum()) + model.strain


def explicable(refit: ScoredModel, models: Iterable[ScoredModel]) -> float:
    """What any of some models explains of all that the user's own leaves, in variances of the noise."""
    return energy(refit) - min(energy(m) for m in models)


def told_as(models: Sequence[ScoredModel], refit: ScoredModel) -> list[tuple[ScoredModel, ScoredModel]]:
    """Each model that is believed in, and the simplest one that it is told as: itself, or one without nuisances.

    Args:
        models: all that were fitted, the refit among them.
        refit: the model without effects. For it no other speaks.
    """
    explained = explicable(refit, models)
    models = [m for m in models if not slight(refit, m)]
    simpler = {m.keys: [s for s in models if is_simpler(s, m)] for m in models}
    refuted = {m.keys for m in models if any(worse(m, s) for s in simpler[m.keys])}

    def simplest(model: ScoredModel, whole: ScoredModel) -> ScoredModel:
        enough = [
            s
            for s in simpler[model.keys]
            if worse(model, s)
            or unlearned(model, s)
            or lucky(model, s)
            or (
                owes_little(model, s, explained)
                and _one_of_several(whole, s)
                and (len(s.keys) < len(model.keys) or _is_met_otherwise(whole, model, s, models))
            )
        ]
        return simplest(max(enough, key=lambda s: s.log_evidence), whole) if enough else model

    pairs = [(simplest(m, m), m) for m in models if m.keys not in refuted]
    return [(as_, m) for as_, m in pairs if as_.effects or as_ is m]


def slight(refit: ScoredModel, model: ScoredModel) -> bool:
    """Whether effects explain less than most where the user's model leaves no more than the noise.

    Slow drifts of the machine and the sensors are as large.
    """
    return bool(model.effects) and not misses(refit.left) and relieved(refit, model) < EVIDENCE.most


def worse(model: ScoredModel, simpler: ScoredModel) -> bool:
    """Whether held-out recordings are foretold less well than by a simpler model, whose parameters are no better.

    As far as the fitted ones have taught them: what these leave uncertain, held-out ones may tell.
    """
    relief = 0.5 * max(simpler.strain - model.strain, 0.0)
    unlikelier = model.foretold < simpler.foretold - relief
    return unlikelier and float(model.unseen.energy.sum()) >= float(simpler.unseen.energy.sum())


def unlearned(model: ScoredModel, simpler: ScoredModel) -> bool:
    """Whether a richer law follows the recordings that were fitted no closer than the simpler one does.

    Then they taught it nothing, and what held-out recordings gain is owed to parameters that happen to differ: where
    stick ends, or an axis comes to rest, turns over with the last digits of each of them.
    """
    return len(model.keys) == len(simpler.keys) and simpler.fit.cost <= model.fit.cost


def lucky(model: ScoredModel, simpler: ScoredModel) -> bool:
    """Whether a model is likelier than a simpler one by no more than a hair's breadth of parameters gives and takes.

    The simpler one has effects: without any, a model is as likely as it is. Where both are steady there is no luck, and
    what is less likely than a simpler model stays its rival. Luck bends no parameters: a simpler model that needs them
    bent is not what is told.
    """
    luck = max(model.left.luck, simpler.left.luck)
    near = luck > 0 and model.log_evidence - simpler.log_evidence < luck
    return bool(simpler.effects) and near and not _alone_follows(model, simpler) and not _unbends(model, simpler)


def _unbends(model: ScoredModel, simpler: ScoredModel) -> bool:
    """Whether a simpler model needs bent parameters, and most of that strain goes with what the other one has more."""
    return simpler.bent and model.strain < EVIDENCE.most * simpler.strain


def _alone_follows(model: ScoredModel, other: ScoredModel) -> bool:
    """Whether only the first of two models follows the beginnings of the recordings, or all of each: that is no luck.

    By a hair's breadth of its parameters no model comes to the noise in every recording.
    """
    return (model.in_step and not other.in_step) or (misses(other.left) and not misses(model.left))


def owes_little(model: ScoredModel, simpler: ScoredModel, explained: float) -> bool:
    """Whether what a model has more than a simpler one may be a nuisance: nuisances are small, and they are several."""
    if _unbends(model, simpler):
        return False  # nuisances do not bend parameters
    little = energy(simpler) - energy(model) < EVIDENCE.share * explained
    return little and _one_of_several(model, simpler)


def _is_met_otherwise(
    whole: ScoredModel, richer: ScoredModel, simpler: ScoredModel, models: Sequence[ScoredModel]
) -> bool:
    """Whether what a richer law explains beyond a simpler one may be a nuisance, since others meet it as well.

    A further effect may be a nuisance itself. A law stands for one that is no part of it, as friction that differs
    between the directions does for an offset: then the simpler law does as well as the whole model, alone, with other
    effects beside it, or enriched otherwise. Where it does nearly as well, both are told: their odds say how nearly.
    """
    others = (m for m in models if m.keys != richer.keys and not is_simpler(richer, m))
    as_well = (m for m in others if m.log_evidence >= whole.log_evidence)
    return any(m.keys == simpler.keys or is_simpler(simpler, m) for m in as_well)


def _one_of_several(model: ScoredModel, simpler: ScoredModel) -> bool:
    """Whether a model leaves more than what it has more than a simpler one took away, unless that leaves but noise.

    It is asked of the whole model at each step to a simpler one: a richer law and the law itself may each leave much of
    what the other takes away.
    """
    return not misses(simpler.left) or excess(model.left) > EVIDENCE.several * excess(simpler.left)


def excess(left: Leftover) -> float:
    """What is left over of recordings beyond the sensors' noise."""
    return float(np.sum(left.energy - left.noise * left.count))


def complete(model: ScoredModel, refit: ScoredModel) -> bool:
    """Whether a model with effects leaves so little that a further effect could only be a nuisance.

    What a fit that did not converge leaves is not missing physics, unless it is much.
    """
    least = EVIDENCE.share if model.fit.converged else EVIDENCE.rough
    return bool(model.effects) and excess(model.left) < least * (energy(refit) - energy(model))


def misses(left: Leftover) -> bool:
    """Whether more is left over of a signal of any recording than a sensor's noise may be taken for."""
    return loudest(left) > EVIDENCE.stated


def loudest(left: Leftover) -> float:
    """The largest mean square that is left over of a signal of a recording, in units of its sensor's noise."""
    found = 0.0
    for signal in {k for k, _ in left.names}:
        own = [i for i, (k, _) in enumerate(left.names) if k == signal]
        energy, noise = left.energies[:, own].sum(axis=1), (left.noise * left.counts)[:, own].sum(axis=1)
        found = max([found, *(energy[noise > 0] / noise[noise > 0])])
    return found


def strained(model: ScoredModel, tried: int) -> bool:
    """Whether the user's own parameters are so far from their values that an effect which nobody lists is likelier.

    It would leave as little with each of them a tolerance off, and costs no more than one that is listed.
    """
    return 0.5 * (model.strain - model.own) > price(tried) + SEARCH.effort


def is_simpler(one: ScoredModel, other: ScoredModel) -> bool:
    """Whether one model is another without some effects, or with a simpler law in the place of a richer one."""
    mine, theirs = set(one.keys), set(other.keys)
    if mine < theirs:
        return bool(mine) or len(theirs) == 1
    lost = [c for c in one.effects if c.key not in theirs]
    more = [c for c in other.effects if c.key not in mine]
    return len(lost) == len(more) == 1 and one.size < other.size and is_in(lost[0], more[0])


def is_in(a: Candidate, b: Candidate) -> bool:
    """Whether an effect is a special case of another one."""
    if b.place == a.place and (b.effect == a.effect or b.effect in NESTED.get(a.effect, ())):
        return True
    return b.effect in NESTED_ANYWHERE.get(a.effect, ())


def probabilities(models: Sequence[tuple[ScoredModel, ScoredModel]], tried: int) -> dict[frozenset[str], float]:
    """How probable each model is that is told, by its effects.

    That some effect is there is as probable as the evidence says. Which one it is, is tempered: those that explain the
    same mismatch differ by little of it, and what no model has, such as nuisances, may decide that. Where a hair's
    breadth of parameters moves the model that leads at random, its evidence is a normal deviate about what was found.
    Luck has not left behind what does not follow the recordings, or their beginnings, if what leads follows them. What
    leads by a further size that may have taken up nuisances is no likelier than a rival without that size.

    Args:
        models: as `told_as` gives them.
        tried: as of `value`.
    """
    values = np.array([value(m, tried) for _, m in models])
    best = int(values.argmax())
    leader = models[best][1]
    luck = leader.left.luck
    some = np.array([bool(as_.effects) for as_, _ in models])
    count = EVIDENCE.lots if luck else 1
    lots = [luck * NormalDist().inv_cdf((k + 0.5) / count) for k in range(count)]
    behind = np.array([luck > 0 and _alone_follows(leader, m) for _, m in models])
    found: dict[frozenset[str], float] = {}
    for lot in lots:
        drawn = values.copy()
        drawn[best] += lot
        drawn[behind] += lot  # as far behind it, whatever the lot
        for (as_, _), share in zip(models, _shares(drawn, some), strict=True):
            found[as_.keys] = found.get(as_.keys, 0.0) + float(share) / count
    return _raised(found, models, models[best][0])


def _raised(
    odds: dict[frozenset[str], float], models: Sequence[tuple[ScoredModel, ScoredModel]], leader: ScoredModel
) -> dict[frozenset[str], float]:
    """Probabilities with rivals as probable as the leader that differ from it by what its further sizes take up."""
    refit = next((as_ for as_, _ in models if not as_.effects), None)
    if refit is None or not leader.effects:
        return odds
    most = explicable(refit, (m for _, m in models))
    equal = {as_.keys for as_, _ in models if _differs_by_nuisances(leader, as_, most)}
    some = {keys for keys in odds if keys}
    raised = {keys: max(odds[keys], odds[leader.keys]) if keys in equal else odds[keys] for keys in some}
    share = sum(odds[keys] for keys in some) / sum(raised.values())
    return odds | {keys: share * value for keys, value in raised.items()}


def _differs_by_nuisances(model: ScoredModel, rival: ScoredModel, explained: float) -> bool:
    """Whether what a model explains beyond a rival of fewer sizes may be nuisances, which a further size takes up.

    A simpler law, there or elsewhere, is no rival in this sense: what the richer one explains beyond it speaks for the
    richer one, unless others meet that as well. More than a sensor's noise may be is more than nuisances leave.
    """
    fewer = len(rival.keys) == len(model.keys) and rival.size < model.size
    little = energy(rival) - energy(model) < EVIDENCE.share * explained
    lost = [c for c in rival.effects if c.key not in model.keys]
    more = [c for c in model.effects if c.key not in rival.keys]
    simpler = any(is_in(a, b) or b.effect in NESTED.get(a.effect, ()) for a in lost for b in more)
    return fewer and little and not simpler and not misses(rival.left) and not _unbends(model, rival)


def _shares(values: NDArray[np.float64], some: NDArray[np.bool_]) -> NDArray[np.float64]:
    """How probable models of some values are, those with effects tempered among each other."""
    plain = _softmax(values, 1.0)
    if some.any():
        plain[some] = plain[some].sum() * _softmax(values[some], EVIDENCE.temperature)
    return plain


def _softmax(values: NDArray[np.float64], temperature: float) -> NDArray[np.float64]:
    """Shares that add up to one, each in proportion to e to the power of its value over the temperature."""
    weights = np.exp(np.maximum((values - values.max()) / temperature, -700.0))
    return np.asarray(weights / weights.sum())


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
    """Share of what the refitted model leaves unexplained that a model explains, or of the strain if that is bent.

    What the refitted model leaves is measured against the noise that the other one shows, where that is weaker: what a
    model takes away was no sensor's noise.
    """
    room = refit.left.as_quiet_as(model.left).unexplained + 0.5 * refit.strain
    shares = [1 - model.room / room] if room > 0 else [0.0]
    if refit.bent:
        shares.append(1 - model.strain / refit.strain)
    return max(*shares, 0.0)


def explained(refit: ScoredModel, model: ScoredModel) -> float:
    """Share of the held-out excess that a model explains, or of `relieved` if that is more.

    It is judged where the fit ended or where all recordings together are likeliest, whichever speaks for the model: the
    fitted ones may leave a size open that held-out ones tell. What lets bent parameters return explains what these had
    made up for. Where more than noise is left, its share is no more than that of what the user's model leaves with its
    parameters as given.
    """
    together = min(refit.hold_out, refit.together)
    share = max(_share_of(refit.hold_out, model.hold_out, model), _share_of(together, model.together, model))
    relief = relieved(refit, model)
    if relief > share and misses(model.unseen):
        relief = min(relief, _share_of(refit.given, model.hold_out, model))
    return min(max(share, relief, 0.0), 1.0)


def _share_of(before: float, after: float, model: ScoredModel) -> float:
    """Share of what is left beyond the sensors' noise that a model explains; both mean squared residuals, held out."""
    beyond = before - floor(model)
    return (before - after) / beyond if beyond > 0 else 0.0


def may_imitate(refit: ScoredModel, model: ScoredModel) -> bool:
    """Whether a model explains too little to be given its name: half, or of what is not noise nearly all."""
    share = explained(refit, model)
    return share < EVIDENCE.most or (share < EVIDENCE.imitated and misses(model.unseen))
