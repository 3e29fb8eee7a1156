"""Inserting effects and fitting them: starting sizes, a few steps from the best of them, then the whole way."""

from __future__ import annotations

import copy
import functools
import hashlib
import itertools
import math
import operator
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes, together
from diagnosis.estimation.growing import beginning, doubled, grown
from diagnosis.estimation.least_squares import Fit, descend, fit
from diagnosis.estimation.leftover import Noise
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import foretell
from diagnosis.problems import followed, problem, resolved, variant
from diagnosis.recordings.types import Recorded
from diagnosis.search.allowance import Spent
from diagnosis.search.coarse import as_coarse, coarse
from diagnosis.search.evidence import ChosenSize
from diagnosis.search.nearby import Nearby
from diagnosis.search.partial_fit import PartialFit, StartingPoint, place_of, standing
from diagnosis.search.posterior import misses
from diagnosis.search.scored_model import ScoredModel, scored
from diagnosis.search.screening import Origin, begun
from diagnosis.search.wave_starts import solved
from diagnosis.thresholds import COARSE, EVIDENCE, FITTING, SEARCH
from engine.errors import FlexarmError, SimulationError
from engine.spread import Store
from engine.threads import Threads
from engine.work import Work, counted
from scenarios.load import Scenario

KEPT = 400
"""Models that are kept after they were built: those of one round of a search."""


