"""The models of a search: fitting them, keeping the best of each set of effects, and which of them leads."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence

from diagnosis.effects.effect import Candidate, cuts, together
from diagnosis.search.allowance import OutOfTime
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import PartialFit, drawn_back, ended
from diagnosis.search.patience import Patience
from diagnosis.search.posterior import complete, explicable, is_in, misses, price, prices, told_as, value
from diagnosis.search.ranking import by_turns
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import LEAST_ODDS
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import FlexarmError
from engine.spread import Spread
from scenarios.variant import edited

Progress = Callable[[str, int, int], None]
Values = dict[str, float]


class TriedModels:
    """The models that were fitted so far.

    Args:
        fitter: fits them.
        refit: the user's model, fitted.
        tried: number of effects at places that are chosen from.
        progress: told what is done.

    Attributes:
        failures: effects that could not be fitted, and why.
        waiting: partial fits that were far from the best when it was their turn.
        dropped: partial fits that had no turn, since others left less after a few steps.
        bounded: whether the search ends where the time is over that is allowed for it.
        until: share of the time that is allowed after which the move that goes on now is to end.
    """

    def __init__(
        self, fitter: CandidateFitter, refit: ScoredModel, tried: int, progress: Progress | None = None
    ) -> None:
        self.fitter, self.refit, self.tried, self.progress = fitter, refit, tried, progress
        self.patience = Patience()
        self.price = price(tried)
        self.failures: list[tuple[str, str]] = []
        self.waiting: list[PartialFit] = []
        self.dropped: list[PartialFit] = []
        self.bounded, self.until = False, 1.0
        self._models: dict[frozenset[str], ScoredModel] = {refit.keys: refit}
        self._done: set[tuple[str, ...]] = set()
        self._settled: list[ScoredModel] = []
        """Models whose fits have come to their end."""
        self._repeated: set[frozenset[str]] = set()
        self._straightened: set[frozenset[str]] = set()
        self._ends: dict[frozenset[Hashable], list[float]] = {}

    def __contains__(self, keys: frozenset[str]) -> bool:
        return keys in self._models

    def __getitem__(self, keys: frozenset[str]) -> ScoredModel:
        return self._models[keys]

    @property
    def models(self) -> list[ScoredModel]:
        """All that were fitted to the end."""
        return list(self._models.values())

    @property
    def explained(self) -> float:
        """What any model explains of all that the user's own leaves, in variances of the noise."""
        return explicable(self.refit, self.models)

    @property
    def told(self) -> list[tuple[ScoredModel, ScoredModel]]:
        """What each believed model is told as, and the model; see `told_as`."""
        return told_as(self.models, self.refit)

    @property
    def leading(self) -> tuple[ScoredModel, ScoredModel]:
        """What the model of greatest worth is told as, and that model."""
        return max(self.told, key=lambda pair: self.worth(pair[1]))

    @property
    def best(self) -> ScoredModel:
        """What the model of greatest worth is told as."""
        return self.leading[0]

    def foremost(self) -> list[ScoredModel]:
        """The models with effects that are worth most, to begin from with other recordings."""
        with_effects = [m for m in self._models.values() if m.effects]
        return sorted(with_effects, key=self.worth, reverse=True)[: SEARCH.finished]

    @property
    def best_fitted(self) -> ScoredModel:
        """The model of greatest worth by the recordings that it was fitted to alone."""
        return max(self._models.values(), key=lambda m: -0.5 * m.fit.cost - prices(m.effects) * self.price)

    @property
    def reach(self) -> float:
        """Worth below which a model is not near the best."""
        return self.worth(self.best) - self.price - SEARCH.effort

    def worth(self, model: ScoredModel) -> float:
        """Evidence less price."""
        return value(model, self.tried)

    def keep(self, made: ScoredModel) -> None:
        """Keep a model, unless one with the same effects is worth as much but for what is no evidence.

        What is put in beside its effects begins from where these have ended, and is fitted anew if that has moved. An
        end of a fit takes the place of what was left on its way.
        """
        known = self._models.get(made.keys)
        least = 0.5 * SEARCH.slow
        if known is not None and made.fit.converged and not known.fit.converged:
            least = -least
        if known is None or self.worth(made) > self.worth(known) + least:
            self._models[made.keys] = made
            self.patience.note(made.keys, self.worth(made), self.fitter.work.done)

    @property
    def given_up(self) -> bool:
        """Whether nothing was gained for so long that the search is to end."""
        return self.patience.is_over(self.fitter.work.done)

    def _go_on(self) -> None:
        """Go on with the next fit.

        Raises:
            OutOfTime: the time that is allowed is over, or the share of it after which this move is to end.
        """
        if self._is_over:
            raise OutOfTime

    @property
    def _is_over(self) -> bool:
        return self.bounded and self.fitter.spent.is_over(self.until)

    def fit(
        self,
        wanted: Iterable[tuple[tuple[Candidate, ...], Sequence[Values]]],
        finish: int,
        *,
        whole: bool = False,
        near: ScoredModel | None = None,
    ) -> list[ScoredModel]:
        """Fit models a few steps, and those of the lowest cost to the end, which are given.

        A model with an effect on one side of a cut that is not in it is another one, and is left out. So is one whose
        fits have ended twice at the same cost, no other lower: a third would end there too.

        Args:
            wanted: effects, those that promise most first, and parameters to begin from.
            finish: how many are fitted to the end; at least the leader by each noise, the first, and after these what
                leaves as little as a leader but for what is no evidence.
            whole: as of `finished`.
            near: model that recordings are made coarse around; the user's own, if None.
        """
        self._go_on()
        fitter = self.fitter if near is None else self.fitter.near(near)
        tasks = []
        for effects, parents in wanted:
            mark = tuple(sorted(f"{c.key} {c.option} {c.starts}" for c in effects))
            if mark not in self._done and all(c.beyond <= cuts(effects) for c in effects) and not self._sure(effects):
                self._done.add(mark)
                tasks.append((effects, parents))

        def begin(task: tuple[tuple[Candidate, ...], Sequence[Values]]) -> PartialFit | tuple[str, str]:
            try:
                return fitter.partial_fit(*task)
            except FlexarmError as error:
                return task[0][-1].key, error.message

        with Spread(self.fitter.workers, threads=True) as pool:
            partials = []
            for done, found in enumerate(pool.map(begin, tasks), 1):
                if isinstance(found, PartialFit):
                    partials.append(found)
                else:
                    self.failures.append(found)
                if self.progress:
                    self.progress("trying effects", done, len(tasks))
        leaders, others, rivals = self._able(partials)
        count = max(finish - len(leaders), 0)
        self.dropped += others[count:]
        made = self.finished([*leaders, *others[:count]], whole=whole, begun=True)
        left = {id(p) for p in (*self.waiting, *self.dropped)} & {id(rival) for rival in rivals}
        self.waiting = [p for p in self.waiting if id(p) not in left]
        self.dropped = [p for p in self.dropped if id(p) not in left]
        return made + self.finished([rival for rival in rivals if id(rival) in left], whole=whole)

    def finished(
        self, partials: Sequence[PartialFit], *, whole: bool = False, begun: bool = False
    ) -> list[ScoredModel]:
        """Models fitted to the end, a few at a time, while one of the few comes near the best; others wait.

        Beside a second effect what was far from the best may be part of the truth; and what is related to the best, as
        a simpler law at its place is, does not wait. The first is fitted alone: it tells what others are to reach.

        Args:
            partials: which.
            whole: to the end even where that is not near the best, for what the best may be told as.
            begun: whether the first is fitted although the time is over: all that was spent on the few steps of the
                others has told that it leads.

        Raises:
            OutOfTime: as of `_go_on`; those that are left wait.
        """
        reaches: dict[int, float] = {}

        def finish(partial: PartialFit) -> ScoredModel | tuple[str, str]:
            try:
                return self.fitter.finish(partial) if whole else self.fitter.finish(partial, reaches[id(partial)])
            except FlexarmError as error:
                return partial.effects[-1].key, error.message

        kept: list[ScoredModel] = []
        for few in range(0, len(partials), SEARCH.few):
            some, able = partials[few : few + SEARCH.few], list[ScoredModel]()
            for number, group in enumerate((some[:1], some[1:]) if few == 0 else (some,)):
                if self._is_over and not (begun and few == number == 0):
                    self.waiting += [p for p in partials[few:] if id(p) not in reaches]
                    raise OutOfTime
                reaches |= {id(partial): self._reach_of(partial) for partial in group}
                with Spread(self.fitter.workers, threads=True) as pool:
                    found = list(pool.map(finish, group))
                for partial, made in zip(group, found, strict=True):
                    if isinstance(made, tuple):
                        self.failures.append(made)
                    elif self._has_meaning(made):
                        able.append(self._judged(made))
                        self.keep(able[-1])
                        self._keep_refit(self._judged(self.refit))
                        if made.fit.converged and (whole or made.fit.cost <= reaches[id(partial)]):
                            chosen = [ended(made, c) for c in made.effects]
                            for mark in {_model(made.effects), _model(chosen)}:
                                self._ends.setdefault(mark, []).append(made.fit.cost)
            kept += able
            reach = self.reach
            if not any(self.worth(made) > reach and made.keys != self.best.keys for made in able):
                self.waiting += partials[few + SEARCH.few :]
                break
        return kept

    def finish_waiting(self, wanted: Callable[[PartialFit], bool] = lambda partial: True) -> None:
        """Fit models to the end that wait for it, a few at a time, even if none of the few comes near the best."""
        left = [p for p in self.waiting if wanted(p)]
        for few in range(0, len(left), SEARCH.few):
            some = left[few : few + SEARCH.few]
            self.waiting = [p for p in self.waiting if not any(p is s for s in some)]
            self.finished(some)

    def _judged(self, model: ScoredModel) -> ScoredModel:
        """A model as it is, or where all recordings together are likeliest, if that is several steps away.

        If it would not come near the best even if it explained all of what was not fitted, it stays as it is.
        """
        near = self.worth(model) + model.unseen.unexplained > self.reach
        return self.fitter.followed(model) if near and model.owed > 0.5 * SEARCH.slow else model

    def _keep_refit(self, refit: ScoredModel) -> None:
        self.refit = self._models[refit.keys] = refit

    def has_ended(self, effects: Sequence[Candidate]) -> bool:
        """Whether a fit of a model with these effects, and what is chosen of them, has come to its end."""
        return bool(self._ends.get(_model(effects)))

    def _sure(self, effects: Sequence[Candidate]) -> bool:
        """Whether two fits of a model have ended at the same cost, and none lower."""
        ends = sorted(self._ends.get(_model(effects), ()))
        return len(ends) > 1 and ends[1] - ends[0] < SEARCH.slow

    def told_below(self, model: ScoredModel) -> float:
        """Cost above which a simpler law is not told in the place of a model: it owes it more than a nuisance does."""
        return model.cost + EVIDENCE.share * self.explained + 2 * (self.price + SEARCH.effort)

    def _reach_of(self, partial: PartialFit) -> float:
        """Cost of the fitted recordings above which a model is not near the best, once one with effects is known.

        Not even if it explained all that the best leaves of recordings that are not fitted: noise, if that is complete.
        What is simpler than the best is compared with it however far it is: the best may be told as that.
        """
        best = self.best
        lost = [c for c in best.effects if all(c.key != p.key for p in partial.effects)]
        more = [c for c in partial.effects if c.key not in best.keys]
        if not best.effects or not more or (len(lost) == len(more) == 1 and is_in(more[0], lost[0])):
            return math.inf
        explains_all = complete(best, self.refit) and not misses(best.unseen)
        others = best.unseen.unexplained if best.fit.problem.held_out and not explains_all else 0.0
        fewer = prices(best.effects) - prices(partial.effects)
        return best.cost + 2 * (others + (1 + fewer) * self.price + SEARCH.effort)

    def settled(self, model: ScoredModel) -> ScoredModel:
        """A model whose fit was left early, fitted to the end."""
        if not model.fit.converged and not any(m is model for m in self._settled):
            self._go_on()
            self._models[model.keys] = self._likelier(self.fitter.settled(model), model)
            self._settled.append(self._models[model.keys])
            if not model.effects:
                self._keep_refit(self._models[model.keys])
        return self._models[model.keys]

    def confirmed(self, model: ScoredModel) -> ScoredModel:
        """A model fitted to the end, and tried again if that may not be where it fits best.

        With its parameters drawn back, where they are bent: they may make up for a size that ended a little off. And
        from around there, if it has not converged, or misses held-out recordings although it leaves too little for a
        further effect: contacts that bounce make a cost with many low points.
        """
        if model.effects and model.bent and model.keys not in self._straightened:
            self._straightened.add(model.keys)
            there = tuple(ended(model, c) for c in model.effects)
            self.fit([(there, [drawn_back(model.fit, SEARCH.drawn)])], 1, whole=True)
        model = self.settled(self._models.get(model.keys, model))
        doubtful = not model.fit.converged or (complete(model, self.refit) and misses(model.unseen))
        if model.effects and doubtful and model.keys not in self._repeated:
            self._go_on()
            self._repeated.add(model.keys)
            made = self._likelier(self.fitter.retried(model), model)
            if self.worth(made) > self.worth(model) or not model.fit.converged:
                self._models[model.keys] = made
        return self._models[model.keys]

    def _likelier(self, made: ScoredModel, model: ScoredModel) -> ScoredModel:
        """A later end of a model's fit, judged from there, or from the end before where that leads to what is likelier.

        Two ends that leave the same of the fitted recordings may be far apart for those that were not fitted.
        """
        made = self._judged(made)
        return made if self.worth(made) >= self.worth(model) else made.judged_as(model)

    @property
    def taking_part(self) -> list[ScoredModel]:
        """The models with effects that are a thousandth as probable as the best one or more, the best first."""
        least = self.worth(self.leading[1]) - EVIDENCE.temperature * math.log(1 / LEAST_ODDS)
        near = [m for m in self.models if m.effects and self.worth(m) > least]
        return sorted(near, key=self.worth, reverse=True)

    def begin_at_the_best(self) -> None:
        """Begin each model that takes part in the choice from the parameters of the best one, too.

        A fit may have ended in a hollow that another one has left. What that found of the machine is as right beside
        other effects.
        """
        best = self.leading[1]
        for model in [m for m in self.taking_part if m is not best]:
            self._go_on()
            closer = self.fitter.begun_from(model, best)
            if closer is not model:
                self.keep(self._judged(closer))

    def keep_only(self, models: Iterable[ScoredModel]) -> None:
        """Forget all models but some."""
        self._models = {m.keys: m for m in models}

    def _able(self, partials: Sequence[PartialFit]) -> tuple[list[PartialFit], list[PartialFit], list[PartialFit]]:
        """Of partial fits, those that leave least as of white noise and as of coloured noise, and the others by turns.

        Third, those that leave as little as either but for what is no evidence: they may turn out to be its equals.

        With white noise a fit leads out of hollows, with coloured noise it is judged: where one model has a turn, each
        has. So has the first, which promised most: a few steps may not have kept that promise yet. The others go place
        by place.

        Args:
            partials: those that promised most first.
        """
        white = {id(p): p.point.cost for p in partials}
        coloured = {id(p): p.point.problem.cost(p.point.x, p.point.problem.training) for p in partials}
        orders, close = list[list[PartialFit]](), set[int]()
        for costs in (white, coloured):
            orders.append(sorted(partials, key=lambda partial, costs=costs: costs[id(partial)]))  # type: ignore[misc]
            close |= {number for number, cost in costs.items() if cost <= min(costs.values()) + 2 * SEARCH.effort}
        found = list({id(p): p for both in zip(*orders, strict=True) for p in both}.values())
        leaders = [p for p in found if any(p is order[0] for order in (*orders, partials))]
        others = [p for p in found if not any(p is leader for leader in leaders)]
        return (
            leaders,
            by_turns(others, lambda partial: partial.effects[-1].place),
            [p for p in found if id(p) in close],
        )

    def _has_meaning(self, made: ScoredModel) -> bool:
        """Whether blocks take the sizes at which a fit ended: it moves them without asking again."""
        there = [ended(made, c) for c in made.effects]
        try:
            edited(self.fitter.scenario, together(there, [c.starts[0] for c in there]))
        except FlexarmError as error:
            self.failures.append((made.effects[-1].key, error.message))
            return False
        return True


def _model(effects: Sequence[Candidate]) -> frozenset[Hashable]:
    """What tells a model from others, wherever its fit begins."""
    return frozenset(c.model for c in effects)
