"""A study of a few chosen effects, for tests that cannot try the whole catalogue."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import standing
from diagnosis.search.scored_model import ScoredModel
from scenarios.load import load


@dataclass
class Bench:
    """A scenario's refit, and the effects that can be put in."""

    fitter: CandidateFitter
    refit: ScoredModel
    known: list[Candidate]

    def find(self, effect: str, place: str = "", exact: bool = False) -> Candidate:
        """The first candidate of an effect at a place, or at one whose name holds it."""
        there = [c for c in self.known if c.effect == effect and place in c.place]
        return next(c for c in there if c.place == place) if exact else there[0]

    def put_in(self, *effects: Candidate, given: bool = False) -> ScoredModel:
        """The model with effects in it, fitted from the refit; all but the last begin at the first of their sizes.

        Args:
            effects: that are put in.
            given: begin from the values given too, as a diagnosis does where the refit went astray.
        """
        parents = [standing(self.refit.fit), {}] if given else [standing(self.refit.fit)]
        return self.fitter.closest(self.fitter.finish(self.fitter.partial_fit(effects, parents)))


def bench(name: str, *overrides: str) -> Bench:
    """Prepare a shipped scenario with all its recordings."""
    scenario = load(name, overrides)
    fitter = CandidateFitter(scenario, gather(scenario, (), ()), 2, 0)
    return Bench(fitter, fitter.closest(fitter.refit), candidates(operating_scales(fitter.base)))
