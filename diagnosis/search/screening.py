"""What an effect promises before it is fitted: its course beside what the model's own parameters can do.

Near a fitted model an effect of some size adds a known course to the residual, and the model's own parameters add their
tangents, held by their tolerances. How much of the residual the best combination takes away is a linear least-squares
problem: it says which effects, and which two together, are worth a fit, and from which size and parameters to begin.
Two that are missing may hide each other, so that neither promises much alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.search.partial_fit import Builder, StartingPoint, place_of
from diagnosis.thresholds import FITTING, SEARCH
from engine.errors import FlexarmError


@dataclass(frozen=True)
class Course:
    """What an effect of some size adds to a residual, beside the tangents of the model's own parameters.

    Attributes:
        effect, sizes: which.
        values: change of the residual, training recordings and prior stacked, less what the parameters can make good.
        gain: how much of the cost it takes away with a factor within `SEARCH.factor` of one.
        change: of the search vector that goes with that.
    """

    effect: Candidate
    sizes: Sizes
    values: Array
    gain: float
    change: Array


class Origin:
    """A model and parameters around which effects are screened.

    Args:
        problem: the model.
        x: its search vector, shape (n,).
        effects: in it already, with the sizes that it was built with.

    Raises:
        SimulationError: it cannot be differentiated there.
    """

    def __init__(
        self, problem: Problem, x: Array, effects: Sequence[Candidate] = (), built: Sequence[Sizes] = ()
    ) -> None:
        self.problem, self.x = problem, x
        self.effects, self.built = tuple(effects), tuple(built)
        self.values = {place_of(f): f.value(v) for f, v in zip(problem.free, x, strict=True)}
        self.kept: dict[str, list[Course]] = {}
        self.every = max(1, sum(len(e.time) for e in problem.training) // SEARCH.samples)
        parts = []
        for e in problem.training:
            r, J = problem.linearised(x, e)
            rows = r.reshape(e.measured.shape)[:: self.every].ravel()
            parts.append((rows, J.reshape(*e.measured.shape, -1)[:: self.every].reshape(len(rows), -1)))
        own = problem.prior(x)
        # Of thinned recordings each row stands for several.
        whole = np.sqrt(self.every)
        self.r = np.concatenate([*(whole * r for r, _ in parts), own[0]])
        self.J = np.vstack([*(whole * J for _, J in parts), own[1]])
        self.basis, self.upper = np.linalg.qr(self.J)
        self.rest = self.r - self.basis @ (self.basis.T @ self.r)
        self.cost = float(self.rest @ self.rest)
        """What is left after a step of the model's own parameters."""

    def course(self, made: Problem, x: Array, effect: Candidate, sizes: Sizes) -> Course | None:
        """What a size adds; None where it cannot be simulated, or adds nothing.

        Args:
            made: the model with the effect.
            x: the origin's parameters and the effect's sizes there.
            effect: which.
            sizes: its own.
        """
        rows = [made.residual(x, e)[:: self.every].ravel() for e in made.training]
        added = np.sqrt(self.every) * np.concatenate(rows) - self.r[: sum(len(r) for r in rows)]
        if np.abs(added).max() > FITTING.huge / 10 or not float(added @ added) > 0:
            return None
        added = np.concatenate([added, np.zeros(len(self.r) - len(added))])
        values = added - self.basis @ (self.basis.T @ added)
        power, pull = float(values @ values), -float(values @ self.rest)
        factor = min(max(pull / power if power > 0 else 1.0, 0.1 / SEARCH.factor), SEARCH.factor)
        gain = factor * (2 * pull - factor * power)
        change = -np.linalg.lstsq(self.upper, self.basis.T @ (self.r + factor * added), rcond=1e-10)[0]
        return Course(effect, sizes, values, gain, np.clip(change, -SEARCH.farthest, SEARCH.farthest))


