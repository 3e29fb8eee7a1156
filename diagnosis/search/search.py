"""The search for what is missing: from the user's model, effects are added, exchanged and removed while it pays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import OperatingScales, operating_scales
from diagnosis.recordings.types import Recorded
from diagnosis.search.equivalent_effects import lookalikes
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.nonparametric import laws
from diagnosis.search.partial_fit import PartialFit, drawn_back, ended, standing
from diagnosis.search.posterior import complete, energy, is_in, misses, price, probabilities, strained, told_as, value
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import Origin, courses, together
from diagnosis.search.study import Study
from diagnosis.thresholds import SEARCH
from engine.errors import FlexarmError
from engine.spread import Spread
from scenarios.variant import edited

Progress = Callable[[str, int, int], None]
Values = dict[str, float]


def study(
    fitter: CandidateFitter,
    *,
    most: int = SEARCH.most,
    without: Sequence[str] = (),
    progress: Progress | None = None,
    told: Sequence[str] = (),
    known: Sequence[ScoredModel] = (),
) -> Study:
    """Refit the model, search for the effects that it lacks, and say how probable each is.

    Args:
        fitter: the user's model and the recordings, training and held-out, and where they are fitted.
        most: largest number of effects.
        without: effects that are not to be tried.
        progress: told what is done, how many of how many.
        told: what was done differently from what was asked, before.
        known: models that were found with other recordings, which are fitted to these too.
    """
    if progress:
        progress("fitting the model's own parameters", 0, 1)
    refit = fitter.refit
    base = fitter.base
    zero = np.zeros(len(base.free))
    before = (base.chi2(zero, base.training), base.chi2(zero, base.held_out))
    scales = operating_scales(base)
    scales.lines, scales.refitted = lines(refit), refit.fit.x
    search = _Search(fitter, refit, candidates(scales, without), progress)
    search.fit_known(known)
    search.run(most)
    best = search.best
    swapped = None if told or fitter.tables else exchanged(fitter, best, search.price)
    if swapped:
        return study(
            fitter.again(swapped[0]),
            most=most,
            without=without,
            progress=progress,
            told=[swapped[1]],
            known=sorted((m for m in search.models if m.effects), key=search.worth, reverse=True)[: SEARCH.finished],
        )
    found = search.study(before, scales, told)
    return search.study(before, scales, told) if search.add_curves(found) else found


class _Search:
    """The models that were fitted so far, and the moves from one to the next.

    Args:
        fitter: fits them.
        refit: the user's model, fitted.
        listed: effects at places.
        progress: told what is done.
    """

    def __init__(
        self, fitter: CandidateFitter, refit: ScoredModel, listed: Sequence[Candidate], progress: Progress | None
    ) -> None:
        self.fitter, self.refit, self.listed, self.progress = fitter, refit, list(listed), progress
        self.tried = sum(1 for c in self.listed if not c.freed)
        self.price = price(self.tried)
        self.failures: list[tuple[str, str]] = []
        self._models: dict[frozenset[str], ScoredModel] = {refit.keys: refit}
        self._done: set[tuple[str, ...]] = set()
        self._order: list[Candidate] = []
        self._ended: set[frozenset[str]] = set()
        self._repeated: set[frozenset[str]] = set()
        self._waiting: list[PartialFit] = []
        self._seen: list[Candidate] = []
        """Effects that were looked at beside the user's model alone."""

    @property
    def models(self) -> list[ScoredModel]:
        """All that were fitted to the end."""
        return list(self._models.values())

    @property
    def best(self) -> ScoredModel:
        """What the model of greatest worth is told as."""
        return max(told_as(self.models, self.refit), key=lambda pair: self.worth(pair[1]))[0]

    def worth(self, model: ScoredModel) -> float:
        """Evidence less price."""
        return value(model, self.tried)

    def run(self, most: int) -> None:
        """Add effects one by one, from the best few models, while even a perfect further effect would pay."""
        self._grow(most)
        for model in sorted(self.models, key=self.worth, reverse=True)[: SEARCH.settled]:
            self._settled(model)
        self._confirmed(self.best)
        before = None
        while before is not self.best:
            before = self.best
            self._simplified(before)
        self._evened()

    def fit_known(self, models: Sequence[ScoredModel]) -> None:
        """Fit models that were found with other recordings, from where they ended there."""
        tasks = [(tuple(ended(m, c) for c in m.effects), [standing(m.fit)]) for m in models]
        self._fit(tasks, len(tasks))

    def _simplified(self, model: ScoredModel) -> None:
        """Take each effect of a model away, or put a simpler law in its place, from where it ended, and try it again.

        Where a machine sticks, its answer jumps with every parameter, and the fit of a simple law may end at a jump
        that a richer law has passed by.
        """
        values = model.fit.parameters()
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            if kept and frozenset(c.key for c in kept) not in self._models:
                self._fit([(kept, [standing(model.fit)])], 1)
            simpler = [c for c in self.listed if c.place == effect.place and c.key != effect.key and is_in(c, effect)]
            begun = [
                replace(c, starts=({k: values.get(f"{effect.name}.{k}", v) for k, v in c.starts[0].items()},))
                for c in simpler
            ]
            for made in self._fit([((*kept, c), [standing(model.fit)]) for c in begun], len(begun)):
                if self.worth(self._models[made.keys]) < self.worth(model):
                    self._keep(self.fitter.retried(made))

    def _evened(self) -> None:
        """Put nuisances that fit beside the best model in beside its rivals too, so that like compares with like."""
        best, whole = max(told_as(self.models, self.refit), key=lambda pair: self.worth(pair[1]))
        if not best.keys < whole.keys:
            return
        nuisances = tuple(ended(whole, c) for c in whole.effects if c.key not in best.keys)
        near = self.worth(best) - self.price - SEARCH.effort
        rivals = {m.keys: m for m, _ in told_as(self.models, self.refit) if m.effects and self.worth(m) > near}
        tasks = [
            ((*(ended(m, c) for c in m.effects), *nuisances), [standing(m.fit)])
            for m in rivals.values()
            if m is not best
            and len(m.effects) + len(nuisances) <= SEARCH.most
            and not m.keys & {c.key for c in nuisances}
        ]
        self._fit(tasks, len(tasks))

    def _enriched(self, model: ScoredModel) -> None:
        """Put each richer law that was not tried in the place of a simpler one of a model, from where that ended."""
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            found = ended(model, effect).starts[0]
            richer = [
                replace(c, starts=tuple({k: found.get(k, v) for k, v in start.items()} for start in c.starts))
                for c in self.listed
                if (c.place, c.option) == (effect.place, effect.option) and c.key != effect.key and is_in(effect, c)
            ]
            new = [c for c in richer if frozenset(k.key for k in (*kept, c)) not in self._models]
            self._fit([((*kept, c), [standing(model.fit)]) for c in new], len(new))

    def _grow(self, most: int) -> None:
        for count in range(1, most + 1):
            before = self.best if count == 1 else self._confirmed(self.best)
            done = complete(before, self.refit)
            enough = done and not misses(before.unseen) and not strained(before, self.tried)
            if enough or before.room < self.price + SEARCH.effort:
                return
            if count > 1 and not before.effects and not misses(self.refit.left):
                return
            if count > 1 and before.effects and (done or before.left.varying < self.price + SEARCH.effort):
                # What is as strong whatever moves is a sensor's coloured noise, or one effect more, as a vibration is;
                # what is little beside the effects that are in is a nuisance, or one weak effect more.
                kept = tuple(ended(before, c) for c in before.effects)
                self._beside(kept, before, SEARCH.fitted_beside, self.listed if done else self._order[: SEARCH.beside])
            elif count == 1:
                self._first([standing(self.refit.fit), *([{}] if self.refit.bent else [])])
            else:
                self._deepen(count)
            self._vary(self.best)
            if count > 1 and self.best.keys == before.keys:
                return

    def study(self, nominal: tuple[float, float], scales: OperatingScales, notes: Sequence[str]) -> Study:
        """What was tried so far, and how probable it is; arguments as of `Study`."""
        odds = probabilities(told_as(self.models, self.refit), self.tried)
        trials = [m for m in self.models if m.effects]
        trials.sort(key=lambda m: (-odds.get(m.keys, 0.0), -self.worth(m)))
        return Study(
            self.fitter.scenario,
            self.fitter.recordings,
            nominal,
            self.refit,
            tuple(trials),
            max((m for m in self.models if m.keys in odds), key=lambda m: odds[m.keys]),
            odds,
            self.tried,
            scales,
            tuple(self.failures),
            tuple(notes),
        )

    def add_curves(self, found: Study) -> bool:
        """Nonparametric laws where the best model leaves much; whether one does better than all that have a name."""
        if self.fitter.tables or complete(found.chosen, self.refit) or not misses(found.chosen.unseen):
            return False
        curves = [(c,) for c in laws(replace(found, chosen=self.refit))]
        named = dict(self._models)
        self._fit([(c, [standing(self.refit.fit), {}]) for c in curves], len(curves))
        if any(c.effect == "unknown" for c in self._confirmed(self.best).effects):
            return True
        self._models = named
        return False

    def _settled(self, model: ScoredModel) -> ScoredModel:
        """A model whose fit was left early, fitted to the end."""
        if not model.fit.converged and model.keys not in self._ended:
            self._ended.add(model.keys)
            self._models[model.keys] = self.fitter.settled(model)
            if not model.effects:
                self.refit = self._models[model.keys]
        return self._models[model.keys]

    def _confirmed(self, model: ScoredModel) -> ScoredModel:
        """A model fitted to the end, and tried again from around there if that may not be where it fits best.

        That is so if it has not converged, or misses held-out recordings although it leaves too little for a further
        effect: contacts that bounce make a cost with many low points.
        """
        model = self._settled(model)
        doubtful = not model.fit.converged or (complete(model, self.refit) and misses(model.unseen))
        if model.effects and doubtful and model.keys not in self._repeated:
            self._repeated.add(model.keys)
            made = self.fitter.retried(model)
            if self.worth(made) > self.worth(model) or not model.fit.converged:
                self._models[model.keys] = made
        return self._models[model.keys]

    def _deepen(self, count: int) -> None:
        """Add an effect to each of the best models that have one less, and try two at once."""
        if count == 2:
            waiting, self._waiting = self._waiting, []
            while waiting:
                self._finished(waiting[: SEARCH.few])
                waiting = waiting[SEARCH.few :]
            self._pairs()
        for number, parent in enumerate(self._parents(count - 1)):
            kept = tuple(ended(parent, c) for c in parent.effects)
            # What promised little beside the user's model may promise most beside the best one.
            among = self.listed if count == 2 and number == 0 else self._order[: SEARCH.beside]
            self._beside(kept, parent, SEARCH.fitted_beside, among)

    def _parents(self, count: int) -> list[ScoredModel]:
        """The models of a number of effects that are worth most and those that leave least, each with its own effects.

        Beside another effect that is still missing, evidence alone prefers what acts at many frequencies.
        """
        able = [m for m in self.models if len(m.effects) == count]
        ranked = zip(sorted(able, key=self.worth, reverse=True), sorted(able, key=energy), strict=True)
        found: dict[frozenset[str], ScoredModel] = {}
        for pair in ranked:
            for model in pair:
                found.setdefault(frozenset(c.effect for c in model.effects), model)
        return list(found.values())[: SEARCH.beam]

    def _vary(self, model: ScoredModel) -> None:
        """Take each effect of a model away; put it elsewhere, others in its place, a known pair in the place of one."""
        alike = [p for p in self._waiting if _related(p.effects[-1], model.effects)]
        self._waiting = [p for p in self._waiting if not _related(p.effects[-1], model.effects)]
        for few in range(0, len(alike), SEARCH.few):
            self._finished(alike[few : few + SEARCH.few])
        singles = sorted((m for m in self.models if len(m.effects) == 1), key=self.worth, reverse=True)
        best = [*(m.effects[0] for m in singles), *self._order]
        pairs = [c for c in lookalikes(model, best) if len(c) <= SEARCH.most]
        self._fit([(c, [standing(model.fit)]) for c in pairs], len(pairs))
        self._enriched(model)
        if len(model.effects) < 2:
            return
        for effect in model.effects:
            kept = tuple(ended(model, c) for c in model.effects if c is not effect)
            self._fit([(kept, [standing(model.fit)])], 1)
            self._beside_in_every_way(kept, model, effect)
            related = [c for c in self.listed if _related(c, [effect])]
            among = list({id(c): c for c in [*related, *self._order[: SEARCH.exchanged]]}.values())
            self._beside(kept, model, SEARCH.exchanged, among)

    def _first(self, parents: Sequence[Values]) -> None:
        """Put every effect into the user's model, and fit those that promise most.

        Args:
            parents: parameters to begin from.
        """
        origins = [o for values in parents if (o := self.fitter.origin((), values)) is not None]
        self._order = _best_ways(self._screened(origins, self.listed))
        able = [c for c in self._order if self._pays(origins, c)]
        # A wrong parameter is as likely as a missing effect: neither kind is to crowd out the other.
        for kind in ([c for c in able if not c.freed], [c for c in able if c.freed]):
            self._fit([((c,), parents) for c in kind[: SEARCH.fitted]], SEARCH.finished)

    def _beside(
        self,
        kept: tuple[Candidate, ...],
        than: ScoredModel,
        most: int,
        among: Sequence[Candidate],
    ) -> None:
        """Put effects in beside others, and fit those that promise most, a few at a time.

        Where those few gain nothing, what promises less is left: little is left over that an effect could explain. None
        is left for its promise alone, since what is still missing has bent the sizes of those that are in.

        Args:
            kept: effects that stay, each at the one size that it starts from.
            than: the model that is to be bettered, whose parameters are begun from; where they are bent to make up for
                what is missing, drawn back as well, and effects are looked at from there.
            most: number of models that are fitted.
            among: effects to put in.
        """
        parents = _begun_from(than)
        ranked = self._screened(self._origins(kept, parents), _able_beside(kept, among))
        able = _best_ways(ranked)[:most]
        for few in range(0, len(able), SEARCH.few):
            found = self._fit([((*kept, c), parents) for c in able[few : few + SEARCH.few]], 1)
            if found and all(self.worth(m) < self.worth(than) for m in found):
                break
        self.fitter.forget(kept)

    def _beside_in_every_way(self, kept: tuple[Candidate, ...], than: ScoredModel, effect: Candidate) -> None:
        """Put an effect in beside others at all its places, in every way: sides of a cut, orders of a wave.

        Neither what they promise nor a few steps tell them apart: many are fitted, and the best few to the end.

        Args:
            kept: effects that stay, each at the one size that it starts from.
            than: the model that has all of them, whose parameters are begun from.
            effect: which.
        """
        parents = _begun_from(than)
        ways = [way for c in self.listed if c.effect == effect.effect for way in c.choices()]
        ranked = self._screened(self._origins(kept, parents), _able_beside(kept, ways))
        self._fit([((*kept, c), parents) for c in ranked[: SEARCH.fitted]], SEARCH.few)
        self.fitter.forget(kept)

    def _origins(self, kept: tuple[Candidate, ...], parents: Sequence[Values]) -> list[Origin]:
        """Where effects are screened beside others: at the first of the parents, if there are tangents."""
        return [o for o in [self.fitter.origin(kept, parents[0])] if o is not None]

    def _pays(self, origins: Sequence[Origin], effect: Candidate) -> bool:
        """Whether an effect promises to raise the likelihood by more than it costs."""
        found = [course.likelihood for origin in origins for course in courses(self.fitter, origin, effect)]
        cost = price(self.refit.own) if effect.freed else self.price
        return max(found, default=-math.inf) > origins[0].likelihood + cost

    def _screened(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[Candidate]:
        """Effects, in each way to put them in, those that promise most first."""
        first, later = _spoken_for(able)
        promise = dict(zip(map(id, first), self._promises(origins, first), strict=True))
        cuts = [_cut(c) for c in _ranked(first, promise) if _cut(c) in later][: SEARCH.cuts]
        waiting = [c for cut in cuts for c in later[cut]]
        promise |= dict(zip(map(id, waiting), self._promises(origins, waiting), strict=True))
        self._seen = self._seen or [*first, *waiting]
        whys = {key: why for origin in origins if not origin.effects for key, why in origin.refused.items()}
        self.failures += [pair for pair in whys.items() if pair not in self.failures]
        return _ranked([*first, *waiting], promise)

    def _promises(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[float]:
        """The greatest likelihood that each effect promises."""

        def one(effect: Candidate) -> float:
            found = [course.likelihood for o in origins for course in courses(self.fitter, o, effect)]
            return max(found, default=-math.inf)

        found = []
        with Spread(self.fitter.workers, threads=True) as pool:
            for done, left in enumerate(pool.map(one, able), 1):
                found.append(left)
                if self.progress:
                    self.progress("looking at effects", done, len(able))
        return found

    def _pairs(self) -> None:
        """Two effects at once, where they promise most together."""
        origin = self.fitter.origin((), standing(self.refit.fit))
        if origin is None or self.fitter.tables:
            return
        found = [
            course for c in self._seen if not c.freed for course in courses(self.fitter, origin, c)[: SEARCH.sizes]
        ]
        pairs = together(found, origin, SEARCH.fitted)
        self._fit([(pair, [standing(self.refit.fit), {}]) for pair in pairs], SEARCH.few)

    def _fit(self, wanted: Iterable[tuple[tuple[Candidate, ...], Sequence[Values]]], finish: int) -> list[ScoredModel]:
        """Fit models a few steps, and those of the lowest cost to the end, which are given."""
        tasks = []
        for effects, parents in wanted:
            mark = tuple(sorted(f"{c.key} {c.option} {c.starts}" for c in effects))
            if mark not in self._done:
                self._done.add(mark)
                tasks.append((effects, parents))

        def begin(task: tuple[tuple[Candidate, ...], Sequence[Values]]) -> PartialFit | tuple[str, str]:
            try:
                return self.fitter.partial_fit(*task)
            except FlexarmError as error:
                return task[0][-1].key, error.message

        with Spread(self.fitter.workers, threads=True) as pool:
            partials = []
            for done, found in enumerate(pool.map(begin, tasks), 1):
                if isinstance(found, PartialFit):
                    partials.append(found)
                else:
                    self.failures.append(found)
                if self.progress:
                    self.progress("trying effects", done, len(tasks))
        return self._finished(self._able(partials)[:finish])

    def _finished(self, partials: Sequence[PartialFit]) -> list[ScoredModel]:
        """Models fitted to the end, a few at a time, while one of the few comes near the best; others wait.

        Beside a second effect what was far from the best may be part of the truth; and what is related to the best, as
        a simpler law at its place is, does not wait.
        """

        def finish(partial: PartialFit) -> ScoredModel | tuple[str, str]:
            try:
                return self.fitter.finish(partial)
            except FlexarmError as error:
                return partial.effects[-1].key, error.message

        kept: list[ScoredModel] = []
        for few in range(0, len(partials), SEARCH.few):
            with Spread(self.fitter.workers, threads=True) as pool:
                found = list(pool.map(finish, partials[few : few + SEARCH.few]))
            self.failures += [why for why in found if isinstance(why, tuple)]
            able = [made for made in found if not isinstance(made, tuple) and self._has_meaning(made)]
            for made in able:
                self._keep(made)
            kept += able
            near = self.worth(self.best) - self.price - SEARCH.effort
            if not any(self.worth(made) > near and made.keys != self.best.keys for made in able):
                self._waiting += partials[few + SEARCH.few :]
                break
        return kept

    def _has_meaning(self, made: ScoredModel) -> bool:
        """Whether blocks take the sizes at which a fit ended: it moves them without asking again."""
        there = [ended(made, c) for c in made.effects]
        try:
            edited(self.fitter.scenario, [edit for c in there for edit in c.edits(c.starts[0])])
        except FlexarmError as error:
            self.failures.append((made.effects[-1].key, error.message))
            return False
        return True

    def _able(self, partials: Sequence[PartialFit]) -> list[PartialFit]:
        """Partial fits, those first that leave least, as of white noise and as of coloured noise by turns."""

        def coloured(partial: PartialFit) -> float:
            made = partial.point.problem
            return made.cost(partial.point.x, made.training)

        orders = (sorted(partials, key=lambda partial: partial.point.cost), sorted(partials, key=coloured))
        found = {id(p): p for both in zip(*orders, strict=True) for p in both}
        return list(found.values())

    def _keep(self, made: ScoredModel) -> None:
        known = self._models.get(made.keys)
        if known is None or self.worth(made) > self.worth(known):
            self._models[made.keys] = made


def _begun_from(than: ScoredModel) -> list[Values]:
    """Parameters that a further effect begins from: those of a model, first drawn back where they are bent."""
    return [drawn_back(than.fit, SEARCH.drawn), standing(than.fit)] if than.bent else [standing(than.fit)]


def _able_beside(kept: Sequence[Candidate], among: Sequence[Candidate]) -> list[Candidate]:
    """Effects that can be put in beside others."""
    names, blocks = {c.key for c in kept}, {c.name for c in kept}
    return [c for c in among if c.key not in names and c.name not in blocks]


def _best_ways(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Of several ways to put an effect in at a place, the first."""
    found: dict[str, Candidate] = {}
    for c in ranked:
        found.setdefault(c.key, c)
    return list(found.values())


def _related(effect: Candidate, others: Sequence[Candidate]) -> bool:
    """Whether an effect acts at the place of one of the others, or is the same elsewhere."""
    return any(effect.place == c.place or effect.effect == c.effect for c in others)


def _cut(effect: Candidate) -> tuple[str, str]:
    """Where an effect sits, and how it is put in there."""
    return effect.place, effect.option


def _spoken_for(able: Sequence[Candidate]) -> tuple[list[Candidate], dict[tuple[str, str], list[Candidate]]]:
    """The effects to look at first, and by their cut those that wait for what another law promises there.

    A node of many flanges can be cut in tens of ways, for each law of a joint: the law with the fewest sizes speaks for
    the others, since what lies on either side matters more.
    """
    laws: dict[tuple[str, str], list[Candidate]] = {}
    for c in able:
        if c.option:
            laws.setdefault(_cut(c), []).append(c)
    first = [c for c in able if not c.option]
    for cut, there in laws.items():
        spokesman = min(there, key=lambda c: len(c.starts))
        first.append(spokesman)
        laws[cut] = [c for c in there if c is not spokesman]
    return first, laws


def _ranked(able: Sequence[Candidate], promise: dict[int, float]) -> list[Candidate]:
    """Effects that can be put in, those that promise most first."""
    found = sorted(able, key=lambda c: -promise[id(c)])
    return [c for c in found if promise[id(c)] > -math.inf]


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


def lines(refit: ScoredModel) -> list[float]:
    """Frequencies (rad/s) that stand out in what the refitted model leaves over of the training recordings."""
    problem, found = refit.fit.problem, dict[float, float]()
    for e in problem.training:
        found |= e.lines(problem.residual(refit.fit.x, e), SEARCH.lines)
    return sorted(found, key=lambda w: -found[w])[: SEARCH.lines]
