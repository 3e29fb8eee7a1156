"""The optimiser: a trust region with geodesic acceleration, over growing horizons and from several starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from diagnosis.estimation.covariance import Flat, covariance
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.leftover import Noise
from diagnosis.estimation.parameters import Array, FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.whitened import WhitenedResiduals
from diagnosis.thresholds import FITTING, SEARCH
from engine.errors import SimulationError
from engine.threads import Threads
from engine.work import FACTORED, counting

Progress = Callable[[str], None]

UNDETERMINED = 100.0
"""Ratio of the ends of an interval beyond which recordings do not determine a parameter."""


@dataclass(frozen=True)
class Interval:
    """A fitted parameter with its 95 % interval, whose ends are infinite where the recordings set no bound.

    Where the ends are more than two decades apart, or the fit has not converged, the recordings set none. The decades
    count for what is known by its logarithm: an angle from -0.3 to -0.002 rad is determined.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    start: float
    logarithmic: bool = True

    def numbers(self) -> dict[str, Any]:
        """As it stands in JSON: an end without bound is None."""
        low, high = (end if math.isfinite(end) else None for end in (self.low, self.high))
        if self.logarithmic and low and high and low * high > 0 and max(low / high, high / low) > UNDETERMINED:
            low = high = None
        return {"value": self.value, "low": low, "high": high, "unit": self.unit}


