"""Effects that are put in beside others: they are screened there, and those that promise most are fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from diagnosis.effects.effect import Candidate, able_beside
from diagnosis.search.board import Board
from diagnosis.search.partial_fit import as_ended, drawn_back, ended, others_as_ended, standing
from diagnosis.search.posterior import strained
from diagnosis.search.promises import Promises
from diagnosis.search.ranking import best_ways, by_turns
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.tried_models import Values
from diagnosis.thresholds import SEARCH


class Placing:
    """Puts effects in beside others.

    Args:
        board: what the search has before it.
        promises: what effects promise.
    """

    def __init__(self, board: Board, promises: Promises) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        self.promises = promises
        self._extended: list[ScoredModel] = []
        """Models that were extended."""

    def extend(self, parent: ScoredModel, among: Sequence[Candidate]) -> None:
        """Add one of some effects to a model, or one that only shows in what this model leaves over.

        A vibration's frequency or a cogging's order is hidden as long as something larger is missing, and what acts on
        the other side of a joint is one with what acts on this side as long as the joint is.
        """
        if any(parent is model for model in self._extended):
            return
        self._extended.append(parent)
        anew, new = self.board.list_beside(parent)
        among = [*(anew.get((c.key, c.option), c) for c in among), *new]
        kept = as_ended(parent)
        self.beside(kept, parent, SEARCH.fitted_beside, among)

    def beside(
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
        parents = self.begun_from(than)
        keys = frozenset(c.key for c in kept)
        others = [c for c in among if not self.board.as_close(keys | {c.key}, than)]
        ways = best_ways(self._screened_beside(kept, than, parents, others))
        able = by_turns(ways[:most], lambda c: c.place)
        for few in range(0, len(able), SEARCH.few):
            tasks = [((*kept, c), parents) for c in able[few : few + SEARCH.few]]
            found = self.known.fit(tasks, 1, near=than)
            least = max(self.known.worth(than), self.known.reach) if than.keys <= keys else self.known.reach
            if found and all(self.known.worth(m) < least for m in found):
                break
        self.fitter.forget()

    def beside_in_every_way(self, kept: tuple[Candidate, ...], than: ScoredModel, effect: Candidate) -> None:
        """Put an effect in beside others at all its places, in every way: sides of a cut, orders of a wave.

        Neither what they promise nor a few steps tell them apart: many are fitted, and the best few to the end. They
        begin from the sizes that it has, too: behind a gear these are the same but for its ratio, and where contacts
        bounce no other start may lead there.

        Args:
            kept: effects that stay, each at the one size that it starts from.
            than: the model that has all of them, whose parameters are begun from.
            effect: which.
        """
        parents = self.begun_from(than)
        found = ended(than, effect).starts[0]
        same = [c for c in self.board.listed if c.effect == effect.effect]
        alike = [replace(c, starts=(*c.starts, found)) if c.starts[0].keys() == found.keys() else c for c in same]
        ways = [way for c in alike for way in c.choices()]
        able = self._screened_beside(kept, than, parents, ways)
        self.known.fit([((*kept, c), parents) for c in able[: SEARCH.fitted]], SEARCH.few, near=than)
        self.fitter.forget()

    def _screened_beside(
        self,
        kept: tuple[Candidate, ...],
        than: ScoredModel,
        parents: Sequence[Values],
        among: Sequence[Candidate],
    ) -> list[Candidate]:
        """Effects that may come near the best model beside others, those that promise most first; as of `beside`."""
        origins, keys = self.promises.origins(kept, than, parents), frozenset(c.key for c in kept)
        ways = self.promises.screened(origins, able_beside(kept, among))
        if keys not in self.known:
            return ways
        wanting = self.known.reach - self.known.worth(self.known[keys])
        return [c for c in ways if SEARCH.promised * max(self.promises.gains(origins, c), default=math.inf) > wanting]

    def begun_from(self, than: ScoredModel) -> list[Values]:
        """Parameters that a further effect begins from: those of a model, first drawn back where they are bent.

        Where they are so far off that a further effect is likelier, those that are given, too: what the bent ones make
        up for is seen from there, and from a part of the way something else may look like it.
        """
        drawn = [drawn_back(than.fit, SEARCH.drawn)] if than.bent else []
        given: list[Values] = [{}] if strained(than, self.known.tried) else []
        return [*drawn, *given, standing(than.fit)]

    def alone_from(self) -> list[Values]:
        """Parameters that a first effect begins from: those of the refit, and those given where it has bent any.

        Of a friction that the refit has nearly taken away, little can fall: what changes a parameter is seen from its
        value.
        """
        refit = self.known.refit
        return [standing(refit.fit), *([{}] if refit.bent or refit.far_off else [])]

    def fit_known(self, models: Sequence[ScoredModel]) -> None:
        """Fit models that were found with other recordings, from where they ended there, each to its end.

        A fit may end at a size that is faster than one may begin from. Then each effect begins anew beside the others.
        """
        for m in models:
            self.known.fit([(as_ended(m), [standing(m.fit)])], 1, whole=True)
            if m.keys not in self.known:
                tasks: list[tuple[tuple[Candidate, ...], list[Values]]] = []
                for effect in m.effects:
                    kept = others_as_ended(m, effect)
                    same = [c for c in self.board.listed if (c.key, c.option) == (effect.key, effect.option)]
                    tasks += [((*kept, c), [standing(m.fit)]) for c in able_beside(kept, same)]
                self.known.fit(tasks, 1, whole=True)
