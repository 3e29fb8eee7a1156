"""The search for what is missing: from the user's model, effects are added, exchanged and removed while it pays."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate, Sizes, across, all_beside, beside, cuts
from diagnosis.effects.places import node
from diagnosis.effects.scales import OperatingScales, operating_scales
from diagnosis.estimation.tones import tones
from diagnosis.recordings.types import Recorded
from diagnosis.search.allowance import OutOfTime
from diagnosis.search.equivalent_effects import lookalikes
from diagnosis.search.exchange import exchanged
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nonparametric import laws
from diagnosis.search.partial_fit import drawn_back, ended, place_of, standing
from diagnosis.search.posterior import (
    complete,
    energy,
    explained,
    is_in,
    is_simpler,
    misses,
    owes_little,
    price,
    prices,
    probabilities,
    strained,
)
from diagnosis.search.ranking import best_ways, by_turns, cut, ranked, related, spoken_for
from diagnosis.search.readings import taken_otherwise
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import Course, Origin, courses, likeness, together
from diagnosis.search.study import Looked, Study
from diagnosis.search.tried_models import Progress, TriedModels, Values
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.spread import Spread
from engine.work import counted


def study(
    fitter: CandidateFitter,
    *,
    most: int = SEARCH.most,
    without: Sequence[str] = (),
    progress: Progress | None = None,
    told: Sequence[str] = (),
    known: Sequence[ScoredModel] = (),
    looked: Looked | None = None,
    cut_short: bool = False,
) -> Study:
    """Refit the model, search for the effects that it lacks, and say how probable each is.

    Args:
        fitter: the user's model and the recordings, training and held-out, and where they are fitted.
        most: largest number of effects.
        without: effects that are not to be tried.
        progress: told what is done, how many of how many.
        told: what was done differently from what was asked, before.
        known: models that were found with other recordings, which are fitted to these too.
        looked: what was seen of these recordings read otherwise. Readings are less than a sample apart: effects are not
            looked at again beside the user's model, and those are fitted first that were worth most.
        cut_short: whether the time that is allowed ended a search in other recordings, whose models these are.
    """
    if progress:
        progress("fitting the model's own parameters", 0, 1)
    refit = fitter.refit
    base = fitter.base
    zero = np.zeros(len(base.free))
    before = (base.chi2(zero, base.training), base.chi2(zero, base.held_out))
    scales = _seen_beside(operating_scales(base), refit)
    search = _Search(
        fitter,
        refit,
        candidates(scales, without),
        progress,
        lambda model: candidates(_seen_beside(scales, model), without),
        looked,
    )
    search.ended_early = cut_short
    search.fit_known(known)
    try:
        search.begin()
        if anew := taken_otherwise(fitter, search.known.best):
            # How a file is to be read was told by a model without the effect, and all that follows hangs on it.
            return study(
                fitter.again(anew),
                most=most,
                without=without,
                progress=progress,
                told=told,
                known=known,
                looked=search.handed_on,
            )
        swapped = _exchanged(search, told)
        if not swapped:
            search.run(most)
            swapped = _exchanged(search, told)
        if swapped:
            return study(
                fitter.again(swapped[0]),
                most=most,
                without=without,
                progress=progress,
                told=[swapped[1]],
                known=[m for m in search.near() if m.effects],
                cut_short=search.ended_early,
            )
        named = search.study(before, scales, told)
        return search.study(before, scales, told) if search.add_curves(named) else named
    except OutOfTime:
        search.ended_early = True
        search.reduce()
        return search.study(before, scales, told)


def _exchanged(search: _Search, told: Sequence[str]) -> tuple[list[Recorded], str] | None:
    """The recordings with a held-out one moved to training, once; see `exchanged`.

    What is missing in held-out recordings alone may hide there what training recordings have shown. It is asked after
    the first effect, too: where that leaves nothing of the fitted recordings, no second effect can be learned there.
    """
    fitter, found = search.fitter, search.known
    if told or fitter.tables:
        return None
    return exchanged(fitter, found.best, found.price) or exchanged(fitter, found.best_fitted, found.price)


def _seen_beside(scales: OperatingScales, model: ScoredModel) -> OperatingScales:
    """Scales with what a model leaves over: its frequencies, and what stands out by a shaft's angle or a command."""
    problem, x, values = model.fit.problem, model.fit.x, standing(model.fit)
    if cuts(model.effects):
        scales = scales.parted(problem)
    left = {e.name: problem.residual(x, e) for e in problem.training}
    fitted = np.array([f.position(values.get(place_of(f), f.start)) for f in scales.problem.free])
    found = dict[float, float]()
    for e in problem.training:
        found |= e.lines(left[e.name], SEARCH.lines)
    lines = sorted(found, key=lambda w: -found[w])[: SEARCH.lines]
    return replace(scales, lines=lines, tones=tones(problem.training, left, SEARCH.lines), fitted=fitted, left=left)


