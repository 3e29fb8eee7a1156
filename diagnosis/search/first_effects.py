"""The first effect: each is looked at in the user's model, and those that promise most are fitted."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.effects.effect import Candidate
from diagnosis.search.board import Board
from diagnosis.search.partial_fit import as_ended, standing
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import complete, misses
from diagnosis.search.promises import Promises
from diagnosis.search.screening import Origin
from diagnosis.search.study import Looked
from diagnosis.search.tried_models import Values
from diagnosis.search.varying import Varying
from diagnosis.thresholds import SEARCH


class FirstEffects:
    """Puts a first effect into the user's model.

    Args:
        board: what the search has before it.
        promises: what effects promise.
        placing: puts effects in beside others.
        varying: varies what leads.
    """

    def __init__(self, board: Board, promises: Promises, placing: Placing, varying: Varying) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        self.promises, self.placing, self.varying = promises, placing, varying
        self.begun: bool | None = None
        """Whether the first effect was sought, once that is known."""
        self._first_tasks: list[tuple[list[tuple[tuple[Candidate, ...], list[Values]]], int]] = []
        """First effects that are still to be fitted, and the wrong parameters among them; how many to the end."""
        self.all_begun = True
        """Whether all first effects have had their turn, and what led was varied, each in its share of the time."""

    def begin(self) -> None:
        """Add one effect, if even a perfect one would pay beside the user's own model; once.

        Models of other recordings that are known here change nothing of that: what these recordings show more, others
        may explain better.
        """
        self.known.bounded = True
        if self.begun is None:
            self.begun = self.known.refit.room >= self.known.price + SEARCH.effort
            if self.begun:
                if self.board.looked is None:
                    self._seek()
                else:
                    self.known.failures += self.board.looked.refused
                    tasks = [(as_ended(m), [standing(m.fit)]) for m in self.board.looked.fitted]
                    self.known.fit(tasks, SEARCH.finished)
                self.all_begun &= self.board.within(SEARCH.first, self.varying.vary)
                self.known.patience.at_least(self.fitter.work.done)

    def _seek(self) -> None:
        """Put every effect into the user's model, and fit those that promise most."""
        parents = self.placing.alone_from()
        origins = [o for values in parents if (o := self.fitter.origin((), values)) is not None]
        before = len(self.known.failures)
        ranked = self.promises.screened(origins, self.board.listed)
        refused = tuple(self.known.failures[before:])
        self.board.looked = Looked(tuple(ranked), refused, origins[0] if origins else None)
        able = [c for c in self.board.order if self.promises.pays(origins, c)]
        first = able[:1]
        self.known.fit([((c,), parents) for c in first], 1)
        able = self._near_promised(origins, able)
        # A wrong parameter is as likely as a missing effect: neither kind is to crowd out the other.
        kinds = ([c for c in able if not c.freed], [c for c in able if c.freed])
        self._first_tasks = [
            ([((c,), parents) for c in kind[: SEARCH.fitted]], SEARCH.finished - (1 if kind[:1] == first else 0))
            for kind in kinds
        ]
        self.all_begun = self.board.within(SEARCH.first, self._fit_first)

    def _near_promised(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[Candidate]:
        """Effects that may come near the first of them, where that explains all; all of them where it does not.

        What promised as much as the first may gain as much, however little was promised.
        """
        best, refit = self.known.best, self.known.refit
        if not complete(best, refit) or misses(best.unseen):
            return list(able)
        promised = {id(c): max(self.promises.gains(origins, c)) for c in able}
        gained = self.known.worth(best) - self.known.worth(refit)
        times = max(SEARCH.promised, gained / promised[id(able[0])])
        return [c for c in able if times * promised[id(c)] > self.known.reach - self.known.worth(refit)]

    def _fit_first(self) -> None:
        """Fit the first effects that are still to be fitted."""
        while self._first_tasks:
            self.known.fit(*self._first_tasks[0])
            self._first_tasks.pop(0)

    def go_on(self) -> None:
        """Fit the first effects that had no turn, since a further effect was to have its own; vary what leads."""
        self._fit_first()
        self.known.finish_waiting()
        self.varying.vary()