def interval_in_words(row: Mapping[str, Any], digits: int = 4) -> str:
    """An interval as `Interval.numbers` gives it, in words: ``1 to 2``, or ``at least 1``."""
    low, high = ("" if row[key] is None else f"{row[key]:.{digits}g}" for key in ("low", "high"))
    if low and high:
        return f"{low} to {high}"
    return f"at least {low}" if low else f"at most {high}" if high else "not determined by these recordings"


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    Attributes:
        problem: what was fitted.
        x: search vector.
        cost: of the training recordings, as of `Problem.cost`.
        chi2: mean squared residual over the training recordings; 1 is the noise floor.
        converged: whether the last step was small.
        covariance: of the search vector; see `diagnosis.estimation.covariance`.
        weak: combinations of parameters that the data do not tell apart, in words.
        flat: parameters that the data only bound.
    """

    problem: Problem
    x: Array
    cost: float
    chi2: float
    converged: bool
    covariance: Array
    weak: tuple[str, ...] = ()
    flat: Flat = ()

    def parameters(self) -> dict[str, float]:
        """Fitted values, SI units."""
        return self.problem.values(self.x)[0]

    def intervals(self) -> list[Interval]:
        """95 % intervals of all free parameters."""
        units = {p.name: p.unit for p in self.problem.model.parameters}
        bounded = {i: ends for i, *ends in self.flat}
        rows = []
        for i, f in enumerate(self.problem.free):
            half = 1.96 * math.sqrt(max(self.covariance[i, i], 0.0))
            ends = bounded.get(i, [self.x[i] - half, self.x[i] + half])
            low, high = sorted(_end_value(f, end) for end in ends)
            if not self.converged:
                low, high = -math.inf, math.inf
            unit = units.get(f.name, "")
            rows.append(Interval(f.name, f.value(self.x[i]), low, high, unit, f.start, f.logarithmic))
        return rows


def _end_value(f: FreeParameter, end: float) -> float:
    """The parameter at the end of its interval, infinite where there is none; one that keeps its sign stops at zero."""
    if math.isfinite(end):
        return f.value(end)
    if f.logarithmic:
        return math.copysign(math.inf, f.start) if end * f.scale > 0 else 0.0
    return math.copysign(math.inf, end)


def descend(
    problem: Problem,
    x: Array,
    experiments: Sequence[Experiment],
    pool: Threads,
    *,
    only: Sequence[int] | None = None,
    iterations: int = 25,
    least_gain: float = 0.0,
    accelerated: bool = True,
    noise: Noise = "coloured",
    reach: float = math.inf,
) -> tuple[Array, float, bool]:
    """Gauss-Newton steps within a trust region, with geodesic acceleration, from ``x``.

    What is made small is minus twice the logarithm of the likelihood, with noise as strong in each band of frequency as
    the model leaves it. Each step solves the least-squares problem of the residual whitened by what was left before it;
    since a logarithm lies below its tangents, what lowers that sum lowers the cost as much at least [Hunter 2004]. Far
    from the recordings, or where physics is missing, the noise is strong and the tolerances hold the parameters; the
    closer the model comes, the more the samples count.

    A step is damped only where it would leave the region, a ball in units of the tolerances. So a direction of which
    the recordings say nothing, such as all torques and inertias scaled together, is decided by the prior in one step,
    however small the noise is [More 1978]. The acceleration follows the curved valleys that products of parameters
    make, where plain steps only zigzag [Transtrum 2012]. It costs two more simulations, and a step that gains what it
    promised, or half of it, has shown that the valley is straight there.

    With noise as strong as what is left over, the squares of a step lie above the cost: alone they may creep, each step
    gaining twice what it promised. So where two steps within the region are each too short by the parabola through the
    cost's slope and its change, the second is made as long as that says, while that lowers the cost.

    Where a step gains nothing, or a fit would end, and the tangents do not foretell how the model answers nearby, the
    rest of the steps is taken with slopes over a distance (`diagnosis.estimation.slopes`).

    Args:
        problem: what to fit.
        x: where to start, shape (n,).
        experiments: to fit to.
        pool: threads.
        only: numbers of the search variables that may move; all if None.
        iterations: at most.
        least_gain: stop when a step reduces the cost by less than this, in units of what a recorded value contributes
            to it on average, 1 at least.
        accelerated: whether steps that gain little are bent by geodesic acceleration.
        noise: how strong the noise is, as of `Bands`. With white noise of unknown strength the largest errors count
            most, which leads out of places where, with coloured noise, one error is as good as another.
        reach: cost that is to be reached: the fit is left where it would not be by the last step, if all that are
            still to be taken gained as much as the last few, or where `SEARCH.promised` times what tangents that hold
            promise would not come there.

    Returns:
        Search vector, cost, as of `Problem.cost` with this noise, and whether it converged: a full step would gain no
        more than `FITTING.settled` of what a recorded value contributes on average, or no step gains anything and it
        promises little.
    """
    stack = WhitenedResiduals(problem, experiments, pool, only, noise=noise)
    end = _by_tangents(stack, x, iterations, least_gain, reach, accelerated)
    if end.lost and stack.runs(end.x):
        end = _by_secants(stack, end.x, end.left, least_gain, reach)
        # Where secants have led, less may bounce.
        again = _by_tangents(stack, end.x, end.left, least_gain, reach, accelerated)
        end = end if again.lost and again.cost >= end.cost else again
    return end.x, end.cost, end.converged


@dataclass(frozen=True)
class _End:
    """Where steps of one kind have led.

    Attributes:
        x: search vector.
        cost: there, infinite where nothing is known of it.
        converged: as of `descend`.
        left: steps that were not taken.
        lost: whether slopes do not foretell how the model answers nearby.
    """

    x: Array
    cost: float
    converged: bool
    left: int = 0
    lost: bool = False


def _by_tangents(
    stack: WhitenedResiduals, x: Array, iterations: int, least_gain: float, reach: float, accelerated: bool
) -> _End:
    """Steps by tangents, as long as these foretell how the model answers; arguments as of `descend`."""
    try:
        rows, slopes = stack.linearised(x)
    except SimulationError:
        return _End(x, math.inf, False, iterations, True)
    cost, radius = stack.cost(x, rows), FITTING.radius
    costs, creeping = [cost], False
    for left in range(iterations - 1, -1, -1):
        weights = stack.weights(rows)
        r, J = stack.whitened(x, rows, weights), stack.whitened_slopes(x, slopes, weights)
        local = _LocalModel(r, J, stack.stuck(x, J.T @ r))
        full = local.step(math.inf)
        promised = local.gain(full)
        square = float(r @ r)
        unit, little = max(square / len(r), 1.0), promised < max(1.0, FITTING.stalled * square)
        if promised < FITTING.settled * unit:
            held = stack.hold(x, slopes)
            return _End(x, cost, held, left + 1, not held)
        if cost - SEARCH.promised * promised > reach and stack.hold(x, slopes):
            return _End(x, cost, little)
        for tried in range(12):
            step = local.step(radius)
            moved = stack.moved(x, step)
            there = stack.cost(moved, stack.residual(moved))
            if accelerated and cost - there < FITTING.straight * local.gain(step):
                bend = local.bent(stack.curvature(x, r, J, step, weights))
                if np.linalg.norm(bend) < 0.75 * np.linalg.norm(step):
                    along = stack.moved(x, step + bend / 2)
                    least = stack.cost(along, stack.residual(along))
                    if least < there:
                        step, moved, there = step + bend / 2, along, least
            if there < cost:
                break
            if tried == FITTING.tries and not stack.hold(x, slopes):
                return _End(x, cost, False, left + 1, True)
            radius = 0.25 * min(radius, float(np.linalg.norm(step)))
        else:
            return _End(x, cost, little)
        creeping, crept = False, creeping
        while (longer := min(local.stretch(step, there - cost), radius / float(np.linalg.norm(step)))) > FITTING.longer:
            if not crept:  # a single step may have met a bend
                creeping = True
                break
            along = stack.moved(x, longer * step)
            least = stack.cost(along, stack.residual(along))
            creeping = least < there
            if not creeping:
                break
            step, moved, there = longer * step, along, least
        if cost - there > FITTING.straight * local.gain(step):
            radius = max(radius, 2 * float(np.linalg.norm(step)))
        x = moved
        try:
            rows, slopes = stack.linearised(x)
        except SimulationError:
            return _End(x, there, False, left, True)
        before, cost = cost, stack.cost(x, rows)
        if _out_of_reach(costs, cost, left, reach):
            return _End(x, cost, little)
        if before - cost < least_gain * unit:
            held = stack.hold(x, slopes)
            return _End(x, cost, held and little, left, not held)
        costs.append(cost)
    return _End(x, cost, False)


def _by_secants(stack: WhitenedResiduals, x: Array, iterations: int, least_gain: float, reach: float) -> _End:
    """Steps by slopes over distances, the longest first; arguments as of `descend`.

    A step that gains nothing unless it is shorter than the distance that slopes were taken over asks for a shorter one.
    """
    rows = stack.residual(x)
    cost, distances = stack.cost(x, rows), list(FITTING.secants)
    costs = [cost]
    for left in range(iterations - 1, -1, -1):
        distance, before = distances[0], cost
        weights, slopes = stack.weights(rows), stack.secants(x, distance)
        r, J = stack.whitened(x, rows, weights), stack.whitened_slopes(x, slopes, weights)
        local = _LocalModel(r, J, stack.stuck(x, J.T @ r))
        square = float(r @ r)
        for times in (4.0, 1.0, 0.25):
            moved = stack.moved(x, local.step(times * distance))
            there = stack.residual(moved)
            if stack.cost(moved, there) < cost:
                x, rows, cost = moved, there, stack.cost(moved, there)
                break
        if _out_of_reach(costs, cost, left, reach):
            return _End(x, cost, False)
        costs.append(cost)
        if times < 1.0 or before - cost < max(least_gain, FITTING.settled) * max(square / len(r), 1.0):
            distances.pop(0)
            if not distances:
                little = local.gain(local.step(math.inf)) < max(1.0, FITTING.stalled * square)
                return _End(x, cost, little, left)
    return _End(x, cost, False)


def _out_of_reach(costs: Sequence[float], cost: float, left: int, reach: float) -> bool:
    """Whether a cost, before which were others, would not come down to ``reach`` in the steps that are left."""
    if len(costs) < FITTING.pace:
        return False
    return cost - left * (costs[-FITTING.pace] - cost) / FITTING.pace > reach


class _LocalModel:
    """The linear model of a residual around a point: its steps within a trust region.

    Args:
        r: residual, shape (rows,).
        J: its Jacobian, shape (rows, n).
        stuck: numbers of the variables that stand at a bound and would leave it.
    """

    def __init__(self, r: Array, J: Array, stuck: Sequence[int]) -> None:
        self.moves = np.array([k for k in range(J.shape[1]) if k not in stuck], dtype=np.intp)
        n = len(self.moves)
        columns = np.empty((n + 1, len(r)))
        columns[:n], columns[n] = J.T if n == J.shape[1] else J.T[self.moves], r
        if (work := counting()) is not None:
            work.add(round(FACTORED * columns.size * n))
        # Triangular factors, for squaring a Jacobian would lose what the prior says beside precise data.
        upper = np.asarray(np.linalg.qr(columns.T, mode="r"))
        left, self.values, self.directions = np.linalg.svd(upper[:n, :n])
        self.pull = left.T @ upper[:n, n]
        self.gradient = J.T @ r
        self.J, self.size = J, J.shape[1]

    def step(self, radius: float) -> Array:
        """The step that reduces the cost most within a distance, shape (n,)."""
        least = 1e-12 * float(self.values.max(initial=0.0))
        values = np.maximum(self.values, least or 1.0)

        def along(damping: float) -> Array:
            return np.asarray(-values * self.pull / (values**2 + damping))

        found, damping = along(0.0), 0.0
        if np.linalg.norm(found) > radius:
            # Too little to change any digit, and enough to make the step shorter than the radius, whatever the scale.
            low, high = 2 * math.log(values.min()) - 40, math.log(float(np.linalg.norm(values * self.pull)) / radius)
            damping = math.exp(brentq(lambda k: math.log(np.linalg.norm(along(math.exp(k))) / radius), low, high + 1))
            found = along(damping)
        self.damping = damping
        whole = np.zeros(self.size)
        whole[self.moves] = self.directions.T @ found
        return np.asarray(whole)

    def gain(self, step: Array) -> float:
        """How much a step reduces the cost of the linear model."""
        return float(-2 * self.gradient @ step - np.sum((self.J @ step) ** 2))

    def stretch(self, step: Array, change: float) -> float:
        """How many times as long a step is to be, by the parabola through the cost's slope and its change, 4 at most.

        Args:
            step: from the point.
            change: of the true cost with it.
        """
        slope = 2 * float(self.gradient @ step)
        bend = change - slope
        return min(-slope / (2 * bend), 4.0) if bend > 0 else 4.0

    def bent(self, curvature: Array) -> Array:
        """The geodesic acceleration that belongs to the last step, from the second derivative along it."""
        pull = self.directions @ (self.J.T @ curvature)[self.moves]
        whole = np.zeros(self.size)
        floor = (1e-12 * float(self.values.max(initial=0.0))) ** 2
        whole[self.moves] = -self.directions.T @ (pull / (np.maximum(self.values**2, floor or 1.0) + self.damping))
        return np.asarray(whole)


def fit(
    problem: Problem,
    *,
    random_starts: int = 0,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    least_gain: float = 0.0,
    noise: Noise = "stated",
) -> Fit:
    """Fit the free parameters to the training recordings, from the nominal ones and from further starts.

    Every start is first fitted to the beginning of each recording, then to all of it: over a short horizon the phase of
    a lightly damped oscillation cannot slip by a whole cycle. Where whole recordings are followed less closely after
    that than before, they are fitted from the start.

    Args:
        problem: what to fit.
        random_starts: further starts, drawn within the tolerances.
        seed: of those.
        workers: threads.
        progress: told what is being done.
        least_gain: as of `descend`.
        noise: how strong the noise of whole recordings is, as of `Bands`; that of their beginnings is white, if not as
            stated.

    Returns:
        The best fit over all starts.
    """
    training = problem.training
    random = np.random.default_rng(seed)
    n = len(problem.free)
    begin = [np.zeros(n), *(random.normal(0.0, 0.7, n) for _ in range(random_starts))]
    first: Noise = "stated" if noise == "stated" else "white"
    best: tuple[float, Array, bool] | None = None
    with Threads(workers or 2) as pool:
        for number, x in enumerate(begin):
            if progress:
                progress(f"start {number + 1} of {len(begin)}")
            short, *_ = descend(
                problem, x, [e.cut(FITTING.first_horizon) for e in training], pool, least_gain=least_gain, noise=first
            )
            # What follows the beginnings may run away later, as where it makes a loop unstable.
            x = min(short, x, key=lambda at: problem.cost(at, training, noise=noise))
            end = descend(problem, x, training, pool, least_gain=least_gain, noise=noise)
            if best is None or end[1] < best[0]:
                best = (end[1], end[0], end[2])
        assert best is not None
        cost, x, converged = best
    made = Fit(problem, x, cost, problem.chi2(x, training), converged, np.zeros((n, n)))
    return with_covariance(made, (problem.chi2(x, problem.held_out) if problem.held_out else made.chi2) - 1)


def with_covariance(made: Fit, left: float) -> Fit:
    """A fit with the covariance of its search vector.

    Args:
        made: where it ended.
        left: mean squared residual of data that were not fitted, beyond the noise, in units of the noise.
    """
    found, weak, flat = covariance(made.problem, made.x, left)
    return replace(made, covariance=found, weak=weak, flat=flat)