class _Search:
    """The moves from the models that were fitted so far to the next.

    Args:
        fitter: fits them.
        refit: the user's model, fitted.
        listed: effects at places.
        progress: told what is done.
        beside: lists them by what a model leaves over; as they are, if None.
        looked: as of `study`.
    """

    def __init__(
        self,
        fitter: CandidateFitter,
        refit: ScoredModel,
        listed: Sequence[Candidate],
        progress: Progress | None,
        beside: Callable[[ScoredModel], list[Candidate]] | None = None,
        looked: Looked | None = None,
    ) -> None:
        self.fitter, self.listed, self.progress, self._list = fitter, list(listed), progress, beside
        self.known = TriedModels(fitter, refit, sum(1 for c in self.listed if not c.freed), progress)
        self._plain = {c.key for c in self.listed}
        """Effects at places of the user's model; others are at places that a joint that was put in has parted."""
        self.looked = looked
        """What was seen beside the user's model alone, once that was looked at."""
        self._order = best_ways(looked.order) if looked else []
        self._extended: list[ScoredModel] = []
        """Models that were extended."""
        self._cut: list[ScoredModel] = []
        """Models whose nodes were cut otherwise."""
        self._begun: bool | None = None
        """Whether the first effect was sought, once that is known."""
        self._first_tasks: list[tuple[list[tuple[tuple[Candidate, ...], list[Values]]], int]] = []
        """First effects that are still to be fitted, and the wrong parameters among them; how many to the end."""
        self._all_begun = True
        """Whether all first effects have had their turn: it ends after a share of the time that is allowed."""
        self.ended_early = False
        """Whether the time that is allowed was over before all was tried."""

    def begin(self) -> None:
        """Add one effect, if even a perfect one would pay beside the user's own model; once.

        Models of other recordings that are known here change nothing of that: what these recordings show more, others
        may explain better.
        """
        self.known.bounded = True
        if self._begun is None:
            self._begun = self.known.refit.room >= self.known.price + SEARCH.effort
            if self._begun:
                if self.looked is None:
                    self._first()
                else:
                    self.known.failures += self.looked.refused
                    tasks = [(_as_ended(m), [standing(m.fit)]) for m in self.looked.fitted]
                    self.known.fit(tasks, SEARCH.finished)
                self._all_begun &= self._within(SEARCH.first, self._vary)
                self.known.patience.at_least(self.fitter.work.done)

    def run(self, most: int) -> None:
        """Add effects one by one, from the best few models, while even a perfect further effect would pay."""
        self.begin()
        if self._begun:
            if not self._within(SEARCH.growing, lambda: self._grow(most)):
                self.ended_early = True
                self._vary()  # what leads may have come just before, and have rivals as good
            if not self._all_begun:
                self._go_on_with_the_first()
        for model in self.near():
            self._put_in_place_of_equals(model)
        for model in self.near():
            self.known.settled(model)
        self.known.confirmed(self.known.best)
        self.known.begin_at_the_best()
        done: list[ScoredModel] = []
        # Beside a nuisance that it is told without, a law may owe to the nuisance what makes it rich.
        while left := [m for m in self.known.leading if not any(m is d for d in done)]:
            done.append(left[0])
            self._simplified(left[0])
            self._enriched(left[0])
            if left[0] is self.known.best:
                self._doubted(left[0])
                if left[0] is not self.known.best:
                    self._vary()
        for rival in self._rivals() if self._explains_most else []:
            self._chosen_anew(rival)
            for effect in rival.effects:
                self._simpler(rival, effect)
                if effect.key not in self.known.best.keys and (alike := self._mimics(effect)):
                    kept = tuple(ended(rival, c) for c in rival.effects if c is not effect)
                    self._beside(kept, rival, SEARCH.exchanged, alike)
        self._evened()
        # Those moves may have left a closer fit of a model on its way, and what takes part in the choice has an end.
        for model in self.known.taking_part:
            self.known.settled(model)

    def reduce(self) -> None:
        """Fit what leads to its end, and simpler laws in the places of its own, although the time is over: it is told.

        Of an end that is none no interval is told. The simpler law may do as well, and without a fit of its own it
        could not be told in the place of the richer one.
        """
        self.known.bounded = False
        leader = self.known.settled(self.known.best)
        for effect in leader.effects:
            self._simpler(leader, effect)

    @property
    def handed_on(self) -> Looked | None:
        """What to go on with in other recordings that hardly differ from these."""
        return self.looked and replace(self.looked, fitted=tuple(self.known.foremost()))

    @property
    def _looked_at(self) -> list[Candidate]:
        """Effects, but for freed parameters, that were looked at beside the user's model alone."""
        return [c for c in self.looked.order if not c.freed] if self.looked else []

    def near(self) -> list[ScoredModel]:
        """The models near the best that are worth most, itself among them."""
        near = [m for m in self.known.models if self.known.worth(m) > self.known.reach]
        return sorted(near, key=self.known.worth, reverse=True)[: SEARCH.settled]

    def _rivals(self) -> list[ScoredModel]:
        """What the models near the best are told as, the best first: what else they have may be nuisances."""
        near = sorted(self.known.told, key=lambda pair: self.known.worth(pair[1]), reverse=True)
        told = {as_.keys: as_ for as_, m in near if self.known.worth(m) > self.known.reach}
        return list(told.values())[: SEARCH.settled]

    def fit_known(self, models: Sequence[ScoredModel]) -> None:
        """Fit models that were found with other recordings, from where they ended there, each to its end.

        A fit may end at a size that is faster than one may begin from. Then each effect begins anew beside the others.
        """
        for m in models:
            self.known.fit([(_as_ended(m), [standing(m.fit)])], 1, whole=True)
            if m.keys not in self.known:
                tasks: list[tuple[tuple[Candidate, ...], list[Values]]] = []
                for effect in m.effects:
                    kept = tuple(ended(m, c) for c in m.effects if c is not effect)
                    same = [c for c in self.listed if (c.key, c.option) == (effect.key, effect.option)]
                    tasks += [((*kept, c), [standing(m.fit)]) for c in _able_beside(kept, same)]
                self.known.fit(tasks, 1, whole=True)

    def _simplified(self, model: ScoredModel) -> None:
        """Take each effect of a model away, or put a simpler law in its place, from where it ended, and try it again.

        Where a machine sticks, its answer jumps with every parameter, and the fit of a simple law may end at a jump
        that a richer law has passed by.
        """
        if len(model.effects) > 1:
            self._without_each(model)
        for effect in model.effects:
            for made in self._simpler(model, effect):
                known = self.known[made.keys]
                if self.known.worth(known) < self.known.worth(model) and self._does_most(known, model, effect):
                    self.known.keep(self.fitter.retried(made, self.known.told_below(model)))

    def _without_each(self, model: ScoredModel) -> None:
        """Take each effect of a model away, from where it ended."""
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            self.known.fit([(kept, [standing(model.fit)])], 1, whole=True, near=model)

    def _doubted(self, model: ScoredModel) -> None:
        """Put other effects beside a simpler law that explains nearly as much as the law of a model.

        What the richer law explains beyond that may be a nuisance, or a second effect, for which another one beside the
        simpler law accounts as well, or better: where the richer law leaves more than a further effect costs, the
        simpler one need only explain most of what it does.
        """
        leaves = model.room >= self.known.price + SEARCH.effort
        same = [m for m in self.known.models if len(m.keys) == len(model.keys) and is_simpler(m, model)]
        poorer = [
            m
            for m in same
            if owes_little(model, m, self.known.explained)
            or (leaves and all(self._does_most(m, model, c) for c in model.effects if c.key not in m.keys))
        ]
        if not poorer:
            return
        for simpler in poorer:
            if len(simpler.effects) < SEARCH.most:
                self._extend(simpler, self.listed)
        pairs = [c for c in lookalikes(model, self.listed) if prices(c) <= SEARCH.most]
        self.known.fit([(c, [standing(model.fit)]) for c in pairs], len(pairs), near=model)

    def _does_most(self, simpler: ScoredModel, model: ScoredModel, effect: Candidate) -> bool:
        """Whether a simpler law explains most of what an effect of a model does.

        Then its fit may have ended at a jump of the cost, short of the rest.
        """
        keys = model.keys - {effect.key}
        if keys not in self.known:
            return True  # it could not be fitted
        without = self.known[keys]
        return energy(without) - energy(simpler) > EVIDENCE.most * (energy(without) - energy(model))

    def _chosen_anew(self, model: ScoredModel) -> None:
        """Put each effect of a model in with every value of what is only chosen, such as a wave's order.

        It was chosen after a few steps by the recordings that are fitted: over a short way orders are alike there.
        Those that were fitted to the end are left out.
        """
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            listed = [c for c in self.listed if (c.key, c.option) == (effect.key, effect.option)]
            ways = [way for c in _able_beside(kept, listed) for way in c.choices()]
            if len(ways) > 1:
                tasks = [
                    ((*kept, way), [standing(model.fit)]) for way in ways if not self.known.has_ended((*kept, way))
                ]
                self.known.fit(tasks, 1, near=model)

    def _simpler(self, model: ScoredModel, effect: Candidate) -> list[ScoredModel]:
        """Put simpler laws in the place of an effect of a model, from where it ended; they are given."""
        values = model.fit.parameters()
        kept = tuple(ended(model, c) for c in model.effects if c is not effect)
        same = [c for c in self.listed if (c.place, c.option) == (effect.place, effect.option)]
        laws = [c for c in same if c.key != effect.key and is_in(c, effect)]
        # From a stiffness that was fitted to nothing no other can grow: that one keeps its own start.
        begun = [
            replace(c, starts=({k: values.get(f"{effect.name}.{k}") or v for k, v in c.starts[0].items()},))
            for c in _able_beside(kept, laws)
        ]
        tasks = [((*kept, c), [standing(model.fit)]) for c in begun]
        return self.known.fit(tasks, len(tasks), whole=True, near=model)

    def _evened(self) -> None:
        """Put nuisances that fit beside the best model in beside its rivals too, so that like compares with like."""
        best, whole = self.known.leading
        if not best.keys < whole.keys:
            return
        nuisances = tuple(ended(whole, c) for c in whole.effects if c.key not in best.keys)
        rivals = {m.keys: m for m, _ in self.known.told if m.effects and self.known.worth(m) > self.known.reach}
        tasks: list[tuple[tuple[Candidate, ...], list[Values]]] = []
        for m in rivals.values():
            both = all_beside([ended(m, c) for c in m.effects], nuisances)
            if m is not best and both is not None and prices(both) <= SEARCH.most:
                tasks.append((both, [standing(m.fit)]))
        self.known.fit(tasks, len(tasks), whole=True, near=whole)

    def _enriched(self, model: ScoredModel) -> None:
        """Put richer laws in the place of a simpler one of a model, from where that ended.

        Each that was not tried, and each that left more: it contains the simpler one, so its fit has lost its way. The
        order of a wave was chosen beside the simpler law: beside one that comes closer it is chosen anew.
        """
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            found = ended(model, effect).starts[0]
            richer = [
                replace(c, starts=_grown_from(found, c))
                for c in _able_beside(kept, self.listed)
                if (c.place, c.option) == (effect.place, effect.option) and c.key != effect.key and is_in(effect, c)
            ]
            wanted = [c for c in richer if not self._as_close(frozenset(k.key for k in (*kept, c)), model)]
            tasks = [((*kept, c), [standing(model.fit)]) for c in wanted]
            made = self.known.fit(tasks, len(wanted), whole=True, near=model)
            closer = [m for m in made if m.fit.cost < model.fit.cost and any(c.wave is not None for c in kept)]
            self.known.fit([(self._with_all_orders(_as_ended(m)), [standing(m.fit)]) for m in closer], 1, near=model)

    def _as_close(self, keys: frozenset[str], model: ScoredModel) -> bool:
        """Whether a model with these effects was fitted, as closely as another one but for what is no evidence."""
        return keys in self.known and 0.5 * (self.known[keys].fit.cost - model.fit.cost) < SEARCH.effort

    def _grow(self, most: int) -> None:
        leading = [m.keys for m in self.known.leading]
        if self._follow(most):
            return
        for count in range(2, most + 1):
            if count == 2 and not self._enough():
                self._look_back(most)
            # Of three effects two explain most: where they do not, what is missing is not among those that are listed.
            if self._enough() or (count > 2 and not self._explains_most):
                return
            if self._is_weak(self._leader()):
                self._extend_whole(most)
            else:
                self._deepen(count)
            self._vary()
            before, leading = leading, [m.keys for m in self.known.leading]
            # What leads may be told without an effect that only a third one makes worth its while.
            if leading == before:
                return

    def _follow(self, most: int) -> bool:
        """Add effect after effect to what leads, as long as a richer model leads then; whether one explains all.

        Where the first effects are right this ends soonest. What leads less is looked at only where it does not. Two
        that promise most together come before a second beside the first: what promised most alone may be a mixture.
        """
        for count in range(2, most + 1):
            before = self._leader()
            if self._enough() or self._is_weak(before) or (count > 2 and not self._explains_most):
                return False
            if count == 2:
                self._pairs(SEARCH.few, before)
                before = self._best_alone(before)
                if misses(before.left):
                    self._pairs_of_beginnings(before)
                    before = self._best_alone(before)
            # What leads is extended before the search gives up, however long pairs have taken that are no better.
            if count > 2 or self.known.best.keys == before.keys or not self._enough():
                self._extend(before, self.listed)
            if len(self.known.best.keys) <= len(before.keys) and strained(before, self.known.tried):
                self._extend_unstrained(len(before.effects))
            whole = self.known.leading[1]
            if len(self.known.best.keys) <= len(before.keys) and len(before.effects) < len(whole.effects) < most:
                # What else is in it counts as a nuisance beside what is still missing, such as a sensor's large bias.
                self._extend(whole, self.listed)
            if len(self.known.best.keys) <= len(before.keys):
                return False
            if not self._enough():
                self._enriched(self.known.best)  # a richer law costs less than a further effect
            if self._enough():
                if count > 2:
                    self._paired_otherwise(self.known.best)
                self._vary()
                self._finish_waiting()
                return self._enough()
        return False

    def _extend_unstrained(self, count: int) -> None:
        """Add an effect to the best model of so many whose parameters are not far off.

        What leads with parameters that are far off may imitate two effects; one of these leads with them where they
        belong.
        """
        able = [m for m in self.known.models if len(m.effects) == count and not strained(m, self.known.tried)]
        if able:
            self._extend(max(able, key=self.known.worth), self.listed)

    def _best_alone(self, before: ScoredModel) -> ScoredModel:
        """What leads, or one of two effects that lead together instead, where that is worth more alone.

        Beside parameters that are bent for want of it, it had promised too little to be fitted.
        """
        leader = self.known.best
        if len(leader.effects) < 2:
            return before
        self._without_each(leader)
        parts = [m for m in self.known.models if len(m.effects) == 1 and m.keys < leader.keys]
        return max([before, *parts], key=self.known.worth)

    def _paired_otherwise(self, model: ScoredModel) -> None:
        """Look for a pair beside each effect of three that explain all: two of them may imitate one."""
        for single in [m for m in self.known.models if len(m.effects) == 1 and m.keys < model.keys]:
            self._extend(single, self.listed)

    def _is_weak(self, before: ScoredModel) -> bool:
        """Whether what a model with effects leaves can be one weak effect more at most.

        What is as strong whatever moves, and little, is a sensor's coloured noise, or one weak effect more; what is
        little beside the effects that are in is a nuisance, or one weak effect more. What parameters that are far off
        make up for is not weak, however little is left with them.
        """
        if not before.effects or strained(before, self.known.tried):
            return False
        steady = before.left.varying < self.known.price + SEARCH.effort and not misses(before.left)
        return complete(before, self.known.refit) or steady

    def _extend_whole(self, most: int) -> None:
        """Add an effect to what leads as it is: two weak effects may each owe too little while the other is missing."""
        before, whole = self.known.leading
        than = whole if len(whole.effects) < most else before
        self._extend(than, self.listed if complete(before, self.known.refit) else self._order[: SEARCH.beside])

    def _look_back(self, most: int) -> None:
        """Fit the effects that had no turn, once it is known what a second one beside the best explains.

        What is better than the best may have looked worse after a few steps on coarse recordings. Beside a pair that
        leaves nothing it is soon seen that most do not come near.
        """
        before = self._leader()
        if self._is_weak(before):
            self._extend_whole(most)
        else:
            for parent in self._parents(1)[:1]:
                self._extend(parent, self.listed)
        if self.known.best is not before and self._enough():
            self._vary()
        self._finish_waiting()
        if not self._enough():
            self._other_laws()

    def _leader(self) -> ScoredModel:
        """The best model so far, fitted until it is sure that it ends there."""
        return self._cut_anew(self.known.confirmed(self.known.best))

    def _enough(self) -> bool:
        """Whether nothing is left that a further effect could explain, or the search gives up.

        Where the user's model leaves no more than a sensor's noise may, one effect is the most, unless parameters are
        far off with it: nuisances are as large there as a second one.
        """
        if self.known.given_up:
            return True
        before = self._leader()
        done = complete(before, self.known.refit)
        if done and not misses(before.unseen) and not strained(before, self.known.tried):
            return True
        if before.room < self.known.price + SEARCH.effort:
            return True
        if misses(self.known.refit.left):
            return False
        return not before.effects or not strained(before, self.known.tried)

    @property
    def _explains_most(self) -> bool:
        """Whether the best model explains as much as a verdict asks of what has a name."""
        return explained(self.known.refit, self.known.best) >= EVIDENCE.most

    def _finish_waiting(self) -> None:
        before = self.known.best
        self.known.finish_waiting()
        if self.known.best is not before:
            self._vary()

    def _other_laws(self) -> None:
        """Fit all other laws at the place of the best effect, and of the blocks that are joined there.

        What a law promises is told in proportion to its size, which a gap or a limit is not, and beside parameters that
        the missing effect has bent: where one law gains much and leaves much, another may gain all. So may the same law
        put in otherwise, such as with stops at both ends.
        """
        before = self.known.best
        places = {c.place for c in before.effects}
        flanges = [flange for place in places for flange in place.split(" -> ")]
        system = self.fitter.scenario.system
        places |= {end.rpartition(".")[0] for flange in flanges for end in node(system, flange)}
        laws = [c for c in self._order if c.place in places and frozenset({c.key}) not in self.known]
        laws += [c for c in self._looked_at if c.key in before.keys and c.option != before.effects[0].option]
        self.known.fit([((c,), self._alone_from()) for c in laws], len(laws))
        self._finish_waiting()
        if self.known.best is not before:
            self._vary()

    def study(self, nominal: tuple[float, float], scales: OperatingScales, notes: Sequence[str]) -> Study:
        """What was tried so far, and how probable it is; arguments as of `Study`."""
        odds = probabilities(self.known.told, self.known.tried)
        trials = [m for m in self.known.models if m.effects]
        trials.sort(key=lambda m: (-odds.get(m.keys, 0.0), -self.known.worth(m)))
        fitted = {c.key for m in trials for c in m.effects}
        return Study(
            self.fitter.scenario,
            self.fitter.recordings,
            nominal,
            self.known.refit,
            tuple(trials),
            max((m for m in (self.known.refit, *trials) if m.keys in odds), key=lambda m: odds[m.keys]),
            odds,
            self.known.tried,
            scales,
            tuple(dict.fromkeys(failed for failed in self.known.failures if failed[0] not in fitted)),
            tuple(notes),
            self.handed_on,
            ended_early=self.ended_early,
        )

    def add_curves(self, found: Study) -> bool:
        """Nonparametric laws where the best model leaves much; whether one does better than all that have a name."""
        if self.fitter.tables or complete(found.chosen, self.known.refit) or not misses(found.chosen.unseen):
            return False
        curves = [(c,) for c in laws(replace(found, chosen=self.known.refit))]
        named = self.known.models
        self.known.fit([(c, [standing(self.known.refit.fit), {}]) for c in curves], len(curves))
        if any(c.effect == "unknown" for c in self.known.confirmed(self.known.best).effects):
            return True
        self.known.keep_only(named)
        return False

    def _deepen(self, count: int) -> None:
        """Add an effect to each of the best models that have one less, and try two at once.

        A pair is the same whichever of the two came first: it is looked for beside that which is extended first.
        """
        parents = self._parents(count - 1)
        for best in parents[:1]:
            # What promised little beside the user's model may promise most beside the best one.
            self._extend(best, self.listed)
            if not self._enough():
                self._finish_beside(best)
        if count == 2 and not self._enough():
            # Two that hide each other promise little one by one: more of these pairs, now that no other explains all.
            self._pairs(SEARCH.fitted)
        # Two effects are likelier than three: where no pair explains all, those that lead less are extended too; pairs
        # where they are near the best, for of three effects two explain most.
        for number, parent in enumerate(parents if count == 2 else parents[: SEARCH.beam]):
            if number == 0 or self._enough() or (count > 2 and self.known.worth(parent) < self.known.reach):
                continue
            before = [m.keys for m in parents[:number]]
            among = [c for c in self._order[: SEARCH.beside] if not any(k <= parent.keys | {c.key} for k in before)]
            self._extend(parent, among)

    def _extend(self, parent: ScoredModel, among: Sequence[Candidate]) -> None:
        """Add one of some effects to a model, or one that only shows in what this model leaves over.

        A vibration's frequency or a cogging's order is hidden as long as something larger is missing, and what acts on
        the other side of a joint is one with what acts on this side as long as the joint is.
        """
        if any(parent is model for model in self._extended):
            return
        self._extended.append(parent)
        anew, new = self._listed_beside(parent)
        among = [*(anew.get((c.key, c.option), c) for c in among), *new]
        kept = _as_ended(parent)
        self._beside(kept, parent, SEARCH.fitted_beside, among)

    def _listed_beside(self, model: ScoredModel) -> tuple[dict[tuple[str, str], Candidate], list[Candidate]]:
        """Effects as they are listed beside a model, by key and option, and those that were not listed before."""
        beyond, listed = cuts(model.effects), self._list(model) if self._list is not None else []
        rows = [c if c.key in self._plain else replace(c, beyond=beyond) for c in listed]
        anew, known = {(c.key, c.option): c for c in rows}, {(c.key, c.option) for c in self.listed}
        new = [c for c in rows if (c.key, c.option) not in known]
        self.listed = [anew.get((c.key, c.option), c) if c.beyond else c for c in self.listed] + new
        return anew, new

    def _parents(self, count: int) -> list[ScoredModel]:
        """The models of a number of effects that are worth most and those that leave least, each with its own effects.

        Beside another effect that is still missing, evidence alone prefers what acts at many frequencies. Of single
        effects that change the recordings alike one has a turn: the others are tried in its place once a pair leads.
        """
        able = [m for m in self.known.models if len(m.effects) == count]
        turns = zip(sorted(able, key=self.known.worth, reverse=True), sorted(able, key=energy), strict=True)
        found: dict[frozenset[str], ScoredModel] = {}
        for model in itertools.chain(*turns):
            effects = frozenset(c.effect for c in model.effects)
            if effects not in found and not (count == 1 and self._is_alike(model, found.values())):
                found[effects] = model
        return list(found.values())[: SEARCH.parents]

    def _is_alike(self, single: ScoredModel, others: Iterable[ScoredModel]) -> bool:
        """Whether a model of one effect changes the recordings nearly as one of others does."""
        mine = self._answers(single.effects[0])
        return any(likeness(mine, self._answers(m.effects[0])) > SEARCH.likest for m in others)

    def _answers(self, effect: Candidate) -> list[Course]:
        """What an effect changes of the recordings beside the user's model alone, put in in every way."""
        origin = self.looked.origin if self.looked else None
        if origin is None:
            return []
        return [course for c in self._looked_at if c.key == effect.key for course in courses(origin, c)]

    def _vary(self) -> None:
        """Vary what leads, until nothing that is found so takes its place: what does was looked for beside another."""
        varied = set[frozenset[str]]()
        while (model := self.known.best).keys not in varied:
            varied.add(model.keys)
            self._varied(model)

    def _varied(self, model: ScoredModel) -> None:
        """Take each effect of a model away; put it elsewhere, others in its place, a known pair in the place of one."""
        alike = {c.key for effect in model.effects for c in self._mimics(effect)}
        self.known.finish_waiting(lambda p: p.effects[-1].key in alike or related(p.effects[-1], model.effects))
        self._finish_dropped(model, alike)
        singles = sorted((m for m in self.known.models if len(m.effects) == 1), key=self.known.worth, reverse=True)
        best = best_ways([*(m.effects[0] for m in singles), *self._order])
        pairs = [c for c in lookalikes(model, best) if prices(c) <= SEARCH.most]
        self.known.fit([(c, [standing(model.fit)]) for c in pairs], len(pairs), near=model)
        self._enriched(model)
        self._moved(model)
        if len(model.effects) == 1 and complete(model, self.known.refit):
            self._elsewhere(model)
            self._put_in_place_of((), model, model.effects[0])
        if len(model.effects) < 2:
            return
        if cuts(model.effects):
            self._listed_beside(model)
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            self.known.fit([(kept, [standing(model.fit)])], 1, whole=True, near=model)
            self._beside_in_every_way(kept, model, effect)
            self._put_in_place_of(kept, model, effect, best[: SEARCH.exchanged])
            if any(c.wave is not None for c in kept):
                self._beside_mimics(kept, model, effect)
        self._put_in_place_of_equals(model)

    def _put_in_place_of(
        self, kept: tuple[Candidate, ...], model: ScoredModel, effect: Candidate, first: Sequence[Candidate] = ()
    ) -> None:
        """Put in the place of an effect of a model others that act there or are of its kind, and what imitates it.

        All that imitates it is fitted to the end: what it promises, or leaves after a few steps, tells little of it.

        Args:
            kept: the other effects of the model, as they ended.
            model: which.
            effect: of it.
            first: further effects to try.
        """
        akin = [*(c for c in self.listed if related(c, [effect])), *first]
        others = {id(c): c for c in akin if c.key != effect.key}
        self._beside(kept, model, SEARCH.exchanged, list(others.values()))
        keys = frozenset(c.key for c in kept)
        wanted = [c for c in self._mimics(effect) if not self._as_close(keys | {c.key}, model)]
        tasks = [((*kept, c), self._begun_from(model)) for c in _able_beside(kept, wanted)]
        self.known.fit(tasks, len(tasks), near=model)

    def _mimics(self, effect: Candidate) -> list[Candidate]:
        """Effects that change the recordings nearly as one does beside the user's model alone, each kind by turns.

        However little they promised there, where something stronger was missing: a delay in front of the motor is a
        sensor's lag to whatever answers in proportion.
        """
        origin = self.looked.origin if self.looked else None
        if origin is None:
            return []
        mine = self._answers(effect)
        likest = {id(c): likeness(courses(origin, c), mine) for c in self._looked_at if c.key != effect.key}
        near = [c for c in self._looked_at if likest.get(id(c), 0.0) > SEARCH.likest]
        by_likeness = best_ways(sorted(near, key=lambda c: -likest[id(c)]))
        return by_turns(by_likeness, lambda c: c.effect)[: SEARCH.exchanged]

    def _beside_mimics(self, kept: tuple[Candidate, ...], than: ScoredModel, effect: Candidate) -> None:
        """Put in the place of an effect what changes the recordings nearly as it does, and choose a wave's order anew.

        The order was chosen beside the effect: gravity leaves another one for the ripple than an offset does.
        """
        pairs = [(*kept, c) for c in _able_beside(kept, self._mimics(effect))]
        tasks = [(self._with_all_orders(pair), [standing(than.fit)]) for pair in pairs]
        self.known.fit(tasks, 1, near=than)

    def _put_in_place_of_equals(self, model: ScoredModel) -> None:
        """Put in the place of some effects of a model those that did as well as these without the others, no better.

        What could not be told apart alone may tie beside the others too, and is no rival before it was tried there.
        What did far better alone does so by what the others explain.
        """
        for part in (m for m in self.known.models if m.effects and m.keys < model.keys):
            kept = [ended(model, c) for c in model.effects if c.key not in part.keys]
            apart = {
                m.keys: abs(self.known.worth(m) - self.known.worth(part))
                for m in self.known.models
                if len(m.effects) == len(part.effects) and m.keys != part.keys
            }
            equals = [self.known[keys] for keys in sorted(apart, key=apart.__getitem__) if apart[keys] < SEARCH.effort]
            tasks: list[tuple[tuple[Candidate, ...], list[Values]]] = []
            for m in equals[: SEARCH.exchanged]:
                both = all_beside(kept, [ended(m, c) for c in m.effects])
                if both is not None and not self._as_close(frozenset(c.key for c in both), model):
                    tasks.append((both, [standing(m.fit), standing(model.fit)]))
            self.known.fit(tasks, len(tasks), near=model)

    def _finish_dropped(self, model: ScoredModel, alike: Collection[str]) -> None:
        """Fit to the end what had no turn although it is akin to a model: as many effects, each akin to one of its own.

        A few steps do not tell such models apart: those with effects at its places, the same ones, or their imitations.

        Args:
            model: which.
            alike: its imitations, by key.
        """
        akin = [
            p
            for p in self.known.dropped
            if len(p.effects) == len(model.effects)
            and all(c.key in alike or related(c, model.effects) for c in p.effects)
        ]
        self.known.dropped = [p for p in self.known.dropped if not any(p is other for other in akin)]
        for few in range(0, len(akin), SEARCH.few):
            made = self.known.finished(akin[few : few + SEARCH.few])
            if all(self.known.worth(m) < self.known.reach for m in made):
                return

    def _finish_beside(self, model: ScoredModel) -> None:
        """Fit to the end what was put in beside a model and had no turn: a few steps do not tell what gains most."""
        more = [p for p in self.known.dropped if model.keys < {c.key for c in p.effects}]
        self.known.dropped = [p for p in self.known.dropped if not any(p is other for other in more)]
        for partial in more:  # one by one: that some come nowhere near the best says nothing of the others
            self.known.finished([partial])

    def _moved(self, model: ScoredModel) -> None:
        """Put each effect of a model elsewhere, with the sizes that it has anywhere, such as a vibration's frequency.

        A frequency is found only from near it, and the one that an effect was begun from may have been a resonance's.
        """
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            found = ended(model, effect).starts[0]
            anywhere = {k.name: found[k.name] for k in effect.parameters if k.anywhere}
            same = [c for c in self.listed if c.effect == effect.effect and c.place != effect.place]
            able = _able_beside(kept, same) if anywhere else []
            moved = [replace(c, starts=tuple({**start, **anywhere} for start in c.starts)) for c in able]
            self.known.fit([((*kept, c), [standing(model.fit)]) for c in moved], len(moved), near=model)

    def _elsewhere(self, model: ScoredModel) -> None:
        """Put the only effect of a model at the places where it was not fitted, with the sizes that it has.

        What promised too little to be fitted there may do as well: from the sizes that effects begin from, a spring
        that hardens promised a hundredth of what it gains, and other laws spoke for its cut. Sizes are as large at
        another place beside those that are usual there: behind a gear, by its ratio.
        """
        effect = model.effects[0]
        found = ended(model, effect).starts[0]
        usual = next((c.starts[0] for c in self.listed if (c.key, c.option) == (effect.key, effect.option)), {})
        rivals = [
            replace(c, starts=({k: v * _ratio(c.starts[0][k], usual.get(k, 0.0)) for k, v in found.items()}, found))
            for c in self.listed
            if c.effect == effect.effect
            and not c.freed
            and frozenset({c.key}) not in self.known
            and c.starts[0].keys() == found.keys()
        ]
        parents = [standing(model.fit), standing(self.known.refit.fit)]
        able = by_turns(self._screened(self._origins((), model, parents), rivals), lambda c: c.place)
        self.known.fit([((c,), parents) for c in able[: SEARCH.fitted]], SEARCH.few, near=model)

    def _cut_anew(self, model: ScoredModel) -> ScoredModel:
        """Cut nodes with blocks whose parameters are far off on the other side, one by one, while that helps.

        A node of many flanges can be cut in tens of ways, more than are fitted. A cut with a body on the wrong side
        does as well with its inertia and those of its neighbours bent, which tells what is to be moved: a block that
        is on the wrong side need not be bent as far as its neighbours. The best model then is given.
        """
        while model.far_off and not any(model is other for other in self._cut):
            self._cut.append(model)
            found, bent = [model], model.bent_blocks
            for effect in model.effects:
                kept = tuple(ended(model, c) for c in model.effects if c is not effect)
                near = [c for c in self.listed if c.effect == effect.effect and _is_moved(across(c, effect), bent)]
                anew = [replace(c, starts=ended(model, effect).starts) for c in near]
                tasks = [((*kept, c), self._begun_from(model)) for c in _able_beside(kept, anew)]
                found += self.known.fit(tasks, len(tasks), near=model)
            model = max(found, key=self.known.worth)
        return self.known.best

    def _alone_from(self) -> list[Values]:
        """Parameters that a first effect begins from: those of the refit, and those given where it has bent any.

        Of a friction that the refit has nearly taken away, little can fall: what changes a parameter is seen from its
        value.
        """
        refit = self.known.refit
        return [standing(refit.fit), *([{}] if refit.bent or refit.far_off else [])]

    def _first(self) -> None:
        """Put every effect into the user's model, and fit those that promise most."""
        parents = self._alone_from()
        origins = [o for values in parents if (o := self.fitter.origin((), values)) is not None]
        before = len(self.known.failures)
        ranked = self._screened(origins, self.listed)
        refused = tuple(self.known.failures[before:])
        self.looked = Looked(tuple(ranked), refused, origins[0] if origins else None)
        self._order = best_ways(ranked)
        able = [c for c in self._order if self._pays(origins, c)]
        first = able[:1]
        self.known.fit([((c,), parents) for c in first], 1)
        able = self._near_promised(origins, able)
        # A wrong parameter is as likely as a missing effect: neither kind is to crowd out the other.
        kinds = ([c for c in able if not c.freed], [c for c in able if c.freed])
        self._first_tasks = [
            ([((c,), parents) for c in kind[: SEARCH.fitted]], SEARCH.finished - (1 if kind[:1] == first else 0))
            for kind in kinds
        ]
        self._all_begun = self._within(SEARCH.first, self._fit_first)

    def _fit_first(self) -> None:
        """Fit the first effects that are still to be fitted."""
        while self._first_tasks:
            self.known.fit(*self._first_tasks[0])
            self._first_tasks.pop(0)

    def _go_on_with_the_first(self) -> None:
        """Fit the first effects that had no turn, since a further effect was to have its own; vary what leads."""
        self._fit_first()
        self.known.finish_waiting()
        self._vary()

    def _within(self, share: float, move: Callable[[], None]) -> bool:
        """Make a move that ends once a share of the time that is allowed is over; whether it came to its own end."""
        self.known.until = share
        try:
            move()
        except OutOfTime:
            return False
        finally:
            self.known.until = 1.0
        return True

    def _near_promised(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[Candidate]:
        """Effects that may come near the first of them, where that explains all; all of them where it does not.

        What promised as much as the first may gain as much, however little was promised.
        """
        best, refit = self.known.best, self.known.refit
        if not complete(best, refit) or misses(best.unseen):
            return list(able)
        promised = {id(c): max(self._gains(origins, c)) for c in able}
        gained = self.known.worth(best) - self.known.worth(refit)
        times = max(SEARCH.promised, gained / promised[id(able[0])])
        return [c for c in able if times * promised[id(c)] > self.known.reach - self.known.worth(refit)]

    def _beside(
        self,
        kept: tuple[Candidate, ...],
        than: ScoredModel,
        most: int,
        among: Sequence[Candidate],
    ) -> None:
        """Put effects in beside others, and fit those that promise most, a few at a time.

        Where those few come nowhere near the best model, what promises less is left; so it is where a further effect
        gains nothing. What promises little alone is left only where many times as much would not come near the best:
        what is still missing has bent the sizes of those that are in. What was fitted as closely as the model already
        is not fitted again.

        Args:
            kept: effects that stay, each at the one size that it starts from.
            than: the model that is to be bettered, whose parameters are begun from; where they are bent to make up for
                what is missing, drawn back as well, and effects are looked at from there.
            most: number of models that are fitted.
            among: effects to put in.
        """
        parents = self._begun_from(than)
        keys = frozenset(c.key for c in kept)
        others = [c for c in among if not self._as_close(keys | {c.key}, than)]
        ways = best_ways(self._screened_beside(kept, than, parents, others))
        able = by_turns(ways[:most], lambda c: c.place)
        for few in range(0, len(able), SEARCH.few):
            tasks = [((*kept, c), parents) for c in able[few : few + SEARCH.few]]
            found = self.known.fit(tasks, 1, near=than)
            least = max(self.known.worth(than), self.known.reach) if than.keys <= keys else self.known.reach
            if found and all(self.known.worth(m) < least for m in found):
                break
        self.fitter.forget(kept)

    def _beside_in_every_way(self, kept: tuple[Candidate, ...], than: ScoredModel, effect: Candidate) -> None:
        """Put an effect in beside others at all its places, in every way: sides of a cut, orders of a wave.

        Neither what they promise nor a few steps tell them apart: many are fitted, and the best few to the end. They
        begin from the sizes that it has, too: behind a gear these are the same but for its ratio, and where contacts
        bounce no other start may lead there.

        Args:
            kept: effects that stay, each at the one size that it starts from.
            than: the model that has all of them, whose parameters are begun from.
            effect: which.
        """
        parents = self._begun_from(than)
        found = ended(than, effect).starts[0]
        same = [c for c in self.listed if c.effect == effect.effect]
        alike = [replace(c, starts=(*c.starts, found)) if c.starts[0].keys() == found.keys() else c for c in same]
        ways = [way for c in alike for way in c.choices()]
        able = self._screened_beside(kept, than, parents, ways)
        self.known.fit([((*kept, c), parents) for c in able[: SEARCH.fitted]], SEARCH.few, near=than)
        self.fitter.forget(kept)

    def _screened_beside(
        self,
        kept: tuple[Candidate, ...],
        than: ScoredModel,
        parents: Sequence[Values],
        among: Sequence[Candidate],
    ) -> list[Candidate]:
        """Effects that may come near the best model beside others, those that promise most first; as of `_beside`."""
        origins, keys = self._origins(kept, than, parents), frozenset(c.key for c in kept)
        ways = self._screened(origins, _able_beside(kept, among))
        if keys not in self.known:
            return ways
        wanting = self.known.reach - self.known.worth(self.known[keys])
        return [c for c in ways if SEARCH.promised * max(self._gains(origins, c), default=math.inf) > wanting]

    def _begun_from(self, than: ScoredModel) -> list[Values]:
        """Parameters that a further effect begins from: those of a model, first drawn back where they are bent.

        Where they are so far off that a further effect is likelier, those that are given, too: what the bent ones make
        up for is seen from there, and from a part of the way something else may look like it.
        """
        drawn = [drawn_back(than.fit, SEARCH.drawn)] if than.bent else []
        given: list[Values] = [{}] if strained(than, self.known.tried) else []
        return [*drawn, *given, standing(than.fit)]

    def _origins(self, kept: tuple[Candidate, ...], than: ScoredModel, parents: Sequence[Values]) -> list[Origin]:
        """Where effects are screened beside others, if there are tangents: at a model's parents before the last.

        That is where it ended. Effects are screened there only if it is the only one, or no other has tangents: with
        parameters that are not its own a model may run away.
        """
        near = self.fitter.near(than)
        found = [o for o in (near.origin(kept, values) for values in parents[:-1] or parents) if o is not None]
        last = near.origin(kept, parents[-1])
        return found or ([last] if last is not None else [])

    def _pays(self, origins: Sequence[Origin], effect: Candidate) -> bool:
        """Whether an effect promises to raise the likelihood by more than it costs, at any of the origins."""
        cost = price(self.known.refit.own) if effect.freed else self.known.price
        return max(self._gains(origins, effect), default=-math.inf) > cost

    def _gains(self, origins: Sequence[Origin], effect: Candidate) -> list[float]:
        """How much an effect promises to raise the likelihood at each of the origins."""
        return [max((c.likelihood for c in courses(o, effect)), default=-math.inf) - o.likelihood for o in origins]

    def _screened(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[Candidate]:
        """Effects, in each way to put them in, those that promise most first."""
        first, later = spoken_for(able)
        promise = dict(zip(map(id, first), self._promises(origins, first), strict=True))
        cuts = [cut(c) for c in ranked(first, promise) if cut(c) in later][: SEARCH.cuts]
        waiting = [c for place in cuts for c in later[place]]
        promise |= dict(zip(map(id, waiting), self._promises(origins, waiting), strict=True))
        ways = [*first, *waiting]
        went = {c.key for c in ways if max(promise[id(c)], default=-math.inf) > -math.inf}
        self._note_refused(origins, [c for c in ways if c.key not in went])
        return ranked(ways, promise)

    def _note_refused(self, origins: Sequence[Origin], effects: Sequence[Candidate]) -> None:
        """Note why effects that go in no way into the user's model were refused, in their order: threads keep none."""
        whys: dict[str, str] = {}
        for c in effects:
            for why in (o.refused.get((c.key, c.option)) for o in origins if not o.effects):
                if why is not None:
                    whys.setdefault(c.key, why)
        self.known.failures += [pair for pair in whys.items() if pair not in self.known.failures]

    def _promises(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[list[float]]:
        """What each effect promises to gain at each of the origins."""
        found = []
        with counted() as work, Spread(self.fitter.workers, threads=True) as pool:
            for done, gains in enumerate(pool.map(lambda effect: self._gains(origins, effect), able), 1):
                found.append(gains)
                if self.progress:
                    self.progress("looking at effects", done, len(able))
        self.fitter.spent.work.add(work.done + SEARCH.look * len(able))
        return found

    def _pairs(self, most: int, than: ScoredModel | None = None) -> None:
        """Two effects at once, where they promise most together; so many pairs at most.

        Args:
            most: number of pairs.
            than: model that they are to promise to better; none, if all are to be fitted.
        """
        parents = [standing(self.known.refit.fit), {}]
        pairs = self._promised_pairs(self.fitter, parents[0], most, than)
        self.known.fit([(pair, parents) for pair in pairs], SEARCH.few)

    def _pairs_of_beginnings(self, than: ScoredModel) -> None:
        """Two effects at once, where they promise most together over the beginnings of the recordings.

        What a machine that sticks, or bounces, does next hangs on where it is: over whole recordings no tangent tells
        what effects would explain, and a fit ends in a hollow. So the pairs are fitted to the beginnings, and the best
        of them to whole recordings, from there, if they do better over the beginnings than what leads does.

        Args:
            than: model that they are to better over the beginnings.
        """
        if self.fitter.tables:
            return
        early = self.fitter.early
        parents = [standing(early.refit.fit)]
        pairs = [self._with_all_orders(c) for c in self._promised_pairs(early, parents[0], SEARCH.few, than)]
        known = TriedModels(early, early.refit, self.known.tried, self.progress)
        known.fit([(pair, parents) for pair in pairs], len(pairs))
        if pairs and than.effects:
            known.fit([(_as_ended(than), [standing(than.fit)])], 1, whole=True)
        least = known.worth(known[than.keys]) if than.keys in known else -math.inf
        for m in [m for m in known.foremost() if known.worth(m) > least][: SEARCH.few]:
            self.fit_known([m])
            if self.known.best.keys != m.keys:  # the order of a wave may be another one
                self.known.fit([(self._with_all_orders(_as_ended(m)), [standing(m.fit)])], 1, whole=True)

    def _promised_pairs(
        self, fitter: CandidateFitter, values: Values, most: int, than: ScoredModel | None
    ) -> list[tuple[Candidate, ...]]:
        """The pairs that promise most beside the user's model, with some parameters; other arguments as of `_pairs`.

        Those with an effect that leads alone, or with a law that is part of it or the other way round, are left to the
        extension of that, unless its parameters are far off: then the two begin together, from where it has not ended.
        """
        origin = fitter.origin((), values)
        if origin is None or fitter.tables:
            return []
        found = [course for c in self._looked_at for course in courses(origin, c)[: SEARCH.sizes]]
        best = self.known.best
        alone = best.effects if len(best.effects) == 1 and not strained(best, self.known.tried) else ()
        among = together(found, origin, most, fitter.likelier(than) if than is not None else -math.inf)
        return [pair for pair in among if not any(is_in(c, a) or is_in(a, c) for c in pair for a in alone)]

    def _with_all_orders(self, pair: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
        """A pair with its wave last, if there is one, to be tried in all orders: over a short way they are alike."""
        waves = {(c.key, c.option): c for c in self._looked_at if c.wave is not None}
        last = [c for c in pair if (c.key, c.option) in waves][-1:]
        return (*(c for c in pair if c not in last), *(waves[c.key, c.option] for c in last))


def _ratio(there: float, here: float) -> float:
    """How many times as large a size is at one place as at another; one where it is none."""
    return there / here if here and there / here > 0 else 1.0


def _grown_from(found: Sizes, richer: Candidate) -> tuple[Sizes, ...]:
    """The sizes that a richer law begins from, those of a simpler one as found; what is of their kind keeps its ratio.

    A static friction that is half as large again as the sliding one stays so, however large that was found to be.
    """
    kinds = {p.name: p.reference for p in richer.parameters}

    def grown(start: Sizes) -> Sizes:
        times = {kinds[k]: found[k] / v for k, v in start.items() if k in found and k in kinds and v}
        return {k: found.get(k, v * times.get(kinds.get(k, math.nan), 1.0)) for k, v in start.items()}

    return tuple({repr(sizes): sizes for sizes in map(grown, richer.starts)}.values())


def _is_moved(flanges: Collection[str], blocks: Collection[str]) -> bool:
    """Whether the flanges that are on another side are one, of one of some blocks."""
    return len(flanges) == 1 and all(flange.rpartition(".")[0] in blocks for flange in flanges)


def _as_ended(model: ScoredModel) -> tuple[Candidate, ...]:
    """The effects of a model, to start only from where its fit ended."""
    return tuple(ended(model, c) for c in model.effects)


def _able_beside(kept: Sequence[Candidate], among: Sequence[Candidate]) -> list[Candidate]:
    """Effects that can be put in beside others."""
    return [able for c in among if (able := beside(kept, c)) is not None]
