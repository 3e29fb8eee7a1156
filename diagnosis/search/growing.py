"""Effect after effect is added to what leads, and to what leads less, while another one may explain what is left."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

from diagnosis.effects.places import node
from diagnosis.search.board import Board
from diagnosis.search.laws import Laws
from diagnosis.search.pairs import Pairs
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import complete, energy, misses, strained
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import likeness
from diagnosis.search.varying import Varying
from diagnosis.thresholds import SEARCH


class Growing:
    """Adds effects one by one.

    Args:
        board: what the search has before it.
        placing: puts effects in beside others.
        laws: puts other laws in the place of those of a model.
        pairs: puts two effects at once into the user's model.
        varying: varies what leads.
    """

    def __init__(self, board: Board, placing: Placing, laws: Laws, pairs: Pairs, varying: Varying) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        self.placing, self.laws, self.pairs, self.varying = placing, laws, pairs, varying

    def grow(self, most: int) -> None:
        """Add effects to what leads, and then to what leads less, until nothing is left or nothing new leads."""
        leading = [m.keys for m in self.known.leading]
        if self._follow(most):
            return
        for count in range(2, most + 1):
            if count == 2 and not self._enough():
                self._look_back(most)
            # Of three effects two explain most: where they do not, what is missing is not among those that are listed.
            if self._enough() or (count > 2 and not self.board.explains_most):
                return
            if self._is_weak(self._leader()):
                self._extend_whole(most)
            else:
                self._deepen(count)
            self.varying.vary()
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
            if self._enough() or self._is_weak(before) or (count > 2 and not self.board.explains_most):
                return False
            if count == 2:
                self.pairs.at_once(SEARCH.few, before)
                before = self._best_alone(before)
                if misses(before.left):
                    self.pairs.of_beginnings(before)
                    before = self._best_alone(before)
            # What leads is extended before the search gives up, however long pairs have taken that are no better.
            if count > 2 or self.known.best.keys == before.keys or not self._enough():
                self.placing.extend(before, self.board.listed)
            if len(self.known.best.keys) <= len(before.keys) and strained(before, self.known.tried):
                self._extend_unstrained(len(before.effects))
            whole = self.known.leading[1]
            if len(self.known.best.keys) <= len(before.keys) and len(before.effects) < len(whole.effects) < most:
                # What else is in it counts as a nuisance beside what is still missing, such as a sensor's large bias.
                self.placing.extend(whole, self.board.listed)
            if len(self.known.best.keys) <= len(before.keys):
                return False
            if not self._enough():
                self.laws.enriched(self.known.best)  # a richer law costs less than a further effect
            if self._enough():
                if count > 2:
                    self._paired_otherwise(self.known.best)
                self.varying.vary()
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
            self.placing.extend(max(able, key=self.known.worth), self.board.listed)

    def _best_alone(self, before: ScoredModel) -> ScoredModel:
        """What leads, or one of two effects that lead together instead, where that is worth more alone.

        Beside parameters that are bent for want of it, it had promised too little to be fitted.
        """
        leader = self.known.best
        if len(leader.effects) < 2:
            return before
        self.laws.without_each(leader)
        parts = [m for m in self.known.models if len(m.effects) == 1 and m.keys < leader.keys]
        return max([before, *parts], key=self.known.worth)

    def _paired_otherwise(self, model: ScoredModel) -> None:
        """Look for a pair beside each effect of three that explain all: two of them may imitate one."""
        for single in [m for m in self.known.models if len(m.effects) == 1 and m.keys < model.keys]:
            self.placing.extend(single, self.board.listed)

    def _deepen(self, count: int) -> None:
        """Add an effect to each of the best models that have one less, and try two at once.

        A pair is the same whichever of the two came first: it is looked for beside that which is extended first.
        """
        parents = self._parents(count - 1)
        for best in parents[:1]:
            # What promised little beside the user's model may promise most beside the best one.
            self.placing.extend(best, self.board.listed)
            if not self._enough():
                self._finish_beside(best)
        if count == 2 and not self._enough():
            # Two that hide each other promise little one by one: more of these pairs, now that no other explains all.
            self.pairs.at_once(SEARCH.fitted)
        # Two effects are likelier than three: where no pair explains all, those that lead less are extended too; pairs
        # where they are near the best, for of three effects two explain most.
        for number, parent in enumerate(parents if count == 2 else parents[: SEARCH.beam]):
            if number == 0 or self._enough() or (count > 2 and self.known.worth(parent) < self.known.reach):
                continue
            before = [m.keys for m in parents[:number]]
            first = self.board.order[: SEARCH.beside]
            among = [c for c in first if not any(k <= parent.keys | {c.key} for k in before)]
            self.placing.extend(parent, among)

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
        mine = self.board.answers(single.effects[0])
        return any(likeness(mine, self.board.answers(m.effects[0])) > SEARCH.likest for m in others)

    def _finish_beside(self, model: ScoredModel) -> None:
        """Fit to the end what was put in beside a model and had no turn: a few steps do not tell what gains most."""
        more = [p for p in self.known.dropped if model.keys < {c.key for c in p.effects}]
        self.known.dropped = [p for p in self.known.dropped if not any(p is other for other in more)]
        for partial in more:  # one by one: that some come nowhere near the best says nothing of the others
            self.known.finished([partial])

    def _extend_whole(self, most: int) -> None:
        """Add an effect to what leads as it is: two weak effects may each owe too little while the other is missing."""
        before, whole = self.known.leading
        than = whole if len(whole.effects) < most else before
        among = self.board.listed if complete(before, self.known.refit) else self.board.order[: SEARCH.beside]
        self.placing.extend(than, among)

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
                self.placing.extend(parent, self.board.listed)
        if self.known.best is not before and self._enough():
            self.varying.vary()
        self._finish_waiting()
        if not self._enough():
            self._other_laws()

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
        laws = [c for c in self.board.order if c.place in places and frozenset({c.key}) not in self.known]
        ways = {c.key: c.option for c in before.effects}
        laws += [c for c in self.board.looked_at if ways.get(c.key, c.option) != c.option]
        parents = self.placing.alone_from()
        self.known.fit([((c,), parents) for c in laws], len(laws))
        self._finish_waiting()
        if self.known.best is not before:
            self.varying.vary()

    def _finish_waiting(self) -> None:
        before = self.known.best
        self.known.finish_waiting()
        if self.known.best is not before:
            self.varying.vary()

    def _leader(self) -> ScoredModel:
        """The best model so far, fitted until it is sure that it ends there."""
        return self.varying.cut_anew(self.known.confirmed(self.known.best))

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
