"""Residuals and tangents of a model as a fit sees them: whitened by what the model leaves over, the prior beside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.estimation import slopes as slopes_of
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.leftover import Bands, Noise
from diagnosis.estimation.parameters import Array, moved
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import FITTING
from engine.threads import Threads


class WhitenedResiduals:
    """Residuals of experiments, whitened by what a model leaves over, as functions of the variables that may move.

    Args:
        problem: what is fitted.
        experiments: to what.
        pool: threads.
        only: numbers of the search variables that may move; all if None, but for those in which other experiments
            start: nothing here tells of them, and the prior would draw them to its centre.
        noise: as of `Bands`.
    """

    def __init__(
        self,
        problem: Problem,
        experiments: Sequence[Experiment],
        pool: Threads,
        only: Sequence[int] | None = None,
        *,
        noise: Noise = "coloured",
    ) -> None:
        self.problem, self.experiments, self.pool = problem, experiments, pool
        here = {"", *(e.name for e in experiments)}
        self.numbers = [i for i, f in enumerate(problem.free) if f.recording in here] if only is None else list(only)
        self.bands = Bands(experiments, noise=noise)

    def moved(self, x: Array, step: Array) -> Array:
        """The search vector after a step of the variables that may move, kept within its bounds."""
        return moved(self.problem.free, x, step, self.numbers)

    def stuck(self, x: Array, gradient: Array) -> list[int]:
        """Which of the variables that may move stand at a bound that they would leave."""
        found = []
        for k, i in enumerate(self.numbers):
            low, high = self.problem.free[i].ends
            if (x[i] <= low and gradient[k] > 0) or (x[i] >= high and gradient[k] < 0):
                found.append(k)
        return found

    def residual(self, x: Array) -> list[Array]:
        """Components of the residual of each experiment, shape (samples, signals), as of `Bands.components`."""
        return self.problem.residuals(x, self.experiments, self.bands.components, self.pool.map)

    def linearised(self, x: Array) -> tuple[list[Array], list[Array]]:
        """The same, and their slopes, shape (samples, signals, variables).

        Raises:
            SimulationError: the model cannot be differentiated.
        """

        def one(e: Experiment) -> tuple[Array, Array]:
            r, J = self.problem.linearised(x, e, self.numbers)
            samples, signals = e.measured.shape
            # Tangents come variable by variable, and stay so.
            moving = J if len(self.numbers) == J.shape[1] else J.T[self.numbers].T
            slopes = moving.reshape(samples, signals, -1)
            split = self.bands.components
            return split(e, r.reshape(samples, signals)), split(e, slopes)

        parts = list(self.pool.map(one, self.experiments))
        return [r for r, _ in parts], [J for _, J in parts]

    def held(self, x: Array) -> tuple[list[Array], list[Array]]:
        """As of `linearised`, slopes that hold over a distance; see `slopes.linearised`."""
        rows, slopes = self.linearised(x)
        return rows, slopes if self.hold(x, slopes) else self.secants(x, FITTING.held_over)

    def secants(self, x: Array, distance: float) -> list[Array]:
        """Slopes of the components over a distance, shape (samples, signals, variables) each."""
        split, over = self.bands.components, self.pool.map
        return slopes_of.secants(self.problem, x, self.experiments, distance, self.numbers, split, over)

    def hold(self, x: Array, slopes: Sequence[Array]) -> bool:
        """Whether slopes foretell how the residuals change; see `slopes.hold`."""
        split, over = self.bands.components, self.pool.map
        return slopes_of.hold(self.problem, x, self.experiments, slopes, self.numbers, split, over)

    def runs(self, x: Array) -> bool:
        """Whether the model can be simulated; see `slopes.runs`."""
        return slopes_of.runs(self.problem, x, self.experiments)

    def cost(self, x: Array, rows: Sequence[Array]) -> float:
        """What is made small, given the components of the residuals."""
        return self.bands.misfit(self.bands.energies(rows)) + self.problem.prior_cost(x)

    def weights(self, rows: Sequence[Array]) -> list[Array]:
        """What makes residuals white that are like these."""
        return self.bands.weights(self.bands.strength(self.bands.energies(rows)))

    def whitened(self, x: Array, rows: Sequence[Array], weights: Sequence[Array]) -> Array:
        """The residual, shape (rows,), that of the prior at its end."""
        parts = [(r * w).ravel() for r, w in zip(rows, weights, strict=True)]
        return np.concatenate([*parts, self.problem.prior(x)[0]])

    def whitened_slopes(self, x: Array, slopes: Sequence[Array], weights: Sequence[Array]) -> Array:
        """Its Jacobian, shape (rows, variables)."""
        n = len(self.numbers)
        parts = [(J.transpose(2, 0, 1) * w).reshape(n, -1) for J, w in zip(slopes, weights, strict=True)]
        return np.concatenate([*parts, self.problem.prior(x)[1][:, self.numbers].T], axis=1).T

    def curvature(self, x: Array, r: Array, J: Array, step: Array, weights: Sequence[Array]) -> Array:
        """Second derivative of the residual along a step, from one residual a tenth of the way along it."""
        h = 0.1
        there = self.moved(x, h * step)
        along = self.whitened(there, self.residual(there), weights)
        return np.asarray(2 / h * ((along - r) / h - J @ step))
