"""What an effect promises before it is fitted: its course beside what the model's own parameters can do.

Near a fitted model an effect of some size adds a known course to the residual, and the model's own parameters add their
tangents, held by their tolerances. How much of the residual the best combination takes away is a linear least-squares
problem: it says which effects, and which two together, are worth a fit, and from which size and parameters to begin.
Two that are missing may hide each other, so that neither promises much alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
from diagnosis.search.partial_fit import Builder, StartingPoint, place_of
from diagnosis.thresholds import EVIDENCE, FITTING, SEARCH
from engine.errors import FlexarmError


@dataclass(frozen=True)
class Course:
    """What an effect of some size adds to a residual, beside the tangents of the model's own parameters.

    Attributes:
        effect, sizes: which.
        values: change of the whitened residual, training recordings and prior stacked, less what the parameters can
            make good.
        likelihood: logarithm of the likelihood that it would reach, with coloured noise as of the evidence, its size
            multiplied by the best factor in reach of `SEARCH.factor`.
        change: of the search vector that goes with it.
        least: whether no size of the effect does less: smaller ones are taken to answer in proportion.
    """

    effect: Candidate
    sizes: Sizes
    values: Array
    likelihood: float
    change: Array
    least: bool = False


@dataclass(frozen=True)
class _Added:
    """What a size adds to the whitened residual, the prior's rows at the end, which stay."""

    sizes: Sizes
    values: Array

    @property
    def power(self) -> float:
        """Sum of its squares."""
        return float(self.values @ self.values)


