"""What an effect of some size does to the planned measurements, and how well another model could do the same.

Around each model its measurements are linear in its parameters: one run gives their course and their tangents. The best
that a rival can do against a truth is then a linear least-squares problem, its parameters held by their tolerances and
priors. All is told in the currency of the diagnosis, the logarithm of the evidence that is expected: what a model
leaves over of the truth, in bands of frequency above the sensors' noise, what its parameters cost, and the volume that
the data leave them; see `diagnosis.search.evidence`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import over_time
from diagnosis.planning.experiment import Planned
from diagnosis.planning.sizes import TURNS, Family
from diagnosis.problems import resolved, variant
from diagnosis.search.screening import Whitening
from diagnosis.thresholds import EVIDENCE, FITTING, SEARCH
from engine.errors import FlexarmError, SimulationError

BESIDE = 0.1
"""Relative change of a size that has no tangent, for its difference."""

ROUNDS = 4
"""Steps of the model's own parameters at most, to make good what an effect adds."""

EASY = 0.03
"""Share of the cost that a further step must promise."""

ROWS = 500
"""Random sums of samples that stand for a further sensor."""


@dataclass(frozen=True)
class Course:
    """A model in the planned experiment, beside the model as given.

    Attributes:
        values: what it adds to the planned measurements, whitened, shape (m,).
        slopes: of that by its parameters, shape (m, n).
        further, further_slopes: the same of further sensors, shape (sensors, rows) and (sensors, rows, n).
        free: its parameters.
        own: which of them are the effect's, shape (n,).
        prior, weights: residual and Jacobian of the prior.
        x: search vector about which it is linear, shape (n,): the model's own parameters make good what they can, so
            that the measurements are nearly those of the model as given.
        problem: the model.
        given: where the values given for the parameters lie while this is the truth, by name and recording: at those
            of the truth, unless one of them is wrong.
    """

    values: Array
    slopes: Array
    further: Array
    further_slopes: Array
    free: tuple[FreeParameter, ...]
    own: NDArray[np.bool_]
    prior: Array
    weights: Array
    x: Array
    problem: Problem
    given: dict[tuple[str, str], float] = field(default_factory=dict)

    @functools.cached_property
    def volume(self) -> float:
        """What the data leave of the prior's volume, as a logarithm: the cost of having chosen the parameters."""
        return volume(self.slopes.T @ self.slopes, self.weights)

    @functools.cached_property
    def gram(self) -> Array:
        """Information of the planned measurements, shape (n, n)."""
        return np.asarray(self.slopes.T @ self.slopes)

    @functools.cached_property
    def limits(self) -> tuple[Array, Array]:
        """How far each parameter may go in the linear solution: effects stay near the size that was simulated."""
        low, high = np.full(len(self.free), -np.inf), np.full(len(self.free), np.inf)
        for i, f in enumerate(self.free):
            name = f.name.rpartition(".")[2]
            if self.own[i] and f.logarithmic and not self._waves:
                low[i], high[i] = (1 / SEARCH.factor - 1) / f.scale, (SEARCH.factor - 1) / f.scale
            elif self.own[i] and name == "frequency":
                low[i] = high[i] = 0.0
        return low, high

    @property
    def places(self) -> dict[tuple[str, str], float]:
        """Where the model's own parameters are, by name and recording."""
        rows = zip(self.free, self.x, self.own, strict=True)
        return {(f.name, f.recording): float(x) for f, x, own in rows if not own}

    def given_by(self, truth: Course) -> Array:
        """Where the values given for its parameters lie while another is the truth, shape (n,)."""
        return np.array([truth.given.get((f.name, f.recording), 0.0) for f in self.free])

    @property
    def _waves(self) -> bool:
        """Whether it is a wave of any phase: amplitude and phase are then linear together."""
        return any(own and f.name.rpartition(".")[2] in TURNS for own, f in zip(self.own, self.free, strict=True))


