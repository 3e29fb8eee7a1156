"""How visible something is: refit the nominal parameters to the truth, and see what is left on held-out recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.simulator import Diverged
from benchmarks.concealed.truth import Truth

Array = NDArray[np.float64]

WIDEST = 3.0
"""How many tolerances a refitted parameter may leave its nominal value."""

STEPS = 12
"""Undamped steps, at most."""

ENOUGH = 1e-3
"""Mean square, in floors, that is as good as none."""


def least_squares(
    residual: Callable[[Array], Array],
    x: Array,
    *,
    low: Array | float = -np.inf,
    high: Array | float = np.inf,
    iterations: int = 12,
    spacing: float = 1e-3,
    longest: float = 1.0,
) -> tuple[Array, float]:
    """Levenberg-Marquardt with differences, then undamped steps, within bounds.

    A run that diverges counts as infinitely bad. Damped steps creep along a ridge, such as of a link that gives and a
    joint that does; undamped ones go along it.

    Args:
        residual: to be made small.
        x: start.
        low, high: bounds.
        iterations: at most.
        spacing: of the differences.
        longest: largest change of any entry in one iteration.

    Returns:
        The minimiser and its sum of squares.
    """

    def evaluate(at: Array) -> Array | None:
        return _evaluated(residual, at)

    r, damping = evaluate(x), 1e-3
    if r is None:
        return x, math.inf
    cost = float(r @ r)
    for _ in range(iterations):
        J = np.zeros((len(r), len(x)))
        for i in range(len(x)):
            there = evaluate(x + spacing * np.eye(len(x))[i])
            if there is not None:
                J[:, i] = (there - r) / spacing
        H, g = J.T @ J, J.T @ r
        before = cost
        for _ in range(8):
            held = ((x <= low) & (g > 0)) | ((x >= high) & (g < 0))
            free = np.flatnonzero(~held)
            move = np.zeros_like(x)
            A = H[np.ix_(free, free)]
            move[free] = -np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-6), g[free])
            size = float(np.abs(move).max(initial=0.0))
            move *= min(1.0, longest / size) if size > 0 else 1.0
            at = np.clip(x + move, low, high)
            tried = evaluate(at)
            if tried is not None and float(tried @ tried) < cost:
                x, r, cost, damping = at, tried, float(tried @ tried), max(damping / 6, 1e-9)
                break
            damping *= 8
        if before - cost < 1e-4 * before + 1e-9:
            break
    x, r = undamped(residual, x, r, low=np.broadcast_to(low, x.shape), high=np.broadcast_to(high, x.shape))
    return x, float(r @ r)


def undamped(
    residual: Callable[[Array], Array], x: Array, r: Array, *, low: Array, high: Array, first: Array | None = None
) -> tuple[Array, Array]:
    """Gauss-Newton steps within bounds, each shortened until it gains; `STEPS` of them, or fewer if they gain little.

    Args:
        residual: to be made small.
        x: start.
        r: residual there.
        low, high: bounds.
        first: derivatives there, if they are known.

    Returns:
        Where they end, and the residual there.
    """
    for iteration in range(STEPS):
        J = first if iteration == 0 and first is not None else _derivatives(residual, x, r)
        cost = float(r @ r)
        scale = np.linalg.norm(J, axis=0)
        scale[scale == 0] = 1.0
        Q, R = np.linalg.qr(J / scale)
        bounds = ((low - x) * scale - 1e-12, (high - x) * scale + 1e-12)
        move = lsq_linear(R, -Q.T @ r, bounds=bounds, method="bvls").x / scale
        for _ in range(5):
            at = np.clip(x + move, low, high)
            tried = _evaluated(residual, at)
            if tried is not None and float(tried @ tried) < cost:
                x, r = at, tried
                break
            move /= 3
        if cost - float(r @ r) < 0.02 * cost or float(r @ r) < ENOUGH * len(r):
            break
    return x, r


def _evaluated(residual: Callable[[Array], Array], at: Array) -> Array | None:
    """A residual, or none where a run diverges."""
    try:
        found = residual(at)
    except (Diverged, ValueError, OverflowError, np.linalg.LinAlgError):
        return None
    return found if np.isfinite(found).all() else None


def _derivatives(residual: Callable[[Array], Array], x: Array, here: Array, spacing: float = 1e-4) -> Array:
    """By differences; none where a run diverges a hair away."""
    moved = (_evaluated(residual, x + spacing * e) for e in np.eye(len(x)))
    return np.stack([np.zeros(len(here)) if m is None else (m - here) / spacing for m in moved], axis=1)


def refit(bench: Bench, start: Truth, target: Sequence[Array]) -> Truth:
    """Nominal parameters that bring ``start`` closest to noise-free outputs of the training recordings.

    A parameter pays ((ln p / p0) / tolerance)^2, in units of squared floors, as it does in a fit to real noise.
    """
    names = list(bench.tolerance)
    width = np.array([bench.tolerance[name] for name in names])
    centre = np.array([bench.centre[name] for name in names])
    origin = np.log(np.array([start.parameters[name] for name in names]) / centre) / width
    train = bench.training()
    wanted = np.concatenate([np.ravel(y) for y, hold in zip(target, bench.held_out, strict=True) if not hold])

    def with_parameters(x: Array) -> Truth:
        values = centre * np.exp(width * x)
        return replace(start, parameters=dict(start.parameters) | dict(zip(names, values.tolist(), strict=True)))

    def residual(x: Array) -> Array:
        made = np.concatenate([np.ravel(y) for y in train.outputs(with_parameters(x))])
        return np.concatenate([made - wanted, x])

    x, _ = least_squares(residual, origin, low=-WIDEST, high=WIDEST, iterations=30)
    return with_parameters(x)


class Small:
    """What a refit leaves of a small change of the outputs, by the derivatives of the nominal model."""

    def __init__(self, bench: Bench, about: Truth, wanted: Sequence[Array] | None = None) -> None:
        """Differentiate the nominal model about a truth.

        Args:
            bench: the recordings.
            about: nominal model.
            wanted: outputs that changes are counted from; those of ``about`` if absent.
        """
        self.bench = bench
        own = bench.outputs(about)
        self.base = own if wanted is None else wanted
        names, share = list(bench.tolerance), 1e-4
        columns = []
        for name in names:
            moved = dict(about.parameters) | {name: about.parameters[name] * (1 + share)}
            there = bench.outputs(replace(about, parameters=moved))
            columns.append([(a - b) / share for a, b in zip(there, own, strict=True)])
        self.J = [np.stack([np.ravel(c[k]) for c in columns], axis=1) for k in range(len(own))]
        train = np.concatenate([J for J, hold in zip(self.J, bench.held_out, strict=True) if not hold])
        self.train = train
        self.H = train.T @ train + np.diag([bench.tolerance[name] ** -2 for name in names])

    def left(self, target: Sequence[Array]) -> list[Array]:
        """The difference to noise-free outputs, recording by recording, after a refit to the training recordings."""
        r = [np.ravel(a - b) for a, b in zip(target, self.base, strict=True)]
        train = np.concatenate([part for part, hold in zip(r, self.bench.held_out, strict=True) if not hold])
        move = np.linalg.solve(self.H, self.train.T @ train)
        return [part - J @ move for part, J in zip(r, self.J, strict=True)]

    def size(self, target: Sequence[Array]) -> float:
        """Root mean square of what is left, over all recordings, in floors."""
        return float(np.sqrt(np.mean(np.concatenate(self.left(target)) ** 2)))


class GaussNewton:
    """The refit for rigs of many parameters, and ridges among them: undamped steps on the residual with its prior.

    The same minimum as `refit`, for a fraction of the simulations: the prior holds what the recordings say nothing of,
    and each refit begins with the derivatives where all begin.
    """

    def __init__(self, bench: Bench, start: Truth) -> None:
        """Differentiate at the start, once for all targets."""
        self.bench, self.start, self.train = bench, start, bench.training()
        self.names = list(bench.tolerance)
        self.width = np.array([bench.tolerance[name] for name in self.names])
        self.centre = np.array([bench.centre[name] for name in self.names])
        given = np.array([start.parameters[name] for name in self.names])
        self.origin = np.clip(np.log(given / self.centre) / self.width, -WIDEST, WIDEST)
        self.outset = self._outputs(self.origin)
        self.first = _derivatives(self._outputs, self.origin, self.outset)
        self.end: Array | None = None
        """Where the last refit ended."""

    def _at(self, x: Array) -> Truth:
        values = self.centre * np.exp(self.width * x)
        made = dict(self.start.parameters) | dict(zip(self.names, values.tolist(), strict=True))
        return replace(self.start, parameters=made)

    def _outputs(self, x: Array) -> Array:
        return np.concatenate([np.ravel(y) for y in self.train.outputs(self._at(x))])

    def refit(self, target: Sequence[Array]) -> Truth:
        """Nominal parameters, within `WIDEST` tolerances, that bring the start closest to noise-free outputs.

        Begun from the start, and from where the refit before ended, if more than nothing is left: targets come by
        their size, and a resonance that one of them has moved far is followed there by steps.
        """
        parts = [np.ravel(y) for y, hold in zip(target, self.bench.held_out, strict=True) if not hold]
        wanted = np.concatenate(parts)
        edge = np.full(len(self.origin), WIDEST)

        def residual(x: Array) -> Array:
            return np.concatenate([self._outputs(x) - wanted, x])

        first = np.vstack([self.first, np.eye(len(self.origin))])
        begun = np.concatenate([self.outset - wanted, self.origin])
        x, r = undamped(residual, self.origin, begun, low=-edge, high=edge, first=first)
        if self.end is not None and float(r @ r) > ENOUGH * len(r):
            again = _evaluated(residual, self.end)
            if again is not None:
                end, left = undamped(residual, self.end, again, low=-edge, high=edge)
                x = end if float(left @ left) < float(r @ r) else x
        self.end = x
        return self._at(x)


def excess(bench: Bench, truth: Truth, step: float | None = None, quick: GaussNewton | None = None) -> float:
    """How far the refitted nominal model stays from the truth, held out, in units of the floor."""
    try:
        target = bench.outputs(truth, step)
    except Diverged:
        return math.inf
    fitted = quick.refit(target) if quick else refit(bench, truth.bare(), target)
    try:
        return bench.distance(bench.outputs(fitted), target, True)
    except Diverged:
        return math.inf


def solve(score: Callable[[float], float], first: float, most: float, wanted: float = 1.0) -> tuple[float, float]:
    """The size at which a score that grows with it reaches a value: secant on logarithms, kept in a bracket.

    Returns:
        Size and its score; the largest size allowed if the score does not get there.
    """
    size, low, high = first, 0.0, math.inf
    history: list[tuple[float, float]] = []
    for _ in range(14):
        if any(size == seen for seen, _ in history):
            break
        value = score(size)
        if math.isfinite(value) and value > 0:
            history.append((size, value))
            if abs(math.log(value / wanted)) < 0.03:
                break
        if value > wanted:
            high = min(high, size)
        else:
            low = max(low, size)
            if size >= most:
                break
        power = 1.0
        if len(history) > 1:
            (a, fa), (b, fb) = sorted(history, key=lambda h: abs(math.log(h[1] / wanted)))[:2]
            if a != b and fa != fb:
                power = float(np.clip(math.log(fb / fa) / math.log(b / a), 0.3, 4.0))
        if not history:
            size /= 4
            continue
        base, at = min(history, key=lambda h: abs(math.log(h[1] / wanted)))
        size = base * float(np.clip((wanted / at) ** (1 / power), 1 / 30, 30))
        if low > 0 and math.isfinite(high) and not 1.02 * low < size < high / 1.02:
            size = math.sqrt(low * high)
        size = min(size, most)
    return min(history, key=lambda h: abs(math.log(h[1] / wanted))) if history else (size, math.inf)