def courses(builder: Builder, origin: Origin, effect: Candidate) -> list[Course]:
    """The courses of an effect at its starting sizes, those that promise most first; computed once.

    Args:
        builder: builds models.
        origin: where.
        effect: which.
    """
    key = f"{effect.key} {effect.option} {effect.starts}"
    if key in origin.kept:
        return origin.kept[key]
    found = []
    for group in effect.structures():
        try:
            made = builder.placed((*origin.effects, effect), [(*origin.built, sizes) for sizes in group], origin.values)
            for model, x, sizes in made:
                course = origin.course(model, x, effect, sizes[-1])
                if course is not None:
                    found.append(course)
        except FlexarmError:
            continue
    origin.kept[key] = sorted(found, key=lambda course: -course.gain)
    return origin.kept[key]


def begun(builder: Builder, origin: Origin, effect: Candidate, most: int) -> list[StartingPoint]:
    """Where to begin the fit of an effect beside an origin: the sizes that promise most, each with its true cost.

    The model's own parameters begin where the linear problem puts them, or stay where that is worse.
    """
    rows: list[StartingPoint] = []
    taken = 0
    for course in courses(builder, origin, effect):
        if taken >= most:
            break
        together, built = (*origin.effects, effect), (*origin.built, course.sizes)
        for model, x, sizes in builder.placed(together, [built], origin.values):
            moved = x.copy()
            names = [(f.name, f.recording) for f in model.free]
            for f, change in zip(origin.problem.free, course.change, strict=True):
                if (f.name, f.recording) in names:
                    moved[names.index((f.name, f.recording))] += change
            able = [
                (model.cost(there, model.training) + model.prior_cost(there), k) for k, there in enumerate((x, moved))
            ]
            cost, k = min(able)
            rows.append(StartingPoint(cost, model, (x, moved)[k], sizes, sizes))
            taken += 1
    return sorted(rows, key=lambda point: point.cost)


def together(found: Sequence[Course], origin: Origin, count: int) -> list[tuple[Candidate, ...]]:
    """The pairs of effects that take most of the residual away, to start from the sizes that do, the best first.

    Args:
        found: courses of all effects around one origin.
        origin: it.
        count: largest number of pairs.
    """
    if len(found) < 2:
        return []
    table = np.column_stack([course.values for course in found])
    gram, pull = table.T @ table, -table.T @ origin.rest
    return list(itertools.islice(_ranked(found, *_gains(gram, pull)), count))


def _gains(gram: Array, pull: Array) -> tuple[Array, Array]:
    """For each pair of courses, how much of the cost they take away, and how far their factors are from 1.

    Nothing where a factor is out of reach; the distance is the sum of the logarithms' magnitudes.
    """
    own = np.diag(gram)
    whole = np.outer(own, own)
    determinant = whole - gram**2
    determinant = np.where(determinant > 1e-9 * whole, determinant, np.inf)
    first = (own[None, :] * pull[:, None] - gram * pull[None, :]) / determinant
    second = first.T
    low, high = 1 / SEARCH.factor_of_two, SEARCH.factor_of_two
    able = (first > low) & (first < high) & (second > low) & (second < high)
    gains = np.where(able, first * pull[:, None] + second * pull[None, :], 0.0)
    far = np.abs(np.log(np.where(able, first, 1.0))) + np.abs(np.log(np.where(able, second, 1.0)))
    return gains, far


def _ranked(found: Sequence[Course], gains: Array, far: Array) -> Iterator[tuple[Candidate, ...]]:
    """Pairs of different effects, best first, a few places of a kind, to start from the sizes that are asked for."""
    keys = [course.effect.key for course in found]
    groups: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for a, b in zip(*np.nonzero(np.triu(gains, 1) > 0), strict=True):
        if found[a].effect.effect != found[b].effect.effect:
            groups.setdefault((keys[a], keys[b]), []).append((int(a), int(b)))
    best = {key: max(float(gains[at]) for at in group) for key, group in groups.items()}
    kinds: dict[frozenset[str], int] = {}
    for key in sorted(groups, key=lambda key: -best[key]):
        one, other = (found[k].effect for k in groups[key][0])
        kind = frozenset((one.effect, other.effect))
        kinds[kind] = kinds.get(kind, 0) + 1
        if kinds[kind] > SEARCH.places:
            continue
        able = [at for at in groups[key] if gains[at] > 0.8 * best[key]]
        a, b = min(able, key=lambda at: far[at])
        yield tuple(replace(found[k].effect, starts=(found[k].sizes,)) for k in (a, b))