@dataclass(frozen=True)
class Bands:
    """Components of whitened measurements, and the bands of frequency in which the diagnosis judges what is left.

    Attributes:
        names: signal and band of each component.
        counts: recorded values that each stands for, shape (m,).
    """

    names: tuple[tuple[int, int], ...]
    counts: Array

    def __add__(self, other: Bands) -> Bands:
        return Bands((*self.names, *other.names), np.concatenate([self.counts, other.counts]))

    @functools.cached_property
    def strengths(self) -> tuple[NDArray[np.int64], Array]:
        """The number of each component's band, shape (m,), and the values in each band, shape (bands,)."""
        number = {name: i for i, name in enumerate(sorted(set(self.names)))}
        place = np.array([number[name] for name in self.names])
        return place, np.asarray(np.bincount(place, self.counts, len(number)), dtype=float)

    def likelihood(self, rest: Array, background: Array | None = None) -> Array:
        """Logarithm of the likelihood that is expected where a model leaves some of the truth, shape as of columns.

        Zero where it leaves nothing: the noise is the same for all.

        Args:
            rest: shape (m, columns).
            background: what no model has, over the sensors' noise, shape (bands, columns).
        """
        ratio = self.ratio(rest)
        return np.asarray(
            -0.5 * self.strengths[1] @ np.log1p(ratio if background is None else ratio / (1 + background))
        )

    def unexplained(self, rest: Array) -> Array:
        """What of that a search sees: bands that show more than chance; see `diagnosis.search.evidence.Leftover`."""
        ratio = 1 + self.ratio(rest)
        n = self.strengths[1][:, None]
        chance = (1 - 2 / (9 * n) + EVIDENCE.chance * np.sqrt(2 / (9 * n))) ** 3
        return np.asarray(0.5 * np.sum(np.where(ratio > chance, n * np.log(ratio), 0.0), axis=0))

    def ratio(self, rest: Array) -> Array:
        """Energy of each band over that of the noise, shape (bands, columns)."""
        energy = np.zeros((len(self.strengths[1]), rest.shape[1]))
        np.add.at(energy, self.strengths[0], rest**2)
        return energy / self.strengths[1][:, None]


def volume(information: Array, weights: Array) -> float:
    """Logarithm of the root of the prior's volume over that which information leaves of it."""
    known = weights.T @ weights
    return 0.5 * float(np.linalg.slogdet(information + known)[1] - np.linalg.slogdet(known)[1])


