"""Simpler and richer laws in the place of those that a model has, and models without one of its effects."""

from __future__ import annotations

import math
from dataclasses import replace

from diagnosis.effects.effect import Candidate, Sizes, able_beside, all_beside
from diagnosis.search.board import Board
from diagnosis.search.equivalent_effects import lookalikes
from diagnosis.search.partial_fit import as_ended, ended, others_as_ended, standing
from diagnosis.search.placing import Placing
from diagnosis.search.posterior import energy, is_in, is_simpler, owes_little, prices
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.tried_models import Values
from diagnosis.thresholds import EVIDENCE, SEARCH


class Laws:
    """Puts other laws in the place of those of a model.

    Args:
        board: what the search has before it.
        placing: puts effects in beside others.
    """

    def __init__(self, board: Board, placing: Placing) -> None:
        self.board, self.fitter, self.known = board, board.fitter, board.known
        self.placing = placing

    def simplified(self, model: ScoredModel) -> None:
        """Take each effect of a model away, or put a simpler law in its place, from where it ended, and try it again.

        Where a machine sticks, its answer jumps with every parameter, and the fit of a simple law may end at a jump
        that a richer law has passed by.
        """
        if len(model.effects) > 1:
            self.without_each(model)
        for effect in model.effects:
            for made in self.simpler(model, effect):
                known = self.known[made.keys]
                if self.known.worth(known) < self.known.worth(model) and self._does_most(known, model, effect):
                    self.known.keep(self.fitter.retried(made, self.known.told_below(model)))

    def without_each(self, model: ScoredModel) -> None:
        """Take each effect of a model away, from where it ended."""
        for effect in model.effects:
            kept = others_as_ended(model, effect)
            self.known.fit([(kept, [standing(model.fit)])], 1, whole=True, near=model)

    def simpler(self, model: ScoredModel, effect: Candidate) -> list[ScoredModel]:
        """Put simpler laws in the place of an effect of a model, from where it ended; they are given."""
        values = model.fit.parameters()
        kept = others_as_ended(model, effect)
        same = [c for c in self.board.listed if (c.place, c.option) == (effect.place, effect.option)]
        laws = [c for c in same if c.key != effect.key and is_in(c, effect)]
        # From a stiffness that was fitted to nothing no other can grow: that one keeps its own start.
        begun = [
            replace(c, starts=({k: values.get(f"{effect.name}.{k}") or v for k, v in c.starts[0].items()},))
            for c in able_beside(kept, laws)
        ]
        tasks = [((*kept, c), [standing(model.fit)]) for c in begun]
        return self.known.fit(tasks, len(tasks), whole=True, near=model)

    def _does_most(self, simpler: ScoredModel, model: ScoredModel, effect: Candidate) -> bool:
        """Whether a simpler law explains most of what an effect of a model does.

        Then its fit may have ended at a jump of the cost, short of the rest.
        """
        keys = model.keys - {effect.key}
        if keys not in self.known:
            return True  # it could not be fitted
        without = self.known[keys]
        return energy(without) - energy(simpler) > EVIDENCE.most * (energy(without) - energy(model))

    def enriched(self, model: ScoredModel) -> None:
        """Put richer laws in the place of a simpler one of a model, from where that ended.

        Each that was not tried, and each that left more: it contains the simpler one, so its fit has lost its way. The
        order of a wave was chosen beside the simpler law: beside one that comes closer it is chosen anew.
        """
        for effect in model.effects:
            kept = others_as_ended(model, effect)
            found = ended(model, effect).starts[0]
            richer = [
                replace(c, starts=_grown_from(found, c))
                for c in able_beside(kept, self.board.listed)
                if (c.place, c.option) == (effect.place, effect.option) and c.key != effect.key and is_in(effect, c)
            ]
            wanted = [c for c in richer if not self.board.as_close(frozenset(k.key for k in (*kept, c)), model)]
            tasks = [((*kept, c), [standing(model.fit)]) for c in wanted]
            made = self.known.fit(tasks, len(wanted), whole=True, near=model)
            closer = [m for m in made if m.fit.cost < model.fit.cost and any(c.wave is not None for c in kept)]
            anew = [(self.board.with_all_orders(as_ended(m)), [standing(m.fit)]) for m in closer]
            self.known.fit(anew, 1, near=model)

    def doubted(self, model: ScoredModel) -> None:
        """Put other effects beside a simpler law that explains nearly as much as the law of a model.

        What the richer law explains beyond that may be a nuisance, or a second effect, for which another one beside the
        simpler law accounts as well, or better: where the richer law leaves more than a further effect costs, the
        simpler one need only explain most of what it does.
        """
        leaves = model.room >= self.known.price + SEARCH.effort
        same = [m for m in self.known.models if len(m.keys) == len(model.keys) and is_simpler(m, model)]
        poorer = [
            m
            for m in same
            if owes_little(model, m, self.known.explained)
            or (leaves and all(self._does_most(m, model, c) for c in model.effects if c.key not in m.keys))
        ]
        if not poorer:
            return
        for simpler in poorer:
            if len(simpler.effects) < SEARCH.most:
                self.placing.extend(simpler, self.board.listed)
        pairs = [c for c in lookalikes(model, self.board.listed) if prices(c) <= SEARCH.most]
        self.known.fit([(c, [standing(model.fit)]) for c in pairs], len(pairs), near=model)

    def chosen_anew(self, model: ScoredModel) -> None:
        """Put each effect of a model in with every value of what is only chosen, such as a wave's order.

        It was chosen after a few steps by the recordings that are fitted: over a short way orders are alike there.
        Those that were fitted to the end are left out.
        """
        for effect in model.effects:
            kept = others_as_ended(model, effect)
            listed = [c for c in self.board.listed if (c.key, c.option) == (effect.key, effect.option)]
            ways = [way for c in able_beside(kept, listed) for way in c.choices()]
            if len(ways) > 1:
                tasks = [
                    ((*kept, way), [standing(model.fit)]) for way in ways if not self.known.has_ended((*kept, way))
                ]
                self.known.fit(tasks, 1, near=model)

    def evened(self) -> None:
        """Put nuisances that fit beside the best model in beside its rivals too, so that like compares with like."""
        best, whole = self.known.leading
        if not best.keys < whole.keys:
            return
        nuisances = tuple(ended(whole, c) for c in whole.effects if c.key not in best.keys)
        rivals = {m.keys: m for m, _ in self.known.told if m.effects and self.known.worth(m) > self.known.reach}
        tasks: list[tuple[tuple[Candidate, ...], list[Values]]] = []
        for m in rivals.values():
            both = all_beside([ended(m, c) for c in m.effects], nuisances)
            if m is not best and both is not None and prices(both) <= SEARCH.most:
                tasks.append((both, [standing(m.fit)]))
        self.known.fit(tasks, len(tasks), whole=True, near=whole)


def _grown_from(found: Sizes, richer: Candidate) -> tuple[Sizes, ...]:
    """The sizes that a richer law begins from, those of a simpler one as found; what is of their kind keeps its ratio.

    A static friction that is half as large again as the sliding one stays so, however large that was found to be.
    """
    kinds = {p.name: p.reference for p in richer.parameters}

    def grown(start: Sizes) -> Sizes:
        times = {kinds[k]: found[k] / v for k, v in start.items() if k in found and k in kinds and v}
        return {k: found.get(k, v * times.get(kinds.get(k, math.nan), 1.0)) for k, v in start.items()}

    return tuple({repr(sizes): sizes for sizes in map(grown, richer.starts)}.values())
