"""Where models with effects in them are built and fitted."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.least_squares import Fit, descend, fit
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem, counted
from diagnosis.problems import problem, resolved, variant
from diagnosis.recordings.types import Recorded
from diagnosis.search.partial_fit import PartialFit, StartingPoint, ended, ended_at
from diagnosis.search.scored_model import ScoredModel, scored
from diagnosis.search.wave_starts import solved
from diagnosis.thresholds import INSERTION
from engine.errors import FlexarmError
from engine.spread import Store
from engine.threads import Threads
from scenarios.load import Scenario


class CandidateFitter:
    """Builds and fits models of a study, with a bounded number of threads.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.
        seed: of everything random.
        store: keeps every fit, so that a study that was interrupted goes on where it was.
    """

    def __init__(
        self,
        scenario: Scenario,
        recordings: Sequence[Recorded],
        workers: int = 2,
        seed: int = 0,
        store: Store | None = None,
    ) -> None:
        self.scenario, self.recordings, self.store = scenario, tuple(recordings), store
        self.workers, self.seed = workers, seed
        self.base = problem(scenario, self.recordings)
        self.tables = self.base.sparse
        self.digest = _digest(self.base, seed)

    def again(self, recordings: Sequence[Recorded]) -> CandidateFitter:
        """The same with other recordings."""
        return CandidateFitter(self.scenario, recordings, self.workers, self.seed, self.store)

    def refit(self) -> ScoredModel:
        """The user's own model, its parameters fitted from several starts."""

        def compute() -> PartialFit:
            made = fit(self.base, random_starts=2, seed=self.seed, workers=self.workers)
            return PartialFit((), StartingPoint(made.cost, self.base, made.x, (), ()), made.converged)

        partial = self._kept("refit", (), compute)
        return self._trial(partial)

    def _kept(self, key: str, effects: tuple[Candidate, ...], compute: Callable[[], PartialFit]) -> PartialFit:
        """What ``compute`` gives, or what it gave before under the same key."""
        key = f"{self.digest} {key}"
        if self.store is None or key not in self.store:
            partial = compute()
            if self.store is not None:
                self.store[key] = partial.row()
            return partial
        return self.restored(effects, self.store[key])

    def restored(self, effects: tuple[Candidate, ...], row: dict[str, Any]) -> PartialFit:
        """The partial fit that was written down by `PartialFit.row`."""
        made = self.build(effects, row["built"]) if effects else self.base
        made = replace(made, internal_step=row["internal_step"])
        point = StartingPoint(row["cost"], made, np.array(row["x"]), tuple(row["sizes"]), tuple(row["built"]))
        return PartialFit(effects, point, row["converged"])

    def _trial(self, partial: PartialFit) -> ScoredModel:
        """A partial fit as it is, scored."""
        made, x = partial.point.problem, partial.point.x
        chi2 = made.fitted_chi2(x, partial.point.cost)
        n = len(x)
        found = Fit(made, x, partial.point.cost, chi2, partial.converged, np.zeros((n, n)))
        return scored(found, partial.effects, partial.point.sizes)

    def build(self, effects: Sequence[Candidate], starts: Sequence[dict[str, float]]) -> Problem:
        """The problem with effects put in at starting values.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        edits = [edit for c, s in zip(effects, starts, strict=True) for edit in c.edits(s)]
        extra = [f for c, s in zip(effects, starts, strict=True) for f in c.free(s)]
        return variant(self.base, edits, extra, held={f"{c.name}.{key}" for c in effects for key in c.held})

    def partial_fit(self, effects: tuple[Candidate, ...], start: Fit) -> PartialFit:
        """Put effects in, try their starting sizes from the parent's optimum, and take a few steps from the best.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        key = " ".join(["partial fit", *(c.key for c in effects), *(repr(c.starts) for c in effects), _hash(start.x)])
        return self._kept(key, effects, lambda: self.compute_partial_fit(effects, start.parameters()))

    def compute_partial_fit(self, effects: tuple[Candidate, ...], parent: dict[str, float]) -> PartialFit:
        """The work of `partial_fit`, done anew whatever is kept.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        points = []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            points += self.points(effects, chosen, parent)
        if not points:
            raise FlexarmError("at every size it would move faster than these recordings can show")
        points.sort(key=lambda point: point.cost)
        bold = self.points(effects, [effects[0].bold], parent) if len(effects) == 1 and effects[0].bold else []
        tried = []
        with Threads(1) as pool:
            begun = [*self._begun(effects, points, parent), *bold]
            most = INSERTION.settles if len({id(point.problem.model) for point in begun}) > 1 else INSERTION.first_steps
            for point in begun:
                training = point.problem.training
                x, cost, converged = descend(
                    point.problem, point.x, training, pool, iterations=most, relative_drop=INSERTION.least_gain
                )
                tried.append(PartialFit(effects, replace(point, x=x, cost=cost), converged))
        return min(tried, key=lambda partial: partial.point.cost)

    def _begun(
        self, effects: tuple[Candidate, ...], points: Sequence[StartingPoint], parent: dict[str, float]
    ) -> list[StartingPoint]:
        """The starting points to fit; ``points`` start from the parent's parameters, best first."""
        # A wave that goes on from where a fit ended needs no other start.
        waves = [k for k, c in enumerate(effects) if c.wave and len(c.starts) > 1]
        if waves and not self.tables:
            single = len(effects) == 1
            begun = [
                e
                for k in waves
                for e in solved(self, effects, k, parent)[: INSERTION.orders if single else INSERTION.orders_beside]
            ]
            if not single:
                return [*begun, *_spread(points)[:1]]
            # A wave that moves the model far is not solved for by tangents: then every order is tried from the others.
            near = any(point.cost < INSERTION.solution * counted(point.problem.training) for point in begun)
            return [*begun, *_spread(points)[: INSERTION.starts if near else None]]
        if not self.tables or len(effects) > 1:
            return _spread(points)
        # A few rows let the refit bend parameters that the effect would leave as they were given: begin there too.
        given: list[StartingPoint] = []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            given += self.points(effects, chosen, {})
        return [points[0], min(given, key=lambda point: point.cost)]

    def points(
        self, effects: tuple[Candidate, ...], groups: Sequence[Sequence[Sizes]], parent: dict[str, float]
    ) -> list[StartingPoint]:
        """Starting sizes that share one model, each with its cost."""
        built = tuple(group[0] for group in groups)
        made, rows = self.build(effects, built), []
        for sizes in itertools.product(*groups):
            x = _placed(made, parent, effects, sizes)
            stepped = resolved(made, x)
            if stepped is not None:
                rows.append(StartingPoint(_glance(stepped, x), stepped, x, sizes, built))
        return rows

    def reduced(self, trial: ScoredModel, kept: Candidate) -> ScoredModel:
        """One effect of a trial alone, from where the trial ended.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        alone = ended(trial, kept)
        made = self.finish(self.partial_fit((alone,), trial.fit))
        return replace(made, effects=(kept,))

    def finish(self, partial: PartialFit, iterations: int = INSERTION.most_steps) -> ScoredModel:
        """Finish a partial fit until it converges, and score it; with no iterations left it is scored as it is."""
        if not iterations:
            return self._trial(partial)
        key = " ".join(["finish", *(c.key for c in partial.effects), str(iterations), _hash(partial.point.x)])
        return self._trial(self._kept(key, partial.effects, lambda: self.compute_finish(partial, iterations)))

    def compute_finish(self, partial: PartialFit, iterations: int) -> PartialFit:
        """The work of `finish`, done anew whatever is kept and not scored."""
        partial = self._descended(self._refined(partial), iterations)
        for k, effect in enumerate(partial.effects):
            if effect.wave and len(effect.starts) == 1 and len(partial.effects) > 1 and not self.tables:
                partial = self._reordered(partial, k, iterations)
        return partial

    def _descended(self, partial: PartialFit, iterations: int) -> PartialFit:
        """The partial fit fitted until it converges."""
        if partial.converged:
            return partial
        point = partial.point
        made = resolved(point.problem, point.x) or point.problem
        with Threads(1) as pool:
            training = made.training
            x, cost, converged = descend(made, point.x, training, pool, iterations=iterations)
        if not math.isfinite(cost):
            return partial  # it stands where the model cannot be differentiated
        return PartialFit(partial.effects, replace(point, problem=made, x=x, cost=cost), converged)

    def _reordered(self, partial: PartialFit, k: int, iterations: int) -> PartialFit:
        """The partial fit with its wave solved for anew beside the other effect, or as it is if no order does better.

        Alone, a wave may fit best at an order that makes up for what the other effect does.
        """
        point, effects = partial.point, partial.effects
        values = point.problem.values(point.x)[0]
        there = [ended_at(c, values, sizes) for c, sizes in zip(effects, point.sizes, strict=True)]
        tried = [partial]
        for begun in solved(self, there, k, values)[: INSERTION.orders_beside]:
            training = begun.problem.training
            with Threads(1) as pool:
                x, cost, converged = descend(
                    begun.problem,
                    begun.x,
                    training,
                    pool,
                    iterations=INSERTION.settles,
                    relative_drop=INSERTION.least_gain,
                )
            tried.append(PartialFit(effects, replace(begun, x=x, cost=cost), converged))
        best = min(tried, key=lambda made: made.point.cost)
        return best if best is partial else self._descended(best, iterations)

    def _refined(self, partial: PartialFit) -> PartialFit:
        """The partial fit with sizes that are only chosen, such as a delay, moved to where they fit best."""
        for k, effect in enumerate(partial.effects):
            for share in INSERTION.finer if effect.finer else ():
                best = partial.point
                for sizes in effect.finer(best.sizes[k], share) if effect.finer else ():
                    chosen = tuple(sizes if j == k else s for j, s in enumerate(best.sizes))
                    built = tuple(sizes if j == k else s for j, s in enumerate(best.built))
                    made = self.build(partial.effects, built)
                    training = made.training
                    with Threads(1) as pool:
                        x, cost, converged = descend(
                            made,
                            best.x,
                            training,
                            pool,
                            iterations=INSERTION.first_steps,
                            relative_drop=INSERTION.least_gain,
                        )
                    if cost < partial.point.cost:
                        partial = PartialFit(partial.effects, StartingPoint(cost, made, x, chosen, built), converged)
        return partial

    def polish(self, trial: ScoredModel) -> ScoredModel:
        """The same model, fitted until it converges."""
        made = trial.fit
        if made.converged:
            return trial
        training = made.problem.training
        with Threads(self.workers) as pool:
            x, cost, converged = descend(made.problem, made.x, training, pool, iterations=INSERTION.polishing_steps)
        if not cost < made.cost:
            return trial  # it ended where the model cannot be differentiated
        return self._trial(
            PartialFit(trial.effects, StartingPoint(cost, made.problem, x, trial.sizes, trial.sizes), converged)
        )


def _hash(x: Array) -> str:
    return hashlib.sha256(np.ascontiguousarray(x).tobytes()).hexdigest()[:16]


def _digest(base: Problem, seed: int) -> str:
    """What every fit depends on: the model, the data, what may move, and the random seed."""
    found = hashlib.sha256(f"{base.model.signature} {base.free} {base.internal_step} {seed}".encode())
    for e in base.experiments:
        found.update(f"{e.name} {e.role}".encode())
        for part in e.fingerprint():
            found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def _glance(made: Problem, x: Array) -> float:
    """The cost over the first part of the training recordings."""
    return made.cost(x, [e.cut(INSERTION.glance) for e in made.training]) + made.prior_cost(x)


def _spread(points: Sequence[StartingPoint]) -> list[StartingPoint]:
    """The best starting points at least `INSERTION.apart` from each other; of discrete sizes, one each."""
    models: dict[int, StartingPoint] = {}
    for point in points:
        models.setdefault(id(point.problem.model), point)
    chosen = list(models.values())[: INSERTION.structures] if len(models) > 1 else []
    for point in points:
        if len(chosen) >= INSERTION.starts:
            break
        if all(_apart(point, other) for other in chosen):
            chosen.append(point)
    return chosen


def _apart(one: StartingPoint, other: StartingPoint) -> bool:
    return one.problem.model is not other.problem.model or float(np.abs(one.x - other.x).max()) > INSERTION.apart


def _placed(
    made: Problem, parent: dict[str, float], effects: Sequence[Candidate], sizes: Sequence[dict[str, float]]
) -> Array:
    """The search vector that keeps the parent's parameters and gives the effects their sizes."""
    x = np.zeros(len(made.free))
    given = {f"{c.name}.{key}": value for c, s in zip(effects, sizes, strict=True) for key, value in s.items()}
    for i, f in enumerate(made.free):
        value = given.get(f.name, parent.get(f.name)) if not f.recording else None
        if value is not None:
            x[i] = f.position(value)
    return x
