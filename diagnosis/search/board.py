"""What a search has before it: the models that were fitted, the effects to choose from, and what was seen of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from diagnosis.effects.effect import Candidate, cuts
from diagnosis.search.allowance import OutOfTime
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.posterior import explained
from diagnosis.search.ranking import best_ways, by_turns
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import Course, courses, likeness
from diagnosis.search.study import Looked
from diagnosis.search.tried_models import Progress, TriedModels
from diagnosis.thresholds import EVIDENCE, SEARCH


class Board:
    """All that the moves of a search share, and what many of them ask.

    Args:
        fitter: fits models.
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

    @property
    def order(self) -> list[Candidate]:
        """Effects that were looked at beside the user's model alone, those first that promised most."""
        return best_ways(self.looked.order) if self.looked else []

    @property
    def explains_most(self) -> bool:
        """Whether the best model explains as much as a verdict asks of what has a name."""
        return explained(self.known.refit, self.known.best) >= EVIDENCE.most

    @property
    def looked_at(self) -> list[Candidate]:
        """Effects, but for freed parameters, that were looked at beside the user's model alone."""
        return [c for c in self.looked.order if not c.freed] if self.looked else []

    def answers(self, effect: Candidate) -> list[Course]:
        """What an effect changes of the recordings beside the user's model alone, put in in every way."""
        origin = self.looked.origin if self.looked else None
        if origin is None:
            return []
        return [course for c in self.looked_at if c.key == effect.key for course in courses(origin, c)]

    def mimics(self, effect: Candidate) -> list[Candidate]:
        """Effects that change the recordings nearly as one does beside the user's model alone, each kind by turns.

        However little they promised there, where something stronger was missing: a delay in front of the motor is a
        sensor's lag to whatever answers in proportion.
        """
        origin = self.looked.origin if self.looked else None
        if origin is None:
            return []
        mine = self.answers(effect)
        likest = {id(c): likeness(courses(origin, c), mine) for c in self.looked_at if c.key != effect.key}
        near = [c for c in self.looked_at if likest.get(id(c), 0.0) > SEARCH.likest]
        by_likeness = best_ways(sorted(near, key=lambda c: -likest[id(c)]))
        return by_turns(by_likeness, lambda c: c.effect)[: SEARCH.exchanged]

    def as_close(self, keys: frozenset[str], model: ScoredModel) -> bool:
        """Whether a model with these effects was fitted, as closely as another one but for what is no evidence."""
        return keys in self.known and 0.5 * (self.known[keys].fit.cost - model.fit.cost) < SEARCH.effort

    def with_all_orders(self, pair: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
        """A pair with its wave last, if there is one, to be tried in all orders: over a short way they are alike."""
        waves = {(c.key, c.option): c for c in self.looked_at if c.wave is not None}
        last = [c for c in pair if (c.key, c.option) in waves][-1:]
        return (*(c for c in pair if c not in last), *(waves[c.key, c.option] for c in last))

    def list_beside(self, model: ScoredModel) -> tuple[dict[tuple[str, str], Candidate], list[Candidate]]:
        """List effects anew beside a model: they are given by key and option, and those that were not listed before."""
        beyond, listed = cuts(model.effects), self._list(model) if self._list is not None else []
        rows = [c if c.key in self._plain else replace(c, beyond=beyond) for c in listed]
        anew, known = {(c.key, c.option): c for c in rows}, {(c.key, c.option) for c in self.listed}
        new = [c for c in rows if (c.key, c.option) not in known]
        self.listed = [anew.get((c.key, c.option), c) if c.beyond else c for c in self.listed] + new
        return anew, new

    def within(self, share: float, move: Callable[[], None]) -> bool:
        """Make a move that ends once a share of the time that is allowed is over; whether it came to its own end."""
        self.known.until = share
        try:
            move()
        except OutOfTime:
            return False
        finally:
            self.known.until = 1.0
        return True
