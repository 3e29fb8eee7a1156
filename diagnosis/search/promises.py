"""What effects promise to gain beside a model, before any of them is fitted: they are screened, and put in order."""

from __future__ import annotations

import math
from collections.abc import Sequence

from diagnosis.effects.effect import Candidate
from diagnosis.search.board import Board
from diagnosis.search.posterior import price
from diagnosis.search.ranking import cut, ranked, spoken_for
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import Origin, courses
from diagnosis.search.tried_models import Values
from diagnosis.thresholds import SEARCH
from engine.spread import Spread
from engine.work import counted


class Promises:
    """Tells what effects promise.

    Args:
        board: what the search has before it.
    """

    def __init__(self, board: Board) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known

    def origins(self, kept: tuple[Candidate, ...], than: ScoredModel, parents: Sequence[Values]) -> list[Origin]:
        """Where effects are screened beside others, if there are tangents: at a model's parents before the last.

        That is where it ended. Effects are screened there only if it is the only one, or no other has tangents: with
        parameters that are not its own a model may run away.
        """
        near = self.fitter.near(than)
        for some in (parents[:-1], parents[-1:]):
            if found := [o for o in (near.origin(kept, values) for values in some) if o is not None]:
                return found
        return []

    def screened(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[Candidate]:
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

    def pays(self, origins: Sequence[Origin], effect: Candidate) -> bool:
        """Whether an effect promises to raise the likelihood by more than it costs, at any of the origins."""
        cost = price(self.known.refit.own) if effect.freed else self.known.price
        return max(self.gains(origins, effect), default=-math.inf) > cost

    def gains(self, origins: Sequence[Origin], effect: Candidate) -> list[float]:
        """How much an effect promises to raise the likelihood at each of the origins."""
        return [max((c.likelihood for c in courses(o, effect)), default=-math.inf) - o.likelihood for o in origins]

    def _promises(self, origins: Sequence[Origin], able: Sequence[Candidate]) -> list[list[float]]:
        """What each effect promises to gain at each of the origins."""
        found = []
        with counted() as work, Spread(self.fitter.workers, threads=True) as pool:
            for done, gains in enumerate(pool.map(lambda effect: self.gains(origins, effect), able), 1):
                found.append(gains)
                if self.board.progress:
                    self.board.progress("looking at effects", done, len(able))
        self.fitter.spent.work.add(work.done + SEARCH.look * len(able))
        return found

    def _note_refused(self, origins: Sequence[Origin], effects: Sequence[Candidate]) -> None:
        """Note why effects that go in no way into the user's model were refused, in their order: threads keep none."""
        whys: dict[str, str] = {}
        for c in effects:
            for why in (o.refused.get((c.key, c.option)) for o in origins if not o.effects):
                if why is not None:
                    whys.setdefault(c.key, why)
        self.known.failures += [pair for pair in whys.items() if pair not in self.known.failures]
