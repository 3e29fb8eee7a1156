"""Two effects at once: what each hides of the other shows only with both."""

from __future__ import annotations

import math

from diagnosis.effects.effect import Candidate
from diagnosis.search.board import Board
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import as_ended, standing
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import is_in, strained
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import courses, together
from diagnosis.search.tried_models import TriedModels, Values
from diagnosis.thresholds import SEARCH


class Pairs:
    """Puts two effects at once into the user's model.

    Args:
        board: what the search has before it.
        placing: puts effects in beside others.
    """

    def __init__(self, board: Board, placing: Placing) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        self.placing = placing

    def at_once(self, most: int, than: ScoredModel | None = None) -> None:
        """Two effects at once, where they promise most together; so many pairs at most.

        Those with an effect that leads alone, or with a law that is part of it or the other way round, are left to the
        extension of that, unless its parameters are far off: then the two begin together, from where it has not ended.

        Args:
            most: number of pairs.
            than: model that they are to promise to better; none, if all are to be fitted.
        """
        parents = [standing(self.known.refit.fit), {}]
        best = self.known.best
        alone = best.effects if len(best.effects) == 1 and not strained(best, self.known.tried) else ()
        found = self._promised(self.fitter, parents[0], most, than)
        pairs = [pair for pair in found if not any(is_in(c, a) or is_in(a, c) for c in pair for a in alone)]
        self.known.fit([(pair, parents) for pair in pairs], SEARCH.few)

    def of_beginnings(self, than: ScoredModel) -> None:
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
        pairs = [self.board.with_all_orders(c) for c in self._promised(early, parents[0], SEARCH.few, than)]
        known = TriedModels(early, early.refit, self.known.tried, self.board.progress)
        known.fit([(pair, parents) for pair in pairs], len(pairs))
        if pairs and than.effects:
            known.fit([(as_ended(than), [standing(than.fit)])], 1, whole=True)
        least = known.worth(known[than.keys]) if than.keys in known else -math.inf
        for m in [m for m in known.foremost() if known.worth(m) > least][: SEARCH.few]:
            self.placing.fit_known([m])
            if self.known.best.keys != m.keys:  # the order of a wave may be another one
                self.known.fit([(self.board.with_all_orders(as_ended(m)), [standing(m.fit)])], 1, whole=True)

    def _promised(
        self, fitter: CandidateFitter, values: Values, most: int, than: ScoredModel | None
    ) -> list[tuple[Candidate, ...]]:
        """The pairs that promise most beside the user's model with some parameters; other arguments as of `at_once`."""
        origin = fitter.origin((), values)
        if origin is None or fitter.tables:
            return []
        found = [course for c in self.board.looked_at for course in courses(origin, c)[: SEARCH.sizes]]
        return together(found, origin, most, fitter.likelier(than) if than is not None else -math.inf)