class CandidateFitter:
    """Builds and fits models of a study, with a bounded number of threads.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.
        seed: of everything random.
        store: keeps every fit, so that a study that was interrupted goes on where it was.
        spent: what fits to these recordings and to others have taken, and what is allowed for all.
        share: of each recording that is looked at, from its beginning on.
    """

    def __init__(
        self,
        scenario: Scenario,
        recordings: Sequence[Recorded],
        workers: int = 2,
        seed: int = 0,
        store: Store | None = None,
        spent: Spent | None = None,
        share: float = 1.0,
    ) -> None:
        self.scenario, self.recordings, self.store = scenario, tuple(recordings), store
        self.workers, self.seed = workers, seed
        made = problem(scenario, self.recordings)
        self.base = beginning(made, share) if share < 1 else made
        self.tables = self.base.sparse
        self.digest = _digest(self.base, seed)
        self.centre: PartialFit | None = None
        """The model that recordings are made coarse around; the user's own, if None."""
        self.mark = ""
        """Tells it from others."""
        self.work = Work()
        """What all fits to these recordings took."""
        self.spent = spent or Spent()
        self._around = {self.mark: self}
        self._origins: dict[str, Origin | None] = {}
        self._built: OrderedDict[str, Problem] = OrderedDict()
        self._finished: dict[str, tuple[float, ScoredModel]] = {}
        """What fits came to, and the cost that each was to reach."""

    def again(self, recordings: Sequence[Recorded]) -> CandidateFitter:
        """The same with other recordings; itself, where they are its own."""
        recordings = tuple(recordings)
        if len(recordings) == len(self.recordings) and all(map(operator.is_, recordings, self.recordings)):
            return self
        return CandidateFitter(self.scenario, recordings, self.workers, self.seed, self.store, self.spent)

    @functools.cached_property
    def early(self) -> CandidateFitter:
        """The same with the beginnings of the recordings, to look at effects beside the user's model fitted to these.

        Over whole recordings no tangent may hold: what a machine that sticks does next hangs on where it is. The fits
        are done here, since they take no longer than to send them to a cluster.
        """
        return CandidateFitter(
            self.scenario, self.recordings, self.workers, self.seed, self.store, self.spent, SEARCH.early
        )

    def near(self, model: ScoredModel) -> CandidateFitter:
        """The same with recordings that are made coarse around a model, to put other effects in beside its own.

        What they are corrected by is right near the model that told it. Far from there the error is small beside what
        that model left over, and large beside what a further effect explains.
        """
        return self.around(PartialFit(model.effects, end_of(model), model.fit.converged)) if model.effects else self

    def around(self, centre: PartialFit) -> CandidateFitter:
        """As of `near`, of a partial fit to the whole recordings."""
        if self.coarse is self.base:
            return self
        mark = f" {centre.label} {_mark(centre.point.x)}"
        if mark not in self._around:
            made = copy.copy(self)
            made.centre, made.mark = centre, mark
            with counted():  # what is kept for other fits is of none of them
                made.coarse = as_coarse(self.base, coarse(centre.point.problem, centre.point.x))
            self._around[mark] = made
        return self._around[mark]

    @functools.cached_property
    def refit(self) -> ScoredModel:
        """The user's own model, its parameters fitted from several starts, to coarse recordings first."""

        def compute() -> PartialFit:
            rough = coarse(self.base, np.zeros(len(self.base.free)))
            drop = SEARCH.slow
            made = fit(rough, random_starts=2, seed=self.seed, workers=self.workers, least_gain=drop, noise="coloured")
            with Threads(self.workers) as pool:
                x, cost, converged = descend(self.base, made.x, self.base.training, pool, least_gain=drop)
            return PartialFit((), StartingPoint(cost, self.base, x, (), ()), converged)

        return self._trial(self._kept("refit", (), compute))

    def settled(self, model: ScoredModel) -> ScoredModel:
        """A model whose fit was left where it hardly gained, fitted to the end."""
        point = end_of(model)

        def compute() -> PartialFit:
            made = point.problem
            with Threads(self.workers) as pool:
                x, cost, converged = descend(made, point.x, made.training, pool, iterations=SEARCH.most_steps)
            return PartialFit(model.effects, replace(point, x=x, cost=cost), converged)

        return self._trial(self._kept(f"settled {model.label} {_mark(point.x)}", model.effects, compute))

    def closest(self, model: ScoredModel, richer: Sequence[ScoredModel] = ()) -> ScoredModel:
        """A model at its least squared error, unless all recordings together are then followed less closely.

        An amended model that leaves no more than noise stays as its likelihood has it where only the least squared
        error bends its parameters: they would follow nuisances there. So it stays where that fit has converged and the
        one to the least squared error has not, unless this leaves less than half: of an end that is none no interval
        could be told.

        The user's own is begun from several starts too, as `flexarm fit` begins it, on coarse recordings. Its error may
        be millions of times the noise, and is fitted to the digits that are told.

        Args:
            model: which.
            richer: models that contain it and are compared with it; it is begun from where each of them ended too.
        """
        point = end_of(model)
        begun = [_with_values(point, standing(m.fit)) for m in richer]

        def compute() -> PartialFit:
            made, begins, drop = point.problem, [point.x, *begun], 0.0
            if not model.effects:
                drop = SEARCH.digits * sum(e.measured.size for e in made.training)
                starts = fit(self.coarse, random_starts=2, seed=self.seed, workers=self.workers, least_gain=drop)
                begins.append(starts.x)
            steps = SEARCH.most_steps
            with Threads(self.workers) as pool:
                ends = [
                    descend(made, x, made.training, pool, iterations=steps, least_gain=drop, noise="stated")
                    for x in begins
                ]
            x, cost, converged = min(ends, key=lambda end: end[1])
            return PartialFit(model.effects, replace(point, x=x, cost=cost), converged)

        marks = " ".join(_mark(x) for x in (point.x, *begun))
        kept = self._kept(f"closest {model.label} {marks}", model.effects, compute)
        found = self._trial(kept, "stated")
        bends = bool(model.effects) and found.bent and not model.bent and not misses(model.left)
        stays = model.effects and model.fit.converged and not found.fit.converged
        most = (1 - EVIDENCE.most) * model.squares if stays else model.squares
        closer = not bends and found.squares <= most
        return replace(found, log_evidence=model.log_evidence) if closer else model

    def _kept(self, key: str, effects: tuple[Candidate, ...], compute: Callable[[], PartialFit]) -> PartialFit:
        """What ``compute`` gives, or what it gave before under the same key."""
        key = f"{self.digest}{self.mark} {key}"
        if self.store is None or key not in self.store:
            with counted() as work:
                partial = compute()
            partial = replace(partial, work=work.done)
            if self.store is not None:
                self.store[key] = partial.row()
        else:
            partial = self.restored(effects, self.store[key])
        self.work.add(partial.work)
        self.spent.work.add(partial.work)
        return partial

    def restored(self, effects: tuple[Candidate, ...], row: dict[str, Any]) -> PartialFit:
        """The partial fit that was written down by `PartialFit.row`."""
        made = self.build(effects, row["built"], whole=row["whole"]) if effects else self.base
        made = replace(made, internal_step=row["internal_step"])
        point = StartingPoint(row["cost"], made, np.array(row["x"]), tuple(row["sizes"]), tuple(row["built"]))
        begun = None if row["begun"] is None else np.array(row["begun"])
        return PartialFit(effects, point, row["converged"], self.mark, row["work"], begun)

    def followed(self, model: ScoredModel) -> ScoredModel:
        """A model judged where all recordings together are likeliest, however many steps away; see `evidence`.

        Where that is closer to the fitted ones too, their fit had ended in a hollow, and goes on from there.
        """
        found = self._trial(PartialFit(model.effects, end_of(model), model.fit.converged), followed=True)
        while (closer := self._closer_there(found)) is not None:
            made = self._trial(closer, followed=True)
            if made.log_evidence < found.log_evidence - 0.5 * SEARCH.slow:
                break
            found = made
        return found

    def begun_from(self, model: ScoredModel, other: ScoredModel) -> ScoredModel:
        """A model fitted from the parameters of another one, its own effects as they are; itself, if that is no closer.

        Args:
            model: which.
            other: model whose parameters it begins from.
        """
        point = end_of(model)
        there = _with_values(point, standing(other.fit))

        def compute() -> PartialFit:
            made = point.problem
            with Threads(self.workers) as pool:
                x, cost, converged = descend(
                    made,
                    there,
                    made.training,
                    pool,
                    iterations=SEARCH.most_steps,
                    least_gain=SEARCH.slow,
                    reach=point.cost - SEARCH.slow,
                )
            closer = cost < point.cost - SEARCH.slow
            end = replace(point, x=x, cost=cost) if closer else point
            return PartialFit(model.effects, end, converged if closer else model.fit.converged)

        found = self._kept(f"begun {model.label} {_mark(point.x)} from {_mark(there)}", model.effects, compute)
        return self._trial(found) if found.point.cost < point.cost - SEARCH.slow else model

    def _closer_there(self, model: ScoredModel) -> PartialFit | None:
        """A model fitted from where all recordings together are likeliest, if that is closer to the fitted ones."""
        point, begin = end_of(model), model.likeliest
        made = point.problem
        if begin is None or made.cost(begin, made.training) > point.cost - SEARCH.slow:
            return None

        def compute() -> PartialFit:
            with Threads(self.workers) as pool:
                x, cost, converged = descend(
                    made, begin, made.training, pool, iterations=SEARCH.most_steps, least_gain=SEARCH.slow
                )
            return PartialFit(model.effects, replace(point, x=x, cost=cost), converged)

        return self._kept(f"followed {model.label} {_mark(begin)}", model.effects, compute)

    def _trial(self, partial: PartialFit, noise: Noise = "coloured", *, followed: bool = False) -> ScoredModel:
        """A partial fit as it is, scored; ``noise`` and ``followed`` as of `scored`."""
        made, x = partial.point.problem, partial.point.x
        n = len(x)
        chi2 = made.chi2(x, made.training)
        found = Fit(made, x, partial.point.cost, chi2, partial.converged, np.zeros((n, n)))
        return scored(found, partial.effects, partial.point.sizes, noise, self._chosen(partial), followed=followed)

    def _chosen(self, partial: PartialFit) -> list[ChosenSize]:
        """The sizes of a model that are only chosen, and looked for finer, with what its residual owes to each."""
        point, found = partial.point, []
        for k, effect in enumerate(partial.effects):
            size = next((p for p in effect.parameters if p.fixed), None)
            if effect.finer is None or size is None:
                continue
            at = point.sizes[k]
            beside = (effect.finer(at, sign * SEARCH.slope_step) for sign in (-1, 1))
            near = sorted((at, *filter(None, beside)), key=lambda sizes: sizes[size.name])
            rows = []
            for there in (near[0], near[-1]):
                made = self.build(partial.effects, _with(point.built, k, there), whole=True)
                made = replace(made, internal_step=point.problem.internal_step)
                rows.append(made.residuals(point.x, made.experiments))
            apart = math.log(near[-1][size.name] / near[0][size.name])
            slopes = tuple((high - low) / apart for low, high in zip(*rows, strict=True))
            away = math.log(at[size.name] / (size.usual * size.reference))
            found.append(ChosenSize(slopes, away, size.spread))
        return found

    @functools.cached_property
    def coarse(self) -> Problem:
        """The user's model with coarse recordings, on which effects are looked at before they are fitted."""
        x = self.refit.fit.x
        with counted():
            return coarse(self.base, x)

    def likelier(self, model: ScoredModel) -> float:
        """By how much the likelihood of coarse recordings is higher where a model's fit ended than for the user's own.

        Less what parameters cost: what effects promise is told by the same, and of these recordings.
        """
        if not model.effects:
            return 0.0
        point, own = end_of(model), self.coarse
        made = replace(self.build(model.effects, point.built), internal_step=point.problem.internal_step)
        return 0.5 * (own.cost(self.refit.fit.x, own.training) - made.cost(point.x, made.training))

    def build(self, effects: Sequence[Candidate], starts: Sequence[Sizes], *, whole: bool = False) -> Problem:
        """The problem with effects put in at starting values; some of those built last are kept.

        Args:
            effects: what is put in.
            starts: sizes of each.
            whole: with the recordings as they are, rather than coarse ones.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        whole = whole or self.coarse is self.base
        mark = repr([whole or self.mark, *((c.key, c.option, c.name, s) for c, s in zip(effects, starts, strict=True))])
        made = self._built.get(mark)
        if made is None:
            made = self._built[mark] = self._build(self.base if whole else self.coarse, effects, starts)
            while len(self._built) > KEPT:
                self._built.popitem(last=False)
        return made

    def _build(self, base: Problem, effects: Sequence[Candidate], starts: Sequence[Sizes]) -> Problem:
        extra = [f for c, s in zip(effects, starts, strict=True) for f in c.free(s)]
        return variant(
            base, together(effects, starts), extra, held={f"{c.name}.{key}" for c in effects for key in c.held}
        )

    def placed(
        self,
        effects: tuple[Candidate, ...],
        group: Sequence[tuple[Sizes, ...]],
        parent: dict[str, float],
        longest: float | None = None,
    ) -> Iterator[tuple[Problem, Array, tuple[Sizes, ...]]]:
        """Models with effects at sizes that share one model, and search vectors that keep the parent's values.

        What would move faster than the recordings can show is left out.

        Args:
            effects: in the models.
            group: sizes of each of them, by model.
            parent: values.
            longest: integration step (s) that what they are put in beside needs; each model is followed where it goes
                to find its own, if None.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        made = self.build(effects, group[0])
        for sizes in group:
            x = _placed(made, parent, effects, sizes)
            stepped = resolved(made, x)
            if stepped is None:
                continue
            if longest is None or stepped.internal_step is None:
                yield followed(stepped, x), x, sizes
            else:
                yield replace(stepped, internal_step=min(stepped.internal_step, longest)), x, sizes

    def origin(self, effects: tuple[Candidate, ...], values: dict[str, float]) -> Origin | None:
        """The model with effects at the first of their sizes, to screen others from; None where it has no tangents.

        Args:
            effects: in it.
            values: of the parameters.
        """
        key = " ".join(
            [
                self.mark,
                *(f"{c.key} {c.option}" for c in effects),
                repr([c.starts[0] for c in effects]),
                repr(sorted(values.items())),
            ]
        )
        if key not in self._origins:
            built = tuple(c.starts[0] for c in effects)
            made = self.build(effects, built) if effects else self.coarse
            x = _placed(made, values, effects, built)
            made = followed(resolved(made, x) or made, x)
            try:
                self._origins[key] = Origin(self, made, x, effects, built)
            except SimulationError:
                self._origins[key] = None
        return self._origins[key]

    def forget(self) -> None:
        """Drop what `origin` keeps of models with effects: tangents take room, and these are not asked for again."""
        for key in [key for key, o in self._origins.items() if o is not None and o.effects]:
            del self._origins[key]

    def partial_fit(self, effects: tuple[Candidate, ...], parents: Sequence[dict[str, float]]) -> PartialFit:
        """Put an effect in beside others, and take a few steps from the sizes that promise most.

        Args:
            effects: the new one last; those before it, at the first of their sizes, are in the model already.
            parents: parameters to begin from, such as those of the refit and those given.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        starts = hashlib.sha256(repr([*(c.starts for c in effects), *parents]).encode()).hexdigest()[:16]
        key = " ".join(["partial fit", *(f"{c.key} {c.option}" for c in effects), starts])
        return self._kept(key, effects, lambda: self.compute_partial_fit(effects, parents))

    def compute_partial_fit(self, effects: tuple[Candidate, ...], parents: Sequence[dict[str, float]]) -> PartialFit:
        """The work of `partial_fit`, done anew whatever is kept.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        points = self._begun(effects, parents)
        if not points:
            raise FlexarmError("at every size it would move faster than these recordings can show")
        tried: list[PartialFit] = []
        with Threads(1) as pool:
            for number, point in enumerate(points):
                # A bold start has farther to go.
                steps = SEARCH.first_steps if number < SEARCH.starts else SEARCH.bold_steps
                there, least = point.problem, min((partial.point.cost for partial in tried), default=math.inf)
                x, cost, converged = descend(
                    there,
                    point.x,
                    there.training,
                    pool,
                    iterations=steps,
                    least_gain=SEARCH.slow,
                    noise="white",
                    reach=least,  # only the best start goes on
                )
                end = replace(point, x=x, cost=cost)
                tried.append(PartialFit(effects, end, converged, self.mark, begun=point.x))
        best = self._acting(min(tried, key=lambda partial: partial.point.cost))
        # A size that is only chosen takes no steps, and would stand where it began among others that did; one that is
        # in already has taken the place of what is put in now.
        return self._refined(best)

    def _acting(self, partial: PartialFit) -> PartialFit:
        """The partial fit, or one begun from where all sizes of the last effect act, if that comes lower.

        A limit beyond all commands has no slope to say how much nearer it belongs, and other parameters may have made
        up for it. So steps are taken anew from the nearest of its starting sizes at which recordings answer to it.
        """
        effect = partial.effects[-1]
        own = {f"{effect.name}.{size}": size for size in effect.starts[0]}
        for number, f in enumerate(partial.point.problem.free):
            size, point = own.get(f.name), partial.point
            if size is None or not _is_idle(point, number):
                continue
            able = {start[size] for start in effect.starts if not f.logarithmic or start[size] * f.start > 0}
            there = sorted(map(f.position, able), key=lambda x: abs(x - point.x[number]))
            rows = (np.where(np.arange(len(point.x)) == number, x, point.x) for x in there)
            begun = next((x for x in rows if not _is_idle(replace(point, x=x), number)), None)
            if begun is not None:
                start = replace(partial, point=replace(point, x=begun))
                again = self._descended(start, noise="white", steps=SEARCH.first_steps)
                partial = again if again.point.cost < point.cost else partial
        return partial

    def _begun(self, effects: tuple[Candidate, ...], parents: Sequence[dict[str, float]]) -> list[StartingPoint]:
        """The starting points to fit, the best first, and last those that have farther to go.

        Parameters that are bent for want of the effect leave little, and would take all turns: the best start from each
        of the parents is among them.
        """
        *before, new = effects
        bold: list[StartingPoint] = []
        each: list[list[StartingPoint]] = []
        for values in parents:
            points: list[StartingPoint] = []
            if new.wave and len(new.starts) > 1 and not self.tables:
                # Coarse recordings, to which the steps are taken, do not tell the order of a wave that is as fast.
                points += solved(self, effects, len(before), values)[:1]
            elif all(len(c.starts) == 1 for c in effects):
                only = tuple(c.starts[0] for c in effects)
                for made, x, sizes in self.placed(effects, [only], values):
                    cost = made.cost(x, made.training, noise="white")
                    points.append(StartingPoint(cost, made, x, sizes, only))
            else:
                with counted():
                    origin = self.origin(tuple(before), values)
                    found = begun(origin, new, SEARCH.starts, bold=not before) if origin else []
                points += found[: SEARCH.starts]
                bold += found[SEARCH.starts :][:1]
            each.append(sorted(points, key=lambda point: point.cost))
        ranked = sorted(itertools.chain(*each), key=lambda point: point.cost)
        first = ranked[: SEARCH.starts]
        others = [points[0] for points in each if points and not any(p is q for p in points for q in first)]
        return [*first, *others, *bold[:1]]

    def finish(self, partial: PartialFit, reach: float = math.inf) -> ScoredModel:
        """Finish a partial fit until it converges, or `SEARCH.most_steps` are taken, and score it.

        Args:
            partial: which.
            reach: cost of the whole recordings that is to be reached, as of `descend`.

        Raises:
            SimulationError: it fits coarse recordings where it cannot be simulated or differentiated on the whole ones.
        """
        point = partial.point
        names = [f"{c.key} {c.option}" for c in partial.effects]
        begun = " ".join([partial.around, "finish", *names, repr(point.sizes), _mark(point.x)])
        aim, made = self._finished.get(begun, (-math.inf, None))
        left_early = made is not None and made.fit.cost > aim
        if made is None or (left_early and reach > aim):
            key = f"{begun} to {reach!r}" if math.isfinite(reach) else begun
            maker = self._around[partial.around]
            made = self._trial(maker._kept(key, partial.effects, lambda: maker.compute_finish(partial, reach)))
            self._finished[begun] = reach, made
        return made

    def retried(self, model: ScoredModel, reach: float = math.inf) -> ScoredModel:
        """A model fitted again from points around where its fit ended, or as it is if none of them leads lower.

        Contacts that bounce make a cost so rough that a fit ends on its way; a little beside, it goes on. So an end
        counts as converged only if a second try ends as low, and if two do, no further one is made.

        Args:
            model: which.
            reach: cost that is to be reached, as of `descend`.
        """
        made = end_of(model)

        def compute() -> PartialFit:
            best, ends = made, [made.cost]
            random = np.random.default_rng(self.seed)
            for _ in range(SEARCH.retries):
                there = best.x + random.normal(0.0, SEARCH.around, len(best.x))
                with Threads(self.workers) as pool:
                    # What does not come as low says nothing, however low it is.
                    aim = min(min(ends) + SEARCH.slow, reach)
                    x, cost, _ = descend(made.problem, there, made.problem.training, pool, reach=aim)
                ends.append(cost)
                if cost < best.cost:
                    best = replace(made, x=x, cost=cost)
                if sum(end - best.cost < SEARCH.slow for end in ends) > 2:
                    break
            lowest, second, *_ = sorted(ends)
            return PartialFit(model.effects, best, second - lowest < SEARCH.slow)

        key = f"retried {model.label} {_mark(made.x)} to {reach!r}"
        return self._trial(self._kept(key, model.effects, compute))

    def compute_finish(self, partial: PartialFit, reach: float = math.inf) -> PartialFit:
        """The work of `finish`, done anew whatever is kept and not scored.

        Raises:
            SimulationError: as of `finish`.
        """
        return self._whole(partial, self._coloured(self._in_step(partial), reach), reach)

    def _in_step(self, partial: PartialFit) -> PartialFit:
        """The partial fit fitted with white noise; from the beginning of the recordings, if that leaves less.

        It is tried where much is left, and given up where it would not come as low.
        """
        there = self._descended(partial, noise="white")
        made = there.point.problem
        if self.tables or made.chi2(there.point.x, made.training) < EVIDENCE.stated:
            return there
        begun = replace(partial.point, x=doubled(partial.point.problem, partial.point.x), cost=math.inf)
        again = self._descended(replace(partial, point=begun), noise="white", reach=there.point.cost)
        return again if again.point.cost < there.point.cost else there

    def _coloured(self, there: PartialFit, reach: float) -> PartialFit:
        """A fit with white noise fitted with coloured noise, sizes that are only chosen too.

        Args:
            there: where it ended.
            reach: as of `finish`, where recordings are not coarse.
        """
        reach = reach if self.coarse is self.base else math.inf
        there = self._descended(there, reach=reach)
        finer = self._refined(there, noise="coloured")
        return finer if finer is there or self.coarse is not self.base else self._descended(finer, reach=reach)

    def _whole(self, partial: PartialFit, finer: PartialFit, reach: float) -> PartialFit:
        """A fit to coarse recordings fitted to the whole ones.

        Args:
            partial: where it began.
            finer: where it ended.
            reach: as of `finish`.

        Raises:
            SimulationError: as of `finish`.
        """
        if self.coarse is self.base:
            return self._back_in_step(partial, finer, finer, reach)
        for end in (finer, partial):
            whole = self._descended(end, whole=True, reach=reach)
            if whole is not end:
                whole = self._back_in_step(partial, end, whole, reach)
                if whole.point.cost > reach:
                    return whole
                # What coarse recordings say of a size is right near the model that they are made coarse around.
                closer = self._refined(whole, noise="coloured")
                return whole if closer is whole else self._descended(closer, whole=True, reach=reach)
        # Coarse recordings have fewer samples to leave something over of: a model judged on them would win.
        raise SimulationError("it follows coarse recordings only, at sizes at which it cannot follow the whole ones")

    def _back_in_step(
        self, partial: PartialFit, rough: PartialFit, whole: PartialFit, reach: float = math.inf
    ) -> PartialFit:
        """The fit to whole recordings, again from their beginnings if it leaves more than noise and that is likelier.

        Coarse recordings do not serve: what they are corrected by is right near the model that told it, and a fit that
        has lost its way is not near. Nor do the few steps over all of them, which have led away: it begins again where
        they began, and where they ended only if the recordings are not followed from there. If they are not followed at
        all, all are doubled together where whole ones leave more than coarse ones: averages of several samples show a
        mismatch as clearly, unless it is faster than they are. What is smooth has not lost its way.

        Args:
            partial: where it began.
            rough: where it ended on coarse recordings.
            whole: where it ended.
            reach: as of `finish`.
        """
        made, end = whole.point.problem, rough.point
        left = made.chi2(whole.point.x, made.training)
        if self.tables or left < EVIDENCE.stated or self._is_smooth(partial.effects, whole.point):
            return whole
        x = grown(made, [x for x in (partial.begun, partial.point.x) if x is not None])
        if x is None:
            if left < SEARCH.lost * max(end.problem.chi2(end.x, end.problem.training), 1.0):
                return whole
            x = doubled(made, end.x)
        reach = min(reach, whole.point.cost)
        with Threads(1) as pool:
            x, cost, converged = descend(
                made, x, made.training, pool, iterations=SEARCH.most_steps, least_gain=SEARCH.slow, reach=reach
            )
        if not cost < whole.point.cost:
            return whole  # the fit was left on its way: how likely it is there says nothing
        return self._likelier([whole, replace(whole, point=replace(whole.point, x=x, cost=cost), converged=converged)])

    @staticmethod
    def _is_smooth(effects: Sequence[Candidate], point: StartingPoint) -> bool:
        """Whether a run does not hang on where it was before: what lacks physics there has not lost its way.

        Its tangents foretell how whole recordings answer. Those of a wave out of step do, too, for it is nearly gone.
        """
        made = point.problem
        return all(c.wave is None for c in effects) and foretell(made, point.x, made.training)

    def _likelier(self, ends: Sequence[PartialFit]) -> PartialFit:
        """The first of several ends of a fit, or a later one that leaves less of all recordings and is likelier."""
        best, *others = ends
        for other in others:
            known, new = self._trial(best), self._trial(other)
            if new.log_evidence > known.log_evidence and new.squares < known.squares:
                best = other
        return best

    def _descended(
        self,
        partial: PartialFit,
        *,
        whole: bool = False,
        noise: Noise = "coloured",
        reach: float = math.inf,
        steps: int = SEARCH.most_steps,
    ) -> PartialFit:
        """The partial fit fitted until it converges or hardly gains: to coarse recordings, or to all."""
        point = partial.point
        made = self.build(partial.effects, point.built, whole=True) if whole else point.problem
        made, x = followed(resolved(made, point.x) or made, point.x), point.x
        for _ in range(2):
            with Threads(1) as pool:
                x, cost, converged = descend(
                    made,
                    x,
                    made.training,
                    pool,
                    iterations=steps,
                    least_gain=SEARCH.slow,
                    noise=noise,
                    reach=reach,
                )
            if not math.isfinite(cost):  # it stands where the model cannot be differentiated
                return partial
            there = followed(made, x)
            if there.internal_step == made.internal_step:
                break
            made = there  # the fit has gone where the model is stiffer
        return replace(partial, point=replace(point, problem=made, x=x, cost=cost), converged=converged)

    def _refined(self, partial: PartialFit, *, noise: Noise = "white") -> PartialFit:
        """The partial fit with sizes that are only chosen, such as a delay, moved to where they fit best."""
        for k, effect in enumerate(partial.effects):
            gained = math.inf
            while effect.finer is not None and gained > SEARCH.slow:
                closer = self._closer(partial, k, noise)
                gained = partial.point.cost - closer.point.cost
                partial = closer
        return partial

    def _closer(self, partial: PartialFit, k: int, noise: Noise) -> PartialFit:
        """The partial fit with such a size of the k-th effect where it fits best, if that is better.

        The parameters follow by the tangents of the fit as it is, which hold near it: where what they promise is not
        kept, it is looked for nearer.
        """
        best, finer = partial.point, partial.effects[k].finer
        whole = not any(e.coarse for e in best.problem.experiments)
        assert finer is not None

        def built(sizes: Sizes) -> Problem:
            made = self.build(partial.effects, _with(best.built, k, sizes), whole=whole)
            return replace(made, internal_step=best.problem.internal_step)

        def at(share: float) -> Problem | None:
            sizes = finer(best.sizes[k], share)
            return built(sizes) if sizes else None

        with Threads(1) as pool:
            try:
                near = Nearby(best.problem, best.x, pool, noise=noise)
            except SimulationError:
                return partial
            within = SEARCH.finer
            while within:
                share, there = near.sought(at, within)
                sizes = finer(best.sizes[k], share)
                if there is near.known or sizes is None:
                    break
                made = built(sizes)
                x, cost, converged = descend(
                    made, there.x, made.training, pool, iterations=SEARCH.first_steps, noise=noise, reach=best.cost
                )
                if cost < best.cost:
                    point = StartingPoint(cost, made, x, _with(best.sizes, k, sizes), _with(best.built, k, sizes))
                    return replace(partial, point=point, converged=converged)
                within = tuple(far for far in within[1:] if 2 * far < abs(share))
        return partial