class Bench:
    """The planned experiment, ready to try effects on.

    Args:
        planned: it.
        problem: other experiments of the same model and signals; those of ``planned`` if None.
    """

    def __init__(self, planned: Planned, problem: Problem | None = None) -> None:
        self.problem = problem or planned.wide
        self.planned_signals = len(planned.sensors)
        k = self.planned_signals
        experiments = over_time(self.problem.experiments)
        every = max(1, sum(len(e.time) for e in experiments) // SEARCH.samples)
        self._whitening = [Whitening(replace(e, measured=e.measured[:, :k]), {}, every) for e in experiments]
        names = [name for each in self._whitening for name in each.names]
        self._built: dict[str, Problem] = {}
        self.bands = Bands(tuple(names), np.concatenate([each.counts for each in self._whitening]))

    def model(self, family: Family, size: float) -> tuple[Problem, Array]:
        """The model with an effect of a size, and the search vector at which it has that size.

        Raises:
            FlexarmError: the amended model has no meaning, or would move faster than the samples can show.
        """
        candidate, sizes = family.candidate, family.sizes(size)
        chosen = {p.name: sizes[p.name] for p in candidate.parameters if p.fixed}
        key = f"{family.label} {chosen}"
        made = self._built.get(key)
        if made is None:
            held = {f"{candidate.name}.{key}" for key in candidate.held}
            made = self._built[key] = variant(self.problem, candidate.edits(sizes), candidate.free(sizes), held)
        x = np.zeros(len(made.free))
        for i, f in enumerate(made.free):
            block, _, name = f.name.rpartition(".")
            if block == candidate.name and name in sizes and not f.recording:
                x[i] = f.position(sizes[name])
        stepped = resolved(made, x)
        if stepped is None:
            raise TooFast(f"{family.label}: it would move faster than the samples can show")
        return stepped, x

    def forget(self) -> None:
        """Drop the models that were built."""
        self._built.clear()

    @functools.cached_property
    def nominal(self) -> Course:
        """The model as given."""
        return self._course(self.problem, np.zeros(len(self.problem.free)), "", further=True)

    def course(self, family: Family, size: float, near: Course | None = None, *, further: bool = False) -> Course:
        """What an effect of a size adds that the model's own parameters cannot make good.

        Args:
            family: the effect.
            size: its.
            near: its course at another size.
            further: whether further sensors are looked at too.

        Raises:
            FlexarmError: it cannot be simulated.
        """
        if family.candidate.freed is not None:
            return self._freed(family.candidate.freed, size)
        made, x = self.model(family, size)
        name = f"{family.candidate.name}."
        known = near.places if near is not None else {}
        x = np.array([known.get((f.name, f.recording), v) for f, v in zip(made.free, x, strict=True)])
        found = self._course(made, x, name, further)
        for _ in range(ROUNDS):
            change, promised = _made_good(found)
            if promised < EASY * max(1.0, float(found.values @ found.values)):
                break
            try:
                following = self._course(made, found.x + change, name, further)
            except SimulationError:
                break
            if _cost(following) >= _cost(found):
                break
            found = following
        found = replace(found, given=found.places)
        return self._with_difference(found, family, size, further) if family.sized and not found.own.any() else found

    def at(self, family: Family, size: float, where: Course) -> Course:
        """What an effect adds where all parameters are those of its course in another experiment.

        Raises:
            FlexarmError: it cannot be simulated.
        """
        made, x = self.model(family, size) if family.candidate.freed is None else (self.problem, where.x)
        known = {(f.name, f.recording): f.value(v) for f, v in zip(where.free, where.x, strict=True)}
        pairs = zip(made.free, x, strict=True)
        x = np.array([f.position(known[key]) if (key := (f.name, f.recording)) in known else v for f, v in pairs])
        if family.candidate.freed is not None:
            found = self._course(made, x, family.candidate.freed.name, further=False)
            return replace(found, free=where.free)
        found = self._course(made, x, f"{family.candidate.name}.", further=False)
        return self._with_difference(found, family, size, False) if family.sized and not found.own.any() else found

    def again(self, course: Course, change: Array) -> Course | None:
        """A course about parameters that were changed; None where it cannot be simulated, or has no derivative.

        Args:
            course: it.
            change: of its parameters, shape (n,).
        """
        made, x = course.problem, course.x + change
        if len(made.free) != len(x):
            return None
        try:
            found = self._course(resolved(made, x) or made, x, "", bool(course.further.size))
        except SimulationError:
            return None
        return replace(
            course,
            values=found.values,
            slopes=found.slopes,
            further=found.further,
            further_slopes=found.further_slopes,
            prior=course.prior + course.weights @ change,
            x=x,
        )

    def _freed(self, freed: FreeParameter, size: float) -> Course:
        """The model as given while the value that is given for one of its parameters is wrong."""
        base = self.nominal
        i = [f.name for f in base.free].index(freed.name)
        free = tuple(freed if k == i else f for k, f in enumerate(base.free))
        weights = base.weights.copy()
        weights[i, i] = 1 / freed.spread
        own = np.zeros(len(free), dtype=bool)
        own[i] = True
        return replace(base, free=free, weights=weights, own=own, given={(freed.name, ""): -size})

    def _with_difference(self, found: Course, family: Family, size: float, further: bool) -> Course:
        """The course with a tangent by the size itself, of which the model has no derivative."""
        other = self._course(self.model(family, size * (1 + BESIDE))[0], found.x, "", further)
        step = np.log1p(BESIDE)
        prior = next(p for p in family.candidate.parameters if p.fixed)
        n = len(found.free)
        weights = np.zeros((len(found.weights) + 1, n + 1))
        weights[:-1, :n], weights[-1, -1] = found.weights, 1 / prior.spread
        return replace(
            found,
            slopes=np.column_stack([found.slopes, (other.values - found.values) / step]),
            further_slopes=np.concatenate(
                [found.further_slopes, ((other.further - found.further) / step)[:, :, None]], axis=2
            ),
            free=(*found.free, FreeParameter(f"{family.candidate.name}.{prior.name}", size, 1.0, True)),
            own=np.append(found.own, True),
            prior=np.append(found.prior, 0.0),
            weights=weights,
            x=np.append(found.x, 0.0),
        )

    def _course(self, made: Problem, x: Array, mine: str, further: bool) -> Course:
        values, slopes, others, other_slopes = [], [], [], []
        k, n = self.planned_signals, len(x)
        for e, whitening in zip(over_time(made.experiments), self._whitening, strict=True):
            r, J = made.linearised(x, e)
            r = r.reshape(e.measured.shape)
            J = np.asarray(J).reshape(len(e.time), e.measured.shape[1], n)
            if np.abs(r[:, :k]).max(initial=0.0) > FITTING.huge / 10:
                raise SimulationError("what it adds grows without bound")
            values.append(whitening(r[:, :k]))
            columns = [whitening(one) for one in np.moveaxis(J[:, :k], 2, 0)]
            slopes.append(np.column_stack(columns) if columns else np.zeros((len(values[-1]), 0)))
            if further and e.measured.shape[1] > k:
                others.append(_thinned(r[:, k:]))
                other_slopes.append(_thinned(J[:, k:]))
        prior, weights = made.prior(x)
        own = np.array([bool(mine) and (f.name == mine or f.name.startswith(mine)) for f in made.free], dtype=bool)
        return Course(
            np.concatenate(values),
            np.vstack(slopes),
            np.concatenate(others).T if others else np.zeros((0, 0)),
            np.concatenate(other_slopes).transpose(1, 0, 2) if others else np.zeros((0, 0, n)),
            made.free,
            own,
            prior,
            weights,
            x,
            made,
        )


class TooFast(FlexarmError):
    """A model moves faster than the samples of the experiment can show."""


def _thinned(rows: Array) -> Array:
    """Random sums of neighbouring rows (samples, ...), which keep squares and products on average."""
    edges = np.arange(0, len(rows), max(1, len(rows) // ROWS))
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(rows)).reshape(-1, *[1] * (rows.ndim - 1))
    return np.asarray(np.add.reduceat(rows * signs, edges, axis=0))


@dataclass(frozen=True)
class Answer:
    """The best that a model can do against some truths.

    Attributes:
        rest: what it leaves of them, shape (m, truths).
        change: of its parameters, shape (n, truths).
        cost: of its prior, half the sum of squares, shape (truths,).
    """

    rest: Array
    change: Array
    cost: Array


def answer(
    rival: Course, truths: Sequence[Course], information: Array | None = None, pull: Array | None = None
) -> Answer:
    """Fit a rival to truths, linearly.

    Args:
        rival: the model.
        truths: what is measured, as if they were it.
        information: of further measurements beside the planned ones, shape (n, n).
        pull: what they say of the parameters, shape (n, truths).
    """
    H = rival.gram + rival.weights.T @ rival.weights
    away = np.column_stack([t.values for t in truths]) - rival.values[:, None]
    prior = rival.prior[:, None] - rival.weights @ np.column_stack([rival.given_by(t) for t in truths])
    b = rival.slopes.T @ away - rival.weights.T @ prior
    if information is not None and pull is not None:
        H, b = H + information, b + pull
    change = _solved(H, b)
    low, high = rival.limits
    if np.isfinite(low).any() or np.isfinite(high).any():
        for k in np.flatnonzero(((change < low[:, None]) | (change > high[:, None])).any(axis=0)):
            change[:, k] = _within(H, b[:, k], change[:, k], low, high)
    own = prior + rival.weights @ change
    return Answer(away - rival.slopes @ change, change, 0.5 * np.sum(own**2, axis=0))


def _made_good(course: Course) -> tuple[Array, float]:
    """The change of the model's own parameters that makes good most of an effect, and how much of the cost."""
    theirs = ~course.own
    J, W = course.slopes[:, theirs], course.weights[:, theirs]
    b = J.T @ course.values + W.T @ course.prior
    change = np.zeros(len(course.free))
    change[theirs] = -_solved(J.T @ J + W.T @ W, b[:, None])[:, 0]
    return change, -float(b @ change[theirs])


def _cost(course: Course) -> float:
    return float(course.values @ course.values + course.prior @ course.prior)


def _solved(H: Array, b: Array) -> Array:
    """H x = b, balanced: parameters may be very unequal in what they do."""
    if not len(H):
        return np.zeros_like(b)
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.asarray(scale[:, None] * np.linalg.lstsq(H * np.outer(scale, scale), scale[:, None] * b, rcond=1e-13)[0])


def _within(H: Array, b: Array, x: Array, low: Array, high: Array) -> Array:
    """The same within bounds: what leaves them is held there, and the rest solved anew, until none leaves."""
    held = np.zeros(len(x), dtype=bool)
    for _ in range(len(x)):
        out = ~held & ((x < low) | (x > high))
        if not out.any():
            break
        held |= out
        x = np.where(held, np.clip(x, low, high), x)
        free = ~held
        x[free] = _solved(H[np.ix_(free, free)], (b - H[:, held] @ x[held])[free, None])[:, 0]
    return x


def fitted(bands: Bands, found: Answer, background: Array | None = None) -> Array:
    """Logarithm of the likelihood of a rival's best fit less what its parameters cost, for each truth."""
    return np.asarray(bands.likelihood(found.rest, background) - found.cost)


def background(bands: Bands, nominal: Course, truths: Sequence[Course]) -> Array:
    """What no model has of some truths, over the sensors' noise in each band, shape (bands, truths).

    A machine has more that nobody models, and all that is taken for it is as coloured as what shows.
    """
    return EVIDENCE.share * bands.ratio(answer(nominal, truths).rest)


def likely(bands: Bands, rival: Course, found: Answer) -> Array:
    """Logarithm of the evidence of a rival that is expected, for each truth."""
    return np.asarray(fitted(bands, found) - rival.volume)


def together(a: Course, b: Course) -> Course:
    """Two effects at once, each of its own size: courses and tangents add up.

    The model's own parameters are those of the first.
    """
    theirs = np.flatnonzero(b.own)
    rows = np.flatnonzero(np.abs(b.weights[:, theirs]).any(axis=1))
    n, extra = len(a.free), len(theirs)
    moved = np.array([b.places.get((f.name, f.recording), 0.0) for f in a.free])
    weights = np.zeros((len(a.weights) + len(rows), n + extra))
    weights[: len(a.weights), :n] = a.weights
    weights[len(a.weights) :, n:] = b.weights[np.ix_(rows, theirs)]
    return replace(
        a,
        values=a.values + b.values,
        slopes=np.column_stack([a.slopes, b.slopes[:, theirs]]),
        further=a.further + b.further,
        further_slopes=np.concatenate([a.further_slopes, b.further_slopes[:, :, theirs]], axis=2),
        free=(*a.free, *(b.free[i] for i in theirs)),
        own=np.concatenate([a.own, np.ones(extra, dtype=bool)]),
        # Both have moved the model's own parameters; of the two at once, the moves add up.
        prior=np.concatenate([a.prior + a.weights @ moved, b.prior[rows]]),
        weights=weights,
        x=np.concatenate([a.x + moved, b.x[theirs]]),
    )
