"""How much recordings speak for a model: one number, in which all models of a study are compared.

What a model leaves over is taken for coloured noise of unknown strength. Each signal's residual is split by the cosine
transform into bands of a third of an octave; in each, the noise is as strong as the model leaves it, and never weaker
than the sensor's. So a model is credited for every independent piece of the mismatch that it explains, at the noise
floor and far above it alike, and a mismatch that no model explains is no evidence against any of them. The logarithm of
the likelihood of all recordings, those held out as well, less what the parameters cost (prior, and the share of the
prior's volume that is left to them by Laplace's approximation [Kass 1995]) is the evidence:

    ln Z = -1/2 sum_b (n_b ln v_b + E_b / v_b) - 1/2 sum_i (x_i - c_i)^2 / s_i^2 - 1/2 ln(det(H + P) / det P)

with v_b = max(E_b / n_b, 1) the strength, E_b the energy and n_b the number of values of a band, P the information of
the prior and H that of the training recordings, each band weighed by 1 / v_b.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.thresholds import EVIDENCE
from engine.errors import SimulationError


@dataclass(frozen=True)
class Leftover:
    """What a model leaves over, by signal and band of frequency.

    Attributes:
        energy: sum of squared residuals, in variances of the sensors' noise as stated, shape (bands,): the bands of
            the first signal, then those of the next.
        count: independent values in it, shape (bands,).
        noise: mean square that the sensors alone leave, 1 where their noise is as stated, shape (bands,).
        names: signal and number of each band.
        energies, counts: the first two of each experiment, shape (experiments, bands).
    """

    energy: Array
    count: Array
    noise: Array
    names: tuple[tuple[int, int], ...]
    energies: Array
    counts: Array

    @property
    def by_band(self) -> dict[tuple[int, int], float]:
        """Strength by signal and number of the band."""
        return dict(zip(self.names, self.strength.tolist(), strict=True))

    @property
    def strength(self) -> Array:
        """Mean square in each band, never below what the sensors' noise was stated to be."""
        return np.maximum(self.energy / self.count, 1.0)

    @property
    def log_likelihood(self) -> float:
        """Of the residual, with noise of this strength in each band."""
        return float(-0.5 * np.sum(self.count * np.log(self.strength) + self.energy / self.strength))

    @property
    def unexplained(self) -> float:
        """By how much the logarithm of the likelihood could still rise if only the sensors' noise were left."""
        ratio = np.maximum(self.energy / self.count / self.noise, 1.0)
        return float(0.5 * np.sum(np.where(ratio > _chance(self.count), self.count * np.log(ratio), 0.0)))

    @property
    def varying(self) -> float:
        """The same if each band were as strong in every experiment as in the one in which it is weakest.

        A sensor's noise, whatever its colour, is as strong in all; what physics leaves over depends on the motion.
        """
        there = self.counts > 0
        strength = np.divide(self.energies, self.counts, out=np.full_like(self.energies, np.inf), where=there)
        weakest = np.argmin(strength, axis=0)[None, :]
        least = np.take_along_axis(self.counts, weakest, axis=0)
        quiet = np.maximum(np.take_along_axis(strength, weakest, axis=0) * _chance(least), self.noise)
        ratio = np.where(there, np.maximum(strength / quiet, 1.0), 1.0)
        counts = np.maximum(self.counts, 1.0)
        return float(0.5 * np.sum(np.where(ratio > _chance(counts), counts * np.log(ratio), 0.0)))


def _chance(count: Array) -> Array:
    """By which factor chance makes the strength of a band of so many values larger, at most."""
    # The cube root of a chi-square is nearly normal, however few its freedoms [Wilson 1931].
    return np.asarray((1 - 2 / (9 * count) + EVIDENCE.chance * np.sqrt(2 / (9 * count))) ** 3)


def leftover(problem: Problem, x: Array, experiments: Sequence[Experiment]) -> Leftover:
    """What a model leaves over of experiments, each band of a signal summed over all of them.

    Args:
        problem: the model.
        x: its search vector, shape (n,).
        experiments: of any role.
    """
    return left_by(experiments, [problem.residual(x, e) for e in experiments])


def left_by(experiments: Sequence[Experiment], residuals: Sequence[Array]) -> Leftover:
    """The same of residuals, each of shape (samples, signals), on the instants of experiments."""
    rows: list[dict[tuple[int, int], tuple[float, float]]] = []
    for e, residual in zip(experiments, residuals, strict=True):
        squares = e.components(residual) ** 2
        recorded = np.isfinite(e.measured).mean(axis=0)
        there: dict[tuple[int, int], tuple[float, float]] = {}
        for band, part in e.bands(EVIDENCE.fewest):
            power = squares[part].sum(axis=0)
            for k in np.flatnonzero(recorded).tolist():
                there[k, band] = float(power[k]), float(recorded[k]) * len(squares[part])
        rows.append(there)
    names = tuple(sorted({name for there in rows for name in there}))
    table = np.array([[there.get(name, (0.0, 0.0)) for name in names] for there in rows])
    energies, counts = table[:, :, 0], table[:, :, 1]
    energy, count = energies.sum(axis=0), counts.sum(axis=0)
    noise = np.ones(len(names))
    for signal in {k for k, _ in names}:
        own = [i for i, (k, _) in enumerate(names) if k == signal]
        noise[own] = _noise(energy[own], count[own])
    return Leftover(energy, count, noise, names, energies, counts)


def _noise(energy: Array, count: Array) -> float:
    """Strength of a sensor's noise: as stated, or a little more where the highest frequencies show more."""
    upper = np.cumsum(count[::-1])[::-1] <= 0.6 * count.sum()
    if not upper.any():
        return 1.0
    return min(max(1.0, float(np.median(energy[upper] / count[upper]))), EVIDENCE.stated)


def information(problem: Problem, x: Array, left: Leftover) -> tuple[Array, Array]:
    """What the training recordings and the prior know of the search vector: two matrices, shape (n, n) each.

    Args:
        problem: of a model.
        x: search vector where its fit ended.
        left: what the model leaves over of all recordings: each band weighs as its noise is strong.

    Raises:
        SimulationError: the run cannot be differentiated.
    """
    weights = problem.prior(x)[1]
    own = weights.T @ weights
    data = np.zeros_like(own)
    strengths = left.by_band
    for e in problem.training:
        _, J = problem.linearised(x, e)
        slopes = J.reshape(len(e.measured), -1, len(x))
        for k in range(slopes.shape[1]):
            rows = e.components(slopes[:, k])
            for band, part in e.bands(EVIDENCE.fewest):
                strength = strengths.get((k, band))
                if strength:
                    data += rows[part].T @ rows[part] / strength
    return data, own


def evidence(problem: Problem, x: Array, left: Leftover) -> float:
    """Logarithm of the evidence of a fitted model, but for a constant that all models of a study share.

    Args:
        problem: of the model.
        x: where its fit ended.
        left: what it leaves over of all recordings.
    """
    try:
        data, own = information(problem, x, left)
    except SimulationError:
        return -math.inf
    prior = float(np.sum(problem.prior(x)[0] ** 2))
    volume = float(np.linalg.slogdet(data + own)[1] - np.linalg.slogdet(own)[1])
    return left.log_likelihood - 0.5 * prior - 0.5 * volume