def _is_idle(point: StartingPoint, number: int) -> bool:
    """Whether no recording answers to a search variable where a fit stands."""
    made = point.problem
    try:
        return not any(made.linearised(point.x, e, [number])[1][:, number].any() for e in made.training)
    except SimulationError:
        return False


def _with(kept: tuple[Sizes, ...], k: int, sizes: Sizes) -> tuple[Sizes, ...]:
    """The sizes of several effects, those of the k-th exchanged."""
    return tuple(sizes if j == k else s for j, s in enumerate(kept))


def _with_values(point: StartingPoint, values: dict[str, float]) -> Array:
    """The search vector of a point with values by name, where it has such parameters."""
    there = [(f, values.get(place_of(f)), x) for f, x in zip(point.problem.free, point.x, strict=True)]
    return np.array([x if value is None else f.position(value) for f, value, x in there])


def _mark(x: Array) -> str:
    """A search vector in a few letters, to tell fits that begin there from others."""
    return hashlib.sha256(np.ascontiguousarray(x).tobytes()).hexdigest()[:16]


def end_of(model: ScoredModel) -> StartingPoint:
    """Where the fit of a model ended, to go on from."""
    began = {f.name: f.start for f in model.fit.problem.free}
    built = tuple(
        {key: began.get(f"{c.name}.{key}", value) for key, value in sizes.items()}
        for c, sizes in zip(model.effects, model.sizes, strict=True)
    )
    return StartingPoint(model.fit.cost, model.fit.problem, model.fit.x, model.sizes, built)


def _digest(base: Problem, seed: int) -> str:
    """What every fit depends on: the model, the data, what may move, the rules, and the random seed."""
    rules = f"{FITTING} {COARSE} {SEARCH}"
    found = hashlib.sha256(f"{base.model.signature} {base.free} {base.internal_step} {rules} {seed}".encode())
    for e in base.experiments:
        found.update(f"{e.name} {e.role}".encode())
        for part in e.fingerprint():
            found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def _placed(made: Problem, parent: dict[str, float], effects: Sequence[Candidate], sizes: Sequence[Sizes]) -> Array:
    """The search vector that keeps the parent's parameters and gives the effects their sizes."""
    x = np.zeros(len(made.free))
    given = {f"{c.name}.{key}": value for c, s in zip(effects, sizes, strict=True) for key, value in s.items()}
    for i, f in enumerate(made.free):
        value = parent.get(place_of(f)) if f.recording else given.get(f.name, parent.get(f.name))
        if value is not None:
            x[i] = f.position(value)
    return x