class Origin:
    """A model and parameters around which effects are screened: its residual and tangents, on thinned recordings.

    Args:
        builder: builds the models of other effects beside it.
        problem: the model.
        x: its search vector, shape (n,).
        effects: in it already, with the sizes that it was built with.

    Raises:
        SimulationError: it cannot be differentiated there.
    """

    def __init__(
        self,
        builder: Builder,
        problem: Problem,
        x: Array,
        effects: Sequence[Candidate] = (),
        built: Sequence[Sizes] = (),
    ) -> None:
        self.builder, self.problem, self.x = builder, problem, x
        self.effects, self.built = tuple(effects), tuple(built)
        self.values = {place_of(f): f.value(v) for f, v in zip(problem.free, x, strict=True)}
        self.kept: dict[str, list[Course]] = {}
        self.refused: dict[tuple[str, str], str] = {}
        """Effects that could not be put in here, by key and option, and why."""
        self.every = max(1, sum(len(e.time) for e in problem.training) // SEARCH.samples)
        strengths = problem.leftover(x, problem.training).by_band
        self._whitening = [Whitening(e, strengths, self.every) for e in problem.training]
        parts, self._residuals = [], list[Array]()
        for (r, J), whitening in zip(linearised(problem, x, problem.training), self._whitening, strict=True):
            self._residuals.append(r)
            columns = [whitening(J[:, :, k]) for k in range(J.shape[-1])]
            white = whitening(r)
            parts.append((white, np.column_stack(columns) if columns else np.zeros((len(white), 0))))
        self.own = problem.prior(x)
        self.white = _Linear(parts, self.own)
        self._bands = _Bands(self._whitening, strengths)
        self.likelihood = self._bands.likelihood(self.white.rest)
        """Logarithm of the likelihood that the model's own parameters reach, less what they cost."""

    def likely(self, values: Array) -> float:
        """Logarithm of the likelihood that is reached where a change is added, as of `Course.values`."""
        return self._bands.likelihood(self.white.rest + values)

    def freed(self, effect: Candidate) -> Course:
        """What it gains to free a parameter of its tolerance."""
        assert effect.freed is not None
        i, weaker = [f.name for f in self.problem.free].index(effect.freed.name), 1 / effect.freed.spread
        gain, change = self.white.with_weaker_prior(i, len(self.own[0]), weaker)
        change = np.clip(change, -SEARCH.farthest, SEARCH.farthest)
        return Course(effect, effect.starts[0], np.zeros(len(self.white.r)), self.likelihood + 0.5 * gain, change)

    def added(self, made: Sequence[tuple[Problem, Array, tuple[Sizes, ...]]]) -> list[_Added]:
        """What sizes add; those that cannot be simulated, or add nothing, are left out.

        Args:
            made: one model with the effect, search vectors that keep the origin's parameters, and the effects' sizes,
                those of this one last.
        """
        model = made[0][0]
        runs, found = model.training, list[_Added]()
        residuals = model.residuals_of([(x, e) for _, x, _ in made for e in runs])
        for number, (_, _, sizes) in enumerate(made):
            rows = residuals[number * len(runs) : (number + 1) * len(runs)]
            apart = [np.abs(r - r0).max() for r, r0 in zip(rows, self._residuals, strict=True)]
            if max(apart) <= FITTING.huge / 10:
                whitened = [whitening(r) for whitening, r in zip(self._whitening, rows, strict=True)]
                found.append(_Added(sizes[-1], self.white.added(whitened)))
        return [one for one in found if one.power > 0]

    def course(self, effect: Candidate, added: _Added, least: bool) -> Course:
        """The course of an effect of some size.

        Args:
            effect: which.
            added: what it adds.
            least: whether no other size adds less in the same way, such as with a wave's phase.
        """
        factor, values = self.white.best(added.values, least)
        likelihood = self._bands.likelihood(self.white.rest + factor * values)
        return Course(effect, added.sizes, values, likelihood, self.white.change(factor * added.values), least)


class _Linear:
    """A linear least-squares problem: residuals, the tangents of a model's own parameters, and their prior.

    Args:
        parts: residual and tangents of each recording.
        own: residual and tangents of the prior.
    """

    def __init__(self, parts: Sequence[tuple[Array, Array]], own: tuple[Array, Array]) -> None:
        self.r: Array = np.concatenate([*(r for r, _ in parts), own[0]])
        self.J: Array = np.vstack([*(J for _, J in parts), own[1]])
        self.basis, self.upper = np.linalg.qr(self.J)
        self.rest = self.r - self.basis @ (self.basis.T @ self.r)
        self.cost = float(self.rest @ self.rest)

    def added(self, rows: Sequence[Array]) -> Array:
        """What other residuals are more than these; the prior stays."""
        there = np.concatenate(rows)
        return np.concatenate([there - self.r[: len(there)], np.zeros(len(self.r) - len(there))])

    def best(self, added: Array, least: bool) -> tuple[float, Array]:
        """The factor of a course that takes most of the cost away, and its part that the parameters cannot make good.

        Effects are in proportion to their size where they are small, so that the factor of the ``least`` may be any.
        """
        values = added - self.basis @ (self.basis.T @ added)
        power, pull = float(values @ values), -float(values @ self.rest)
        low = 0.0 if least else 0.1 / SEARCH.factor
        factor = min(max(pull / power if power > 0 else 1.0, low), SEARCH.factor)
        return factor, values

    def change(self, added: Array) -> Array:
        """The parameters' answer to a course."""
        found = -np.linalg.lstsq(self.upper, self.basis.T @ (self.r + added), rcond=1e-10)[0]
        return np.asarray(np.clip(found, -SEARCH.farthest, SEARCH.farthest))

    def with_weaker_prior(self, i: int, rows: int, weaker: float) -> tuple[float, Array]:
        """What it takes away of the cost to weaken the prior of parameter ``i``, one of ``rows`` at the end."""
        r, J = self.r.copy(), self.J.copy()
        J[len(r) - rows + i] *= weaker
        r[len(r) - rows + i] *= weaker
        change = np.asarray(np.linalg.lstsq(J, -r, rcond=None)[0])
        return self.cost - float(np.sum((r + J @ change) ** 2)), change


class Whitening:
    """Residuals of an experiment as components of equal noise, several in one.

    Neighbours in a band are added with random signs: that keeps squares and products on average, and a line of the
    spectrum stays as strong as it is [Charikar 2002].

    Args:
        e: which.
        strengths: mean square of the noise, by signal and band.
        every: components that are added.
    """

    def __init__(self, e: Experiment, strengths: Mapping[tuple[int, int], float], every: int) -> None:
        self.e = e
        rows, signals = e.measured.shape
        edges, weights = [], np.ones((rows, signals))
        for band, part in e.bands(EVIDENCE.fewest):
            edges.append(np.arange(part.start, part.stop, every))
            for k in range(signals):
                weights[part, k] = strengths.get((k, band), 1.0) ** -0.5
        self.edges = np.concatenate(edges)
        sizes = np.diff([*self.edges, rows])
        known = np.isfinite(e.measured).mean(axis=0)
        numbers = [band for (band, _), some in zip(e.bands(EVIDENCE.fewest), edges, strict=True) for _ in some]
        self.names = [(k, band) for band in numbers for k in range(signals)]
        """Signal and band of each component."""
        self.counts = np.outer(sizes, known).ravel()
        """Recorded values that each stands for."""
        self.weights = weights * np.random.default_rng(0).choice([-1.0, 1.0], (rows, 1))

    def __call__(self, r: Array) -> Array:
        """Of a residual, shape (samples, signals); flat."""
        return np.asarray(np.add.reduceat(self.e.components(r) * self.weights, self.edges, axis=0).ravel())


class _Bands:
    """The likelihood of whitened residuals when the noise of each band is as strong as they are, or the sensor's.

    Args:
        whitening: of each experiment.
        strengths: mean square of the noise that they were whitened with, by signal and band.
    """

    def __init__(self, whitening: Sequence[Whitening], strengths: Mapping[tuple[int, int], float]) -> None:
        names = [name for each in whitening for name in each.names]
        self._kinds = sorted(set(names))
        number = {name: k for k, name in enumerate(self._kinds)}
        self._place = np.array([number[name] for name in names])
        self._strength = np.array([strengths.get(name, 1.0) for name in self._kinds])
        self._count = np.zeros(len(self._kinds))
        for each in whitening:
            np.add.at(self._count, [number[name] for name in each.names], each.counts)

    def likelihood(self, rest: Array) -> float:
        """Of a residual, the rows of the prior at its end."""
        n = len(self._place)
        energy = np.bincount(self._place, rest[:n] ** 2, len(self._kinds)) * self._strength
        strength = np.maximum(energy / self._count, 1.0)
        return float(-0.5 * np.sum(self._count * np.log(strength) + energy / strength) - 0.5 * np.sum(rest[n:] ** 2))


def courses(origin: Origin, effect: Candidate) -> list[Course]:
    """The courses of an effect at its starting sizes, those that promise most first; computed once.

    Args:
        origin: where.
        effect: which.
    """
    key = f"{effect.key} {effect.option} {effect.starts}"
    if key in origin.kept:
        return origin.kept[key]
    found = [origin.freed(effect)] if effect.freed else []
    added: list[_Added] = []
    for group in effect.structures():
        try:
            beside = [(*origin.built, sizes) for sizes in group]
            made = origin.builder.placed((*origin.effects, effect), beside, origin.values, origin.problem.internal_step)
            for _, alike in itertools.groupby(made, key=lambda one: one[0].internal_step):
                added += origin.added(list(alike))
        except FlexarmError as error:
            origin.refused[effect.key, effect.option] = error.message
    least: dict[tuple[float, ...], float] = {}
    for one in added:
        way = effect.way(one.sizes)
        least[way] = min(one.power, least.get(way, math.inf))
    found += [origin.course(effect, one, one.power <= SEARCH.alike * least[effect.way(one.sizes)]) for one in added]
    origin.kept[key] = sorted(found, key=lambda course: -course.likelihood)
    return origin.kept[key]


def likeness(some: Sequence[Course], others: Sequence[Course]) -> float:
    """Cosine of what two effects change of the recordings, at the sizes at which they are likest."""

    def directions(several: Sequence[Course]) -> list[Array]:
        norms = [float(np.linalg.norm(course.values)) for course in several]
        return [course.values / norm for course, norm in zip(several, norms, strict=True) if norm > 0]

    mine, theirs = directions(some), directions(others)
    return float((np.array(mine) @ np.array(theirs).T).max()) if mine and theirs else 0.0


def begun(origin: Origin, effect: Candidate, most: int, *, bold: bool = False) -> list[StartingPoint]:
    """Where to begin the fit of an effect beside an origin: the sizes that promise most, each with its true cost.

    The model's own parameters begin where the linear problem puts them, or stay where that is worse.

    Args:
        origin: where.
        effect: which.
        most: number of sizes.
        bold: the last of the starting sizes too, the largest, however bad they look: the model's own parameters may
            have to make room for an effect of several sizes.
    """
    found = courses(origin, effect)
    taken = found[:most]
    if bold and len(effect.parameters) > 1:
        taken = [*taken, *(course for course in found[most:] if course.sizes == effect.starts[-1])]
    rows: list[StartingPoint] = []
    for course in taken:
        together, built = (*origin.effects, effect), (*origin.built, course.sizes)
        for model, x, sizes in origin.builder.placed(together, [built], origin.values, origin.problem.internal_step):
            moved = x.copy()
            names = [(f.name, f.recording) for f in model.free]
            for f, change in zip(origin.problem.free, course.change, strict=True):
                if (f.name, f.recording) in names:
                    moved[names.index((f.name, f.recording))] += change
            able = [(model.cost(there, model.training, noise="white"), k) for k, there in enumerate((x, moved))]
            cost, k = min(able)
            rows.append(StartingPoint(cost, model, (x, moved)[k], sizes, sizes))
    return rows


def together(
    found: Sequence[Course], origin: Origin, count: int, gained: float = -math.inf
) -> list[tuple[Candidate, ...]]:
    """The pairs of effects that promise most, to start from the sizes that do, the best first.

    Of those that take most of the residual away, with noise as strong as it is, the likeliest once it is as weak as
    they leave it: where two effects act at the same frequencies, neither alone makes the noise weaker there.

    Args:
        found: courses of all effects around one origin.
        origin: it.
        count: largest number of pairs.
        gained: by how much a pair is to raise the likelihood, at least.
    """
    if len(found) < 2:
        return []
    table = np.column_stack([course.values for course in found])
    gram, pull = table.T @ table, -table.T @ origin.white.rest
    low = np.array([0.0 if course.least else 1 / SEARCH.factor_of_two for course in found])
    gains, factors = _gains(gram, pull, low)
    likely: list[tuple[float, tuple[Candidate, ...]]] = []
    for a, b in itertools.islice(_ranked(found, gains, factors), max(count, SEARCH.pairs)):
        reached = origin.likely(factors[a, b] * table[:, a] + factors[b, a] * table[:, b])
        if reached > origin.likelihood + gained:
            likely.append((reached, tuple(replace(found[k].effect, starts=(found[k].sizes,)) for k in (a, b))))
    return [pair for _, pair in sorted(likely, key=lambda row: -row[0])[:count]]


def _gains(gram: Array, pull: Array, low: Array) -> tuple[Array, Array]:
    """For each pair of courses, how much of the cost they take away, and the factor of the first.

    Nothing where a factor is out of reach; the factor is 1 there.

    Args:
        gram: products of the courses, shape (n, n).
        pull: what each has in common with the residual, shape (n,).
        low: least factor of each, shape (n,).
    """
    own = np.diag(gram)
    whole = np.outer(own, own)
    determinant = whole - gram**2
    determinant = np.where(determinant > 1e-9 * whole, determinant, np.inf)
    first = (own[None, :] * pull[:, None] - gram * pull[None, :]) / determinant
    second = first.T
    high = SEARCH.factor_of_two
    able = (first > low[:, None]) & (first < high) & (second > low[None, :]) & (second < high)
    gains = np.where(able, first * pull[:, None] + second * pull[None, :], 0.0)
    return gains, np.where(able, first, 1.0)


def _ranked(found: Sequence[Course], gains: Array, factors: Array) -> Iterator[tuple[int, int]]:
    """Pairs of different effects, best first, a few places of a kind, of sizes that are near those asked for."""
    far = np.abs(np.log(factors)) + np.abs(np.log(factors.T))
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
        yield min(able, key=lambda at: far[at])
