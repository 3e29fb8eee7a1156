"""What leads is varied: other effects in the place of each of its own, and the same ones elsewhere or cut otherwise."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from diagnosis.effects.effect import Candidate, able_beside, across, all_beside, cuts
from diagnosis.search.board import Board
from diagnosis.search.equivalent_effects import lookalikes
from diagnosis.search.laws import Laws
from diagnosis.search.partial_fit import ended, others_as_ended, standing
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import complete, prices
from diagnosis.search.promises import Promises
from diagnosis.search.ranking import best_ways, by_turns, related
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.tried_models import Values
from diagnosis.thresholds import SEARCH


class Varying:
    """Varies what leads.

    Args:
        board: what the search has before it.
        promises: what effects promise.
        placing: puts effects in beside others.
        laws: puts other laws in the place of those of a model.
    """

    def __init__(self, board: Board, promises: Promises, placing: Placing, laws: Laws) -> None:
        self.board, self.known = board, board.known
        self.promises, self.placing, self.laws = promises, placing, laws
        self._cut: list[ScoredModel] = []
        """Models whose nodes were cut otherwise."""
        self._done = set[frozenset[str]]()
        """Effects of the models that were varied, by key."""

    def vary(self) -> None:
        """Vary what leads, until nothing that is found so takes its place: what does was looked for beside another."""
        varied = set[frozenset[str]]()
        while (model := self.known.best).keys not in varied:
            varied.add(model.keys)
            self._done.add(model.keys)
            self._varied(model)

    def vary_what_is_new(self) -> None:
        """Vary what leads, unless it was: what took the lead last, such as by another cut, has had no rivals yet."""
        if self.known.best.keys not in self._done:
            self.vary()

    def _varied(self, model: ScoredModel) -> None:
        """Take each effect of a model away; put it elsewhere, others in its place, a known pair in the place of one."""
        alike = {c.key for effect in model.effects for c in self.board.mimics(effect)}
        self.known.finish_waiting(lambda p: p.effects[-1].key in alike or related(p.effects[-1], model.effects))
        self._finish_dropped(model, alike)
        singles = sorted((m for m in self.known.models if len(m.effects) == 1), key=self.known.worth, reverse=True)
        best = best_ways([*(m.effects[0] for m in singles), *self.board.order])
        pairs = [c for c in lookalikes(model, best) if prices(c) <= SEARCH.most]
        self.known.fit([(c, [standing(model.fit)]) for c in pairs], len(pairs), near=model)
        self.laws.enriched(model)
        self._moved(model)
        if len(model.effects) == 1 and complete(model, self.known.refit):
            self._elsewhere(model)
            self._put_in_place_of((), model, model.effects[0])
        if len(model.effects) < 2:
            return
        if cuts(model.effects):
            self.board.list_beside(model)
        for effect in model.effects:
            kept = others_as_ended(model, effect)
            self.known.fit([(kept, [standing(model.fit)])], 1, whole=True, near=model)
            self.placing.beside_in_every_way(kept, model, effect)
            self._put_in_place_of(kept, model, effect, best[: SEARCH.exchanged])
            if any(c.wave is not None for c in kept):
                self._beside_mimics(kept, model, effect)
        self.put_in_place_of_equals(model)

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
        akin = [*(c for c in self.board.listed if related(c, [effect])), *first]
        others = {id(c): c for c in akin if c.key != effect.key}
        self.placing.beside(kept, model, SEARCH.exchanged, list(others.values()))
        keys = frozenset(c.key for c in kept)
        wanted = [c for c in self.board.mimics(effect) if not self.board.as_close(keys | {c.key}, model)]
        tasks = [((*kept, c), self.placing.begun_from(model)) for c in able_beside(kept, wanted)]
        self.known.fit(tasks, len(tasks), near=model)

    def _beside_mimics(self, kept: tuple[Candidate, ...], than: ScoredModel, effect: Candidate) -> None:
        """Put in the place of an effect what changes the recordings nearly as it does, and choose a wave's order anew.

        The order was chosen beside the effect: gravity leaves another one for the ripple than an offset does.
        """
        pairs = [(*kept, c) for c in able_beside(kept, self.board.mimics(effect))]
        tasks = [(self.board.with_all_orders(pair), [standing(than.fit)]) for pair in pairs]
        self.known.fit(tasks, 1, near=than)

    def put_in_place_of_equals(self, model: ScoredModel) -> None:
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
                if both is not None and not self.board.as_close(frozenset(c.key for c in both), model):
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
        for few in range(0, len(akin), SEARCH.few):
            some = akin[few : few + SEARCH.few]
            self.known.dropped = [p for p in self.known.dropped if not any(p is other for other in some)]
            made = self.known.finished(some)
            if all(self.known.worth(m) < self.known.reach for m in made):
                return

    def _moved(self, model: ScoredModel) -> None:
        """Put each effect of a model elsewhere, with the sizes that it has anywhere, such as a vibration's frequency.

        A frequency is found only from near it, and the one that an effect was begun from may have been a resonance's.
        """
        for effect in model.effects:
            kept = others_as_ended(model, effect)
            found = ended(model, effect).starts[0]
            anywhere = {k.name: found[k.name] for k in effect.parameters if k.anywhere}
            same = [c for c in self.board.listed if c.effect == effect.effect and c.place != effect.place]
            able = able_beside(kept, same) if anywhere else []
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
        usual = next((c.starts[0] for c in self.board.listed if (c.key, c.option) == (effect.key, effect.option)), {})
        rivals = [
            replace(c, starts=({k: v * _ratio(c.starts[0][k], usual.get(k, 0.0)) for k, v in found.items()}, found))
            for c in self.board.listed
            if c.effect == effect.effect
            and not c.freed
            and frozenset({c.key}) not in self.known
            and c.starts[0].keys() == found.keys()
        ]
        parents = [standing(model.fit), standing(self.known.refit.fit)]
        able = by_turns(self.promises.screened(self.promises.origins((), model, parents), rivals), lambda c: c.place)
        self.known.fit([((c,), parents) for c in able[: SEARCH.fitted]], SEARCH.few, near=model)

    def cut_anew(self, model: ScoredModel) -> ScoredModel:
        """Cut nodes with blocks whose parameters are far off on the other side, one by one, while that helps.

        A node of many flanges can be cut in tens of ways, more than are fitted. A cut with a body on the wrong side
        does as well with its inertia and those of its neighbours bent, which tells what is to be moved: a block that
        is on the wrong side need not be bent as far as its neighbours. The best model then is given.
        """
        while model.far_off and not any(model is other for other in self._cut):
            self._cut.append(model)
            found, bent = [model], model.bent_blocks
            for effect in model.effects:
                kept = others_as_ended(model, effect)
                same = [c for c in self.board.listed if c.effect == effect.effect]
                near = [c for c in same if _is_moved(across(c, effect), bent)]
                anew = [replace(c, starts=ended(model, effect).starts) for c in near]
                tasks = [((*kept, c), self.placing.begun_from(model)) for c in able_beside(kept, anew)]
                found += self.known.fit(tasks, len(tasks), near=model)
            model = max(found, key=self.known.worth)
        return self.known.best


def _ratio(there: float, here: float) -> float:
    """How many times as large a size is at one place as at another; one where it is none."""
    return there / here if here and there / here > 0 else 1.0


def _is_moved(flanges: Collection[str], blocks: Collection[str]) -> bool:
    """Whether the flanges that are on another side are one, of one of some blocks."""
    return len(flanges) == 1 and all(flange.rpartition(".")[0] in blocks for flange in flanges)
