"""The search for what is missing: from the user's model, effects are added, exchanged and removed while it pays.

This is the order of its moves. The moves themselves are in `first_effects`, `growing`, `varying` and `laws`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import cuts
from diagnosis.effects.scales import OperatingScales, operating_scales
from diagnosis.estimation.tones import tones
from diagnosis.recordings.types import Recorded
from diagnosis.search.allowance import OutOfTime
from diagnosis.search.board import Board
from diagnosis.search.exchange import exchanged
from diagnosis.search.first_effects import FirstEffects
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.growing import Growing
from diagnosis.search.laws import Laws
from diagnosis.search.nonparametric import laws
from diagnosis.search.pairs import Pairs
from diagnosis.search.partial_fit import others_as_ended, place_of, standing
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import complete, misses, probabilities
from diagnosis.search.promises import Promises
from diagnosis.search.readings import taken_otherwise
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Looked, Study
from diagnosis.search.tried_models import Progress
from diagnosis.search.varying import Varying
from diagnosis.thresholds import SEARCH


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
    board = Board(
        fitter,
        refit,
        candidates(scales, without),
        progress,
        lambda model: candidates(_seen_beside(scales, model), without),
        looked,
    )
    search = _Search(board)
    search.ended_early = cut_short
    search.placing.fit_known(known)
    try:
        search.first.begin()
        if anew := taken_otherwise(fitter, board.known.best):
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
        swapped = _exchanged(board, told)
        if not swapped:
            search.run(most)
            swapped = _exchanged(board, told, searched=not search.ended_early)
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


def _exchanged(board: Board, told: Sequence[str], *, searched: bool = False) -> tuple[list[Recorded], str] | None:
    """The recordings with a held-out one moved to training, once; see `exchanged`.

    What is missing in held-out recordings alone may hide there what training recordings have shown. It is asked after
    the first effect, too: where that leaves nothing of the fitted recordings, no second effect can be learned there.
    """
    fitter, found = board.fitter, board.known
    if told or fitter.tables:
        return None
    models = (found.best, found.best_fitted)
    return next((e for m in models if (e := exchanged(fitter, m, found.price, searched=searched))), None)


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
    """The moves from the models that were fitted so far to the next, in their order.

    Args:
        board: what the search has before it.
    """

    def __init__(self, board: Board) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        promises = Promises(board)
        self.placing = Placing(board, promises)
        self.laws = Laws(board, self.placing)
        self.varying = Varying(board, promises, self.placing, self.laws)
        self.first = FirstEffects(board, promises, self.placing, self.varying)
        self.growing = Growing(board, self.placing, self.laws, Pairs(board, self.placing), self.varying)
        self.ended_early = False
        """Whether the time that is allowed was over before all was tried."""

    def run(self, most: int) -> None:
        """Add effects one by one, from the best few models, while even a perfect further effect would pay."""
        self.first.begin()
        if self.first.begun:
            if not self.board.within(SEARCH.growing, lambda: self.growing.grow(most)):
                self.ended_early = True
                self.varying.vary()  # what leads may have come just before, and have rivals as good
            if not self.first.all_begun:
                self.first.go_on()
            self.varying.vary_what_is_new()
        for model in self.near():
            self.varying.put_in_place_of_equals(model)
        for model in self.near():
            self.known.settled(model)
        self.known.confirmed(self.known.best)
        self.known.begin_at_the_best()
        done: list[ScoredModel] = []
        # Beside a nuisance that it is told without, a law may owe to the nuisance what makes it rich.
        while left := [m for m in self.known.leading if not any(m is d for d in done)]:
            done.append(left[0])
            self.laws.simplified(left[0])
            self.laws.enriched(left[0])
            if left[0] is self.known.best:
                self.laws.doubted(left[0])
                if left[0] is not self.known.best:
                    self.varying.vary()
        for rival in self._rivals() if self.board.explains_most else []:
            self.laws.chosen_anew(rival)
            for effect in rival.effects:
                self.laws.simpler(rival, effect)
                if effect.key not in self.known.best.keys and (alike := self.board.mimics(effect)):
                    kept = others_as_ended(rival, effect)
                    self.placing.beside(kept, rival, SEARCH.exchanged, alike)
        self.laws.evened()
        # Those moves may have left a closer fit of a model on its way, and what takes part in the choice has an end.
        for model in self.known.taking_part:
            self.known.settled(model)

    def reduce(self) -> None:
        """Fit what takes part in the choice to its end, and simpler laws of what leads, although the time is over.

        It is told: of an end that is none no interval is, nor how probable it is beside another. The simpler law may do
        as well, and without a fit of its own it could not be told in the place of the richer one.
        """
        self.known.bounded = False
        leader = self.known.settled(self.known.best)
        for effect in leader.effects:
            self.laws.simpler(leader, effect)
        for model in self.known.taking_part:
            self.known.settled(model)

    @property
    def handed_on(self) -> Looked | None:
        """What to go on with in other recordings that hardly differ from these."""
        return self.board.looked and replace(self.board.looked, fitted=tuple(self.known.foremost()))

    def near(self) -> list[ScoredModel]:
        """The models near the best that are worth most, itself among them."""
        near = [m for m in self.known.models if self.known.worth(m) > self.known.reach]
        return sorted(near, key=self.known.worth, reverse=True)[: SEARCH.settled]

    def _rivals(self) -> list[ScoredModel]:
        """What the models near the best are told as, the best first: what else they have may be nuisances."""
        near = sorted(self.known.told, key=lambda pair: self.known.worth(pair[1]), reverse=True)
        told = {as_.keys: as_ for as_, m in near if self.known.worth(m) > self.known.reach}
        return list(told.values())[: SEARCH.settled]

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
