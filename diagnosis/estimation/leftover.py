"""What a model leaves over of recordings, by signal and band of frequency, and how likely that is.

What is left over is taken for coloured noise of unknown strength: each signal's residual is split by the cosine
transform into bands of a third of an octave, and in each the noise is as strong as the model leaves it, and never
weaker than the sensor's. So a slow mismatch of a thousand samples counts as the few independent values that it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.thresholds import EVIDENCE

Indices = NDArray[np.intp]

Noise = Literal["coloured", "white", "stated"]
"""How strong the noise is taken to be; see `Bands`."""


def strength(energy: Array, count: Array) -> Array:
    """Mean square of bands with so much energy of so many values, never below what the noise was stated to be."""
    return np.asarray(np.maximum(energy / count, 1.0))


def misfit(energy: Array, count: Array) -> float:
    """Minus twice the logarithm of the likelihood of bands with so much energy of so many values."""
    there = strength(energy, count)
    return float(np.sum(count * np.log(there) + energy / there))


class Bands:
    """The bands of some experiments, in each of which the noise of a signal is of one strength in all of them.

    Args:
        experiments: of any role.
        noise: ``coloured``: as strong in each band as what is left over; ``white``: as strong in all bands of a signal;
            ``stated``: as strong as the sensor's was stated to be, so that a misfit is a sum of squares.

    Attributes:
        names: signal and number of each band.
        counts: independent values of each experiment in each band, shape (experiments, bands).
    """

    def __init__(self, experiments: Sequence[Experiment], *, noise: Noise = "coloured") -> None:
        self.noise = noise
        whole = [[(0, slice(0, len(e.measured)))] for e in experiments]
        bands = [e.bands(EVIDENCE.fewest) for e in experiments] if noise == "coloured" else whole
        found = [(rows, np.isfinite(e.measured).mean(axis=0)) for rows, e in zip(bands, experiments, strict=True)]
        names = {(k, band) for rows, known in found for band, _ in rows for k in np.flatnonzero(known).tolist()}
        self.names = tuple(sorted(names))
        self._signals = [e.measured.shape[1] for e in experiments]
        number = {name: i for i, name in enumerate(self.names)}
        self.counts = np.zeros((len(found), len(self.names)))
        self._rows: list[tuple[Indices, Indices, Indices, Indices]] = []
        for n, (rows, known) in enumerate(found):
            signals = np.flatnonzero(known)
            edges = np.array([part.start for _, part in rows], dtype=np.intp)
            sizes = np.array([part.stop - part.start for _, part in rows], dtype=np.intp)
            columns = np.array([[number[k, band] for k in signals.tolist()] for band, _ in rows], dtype=np.intp)
            self.counts[n, columns] = np.outer(sizes, known[signals])
            self._rows.append((edges, sizes, signals, columns))

    @property
    def count(self) -> Array:
        """Independent values in each band, shape (bands,)."""
        return np.asarray(self.counts.sum(axis=0))

    def components(self, e: Experiment, rows: Array) -> Array:
        """Rows (samples, ...) of one of the experiments, split into its bands.

        Where the noise is as strong in all bands of a signal there is nothing to split: squares and products of rows
        sum to those of their cosines, which are an orthonormal basis.
        """
        return e.components(rows) if self.noise == "coloured" else e.even(rows)

    def strength(self, energies: Array) -> Array:
        """Mean square of the noise in each band, shape (bands,), given `energies`."""
        return np.ones(len(self.names)) if self.noise == "stated" else strength(energies.sum(axis=0), self.count)

    def misfit(self, energies: Array) -> float:
        """Minus twice the logarithm of the likelihood of what is left over, given `energies`."""
        return float(energies.sum()) if self.noise == "stated" else misfit(energies.sum(axis=0), self.count)

    def energies(self, components: Sequence[Array]) -> Array:
        """Sum of squares in each band of residuals, given their `components`; shape (experiments, bands)."""
        found = np.zeros_like(self.counts)
        for n, (rows, (edges, _, signals, columns)) in enumerate(zip(components, self._rows, strict=True)):
            found[n, columns] = np.add.reduceat(rows[:, signals] ** 2, edges, axis=0)
        return found

    def weights(self, strengths: Array) -> list[Array]:
        """What makes components white, shape (samples, signals) each; zero for a signal of which nothing was recorded.

        Args:
            strengths: of the noise in each band, shape (bands,).
        """
        found = []
        for width, (_, sizes, signals, columns) in zip(self._signals, self._rows, strict=True):
            rows = np.zeros((int(sizes.sum()), width))
            rows[:, signals] = np.repeat(strengths[columns] ** -0.5, sizes, axis=0)
            found.append(rows)
        return found


@dataclass(frozen=True)
class Leftover:
    """What a model leaves over, by signal and band of frequency.

    Attributes:
        energy: sum of squared residuals, in variances of the sensors' noise as stated, shape (bands,): the bands of
            the first signal, then those of the next.
        count: independent values in it, shape (bands,).
        noise: mean square that the right model leaves, shape (bands,): the sensors' noise, 1 where it is as stated, and
            where a hair's breadth of its parameters moves the model at random, what two such runs differ by.
        names: signal and number of each band.
        energies, counts: the first two of each experiment, shape (experiments, bands).
        luck: by how much that changes the logarithm of the likelihood, at most.
    """

    energy: Array
    count: Array
    noise: Array
    names: tuple[tuple[int, int], ...]
    energies: Array
    counts: Array
    luck: float = 0.0

    @property
    def by_band(self) -> dict[tuple[int, int], float]:
        """Strength by signal and number of the band."""
        return dict(zip(self.names, self.strength.tolist(), strict=True))

    @property
    def strength(self) -> Array:
        """Mean square in each band, never below what the sensors' noise was stated to be."""
        return strength(self.energy, self.count)

    def of(self, numbers: Sequence[int]) -> Leftover:
        """What is left over of some of the experiments, by their numbers."""
        energies, counts = self.energies[list(numbers)], self.counts[list(numbers)]
        there = np.flatnonzero(counts.sum(axis=0) > 0)
        energies, counts = energies[:, there], counts[:, there]
        names = tuple(self.names[i] for i in there.tolist())
        energy, count = energies.sum(axis=0), counts.sum(axis=0)
        return Leftover(energy, count, self.noise[there], names, energies, counts, self.luck)

    def as_quiet_as(self, other: Leftover) -> Leftover:
        """The same with sensors whose noise is no stronger than another model shows of the same experiments."""
        return replace(self, noise=np.minimum(self.noise, other.noise))

    @property
    def log_likelihood(self) -> float:
        """Of the residual, with noise of this strength in each band."""
        return -0.5 * misfit(self.energy, self.count)

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


def left_by(
    experiments: Sequence[Experiment], residuals: Sequence[Array], beside: Sequence[Sequence[Array]] = ()
) -> Leftover:
    """What residuals, of shape (samples, signals) each, leave over on the instants of experiments.

    Args:
        experiments: of any role.
        residuals: of each.
        beside: residuals of the same model, its parameters a hair to one side and to the other, if it may be unsteady.
    """
    bands = Bands(experiments)

    def energies_of(rows: Sequence[Array]) -> Array:
        return bands.energies([e.components(r) for e, r in zip(experiments, rows, strict=True)])

    energies = energies_of(residuals)
    energy, count = energies.sum(axis=0), bands.count
    noise = np.ones(len(bands.names))
    for signal in {k for k, _ in bands.names}:
        own = [i for i, (k, _) in enumerate(bands.names) if k == signal]
        noise[own] = _noise(energy[own], count[own])
    luck = 0.0
    if beside:
        after, before = beside
        apart = energies_of([a - b for a, b in zip(after, before, strict=True)]).sum(axis=0)
        runs = zip(after, before, residuals, strict=True)
        bend = energies_of([a + b - 2 * r for a, b, r in runs]).sum(axis=0)
        # What is steady bends far less than its ends part. Three runs that part at random, each by a variance v, bend
        # by 6 v; two of them differ by 2 v, and so does a run from a recording.
        unsteady = bend > apart
        noise = noise + np.where(unsteady, bend / 3 / count, 0.0)
        sides = (np.where(unsteady, energies_of(rows).sum(axis=0), energy) for rows in beside)
        luck = 0.5 * max(abs(misfit(side, count) - misfit(energy, count)) for side in sides)
    return Leftover(energy, count, noise, bands.names, energies, bands.counts, luck)


def _noise(energy: Array, count: Array) -> float:
    """Strength of a sensor's noise: as stated, or a little more where the highest frequencies show more."""
    upper = np.cumsum(count[::-1])[::-1] <= 0.6 * count.sum()
    if not upper.any():
        return 1.0
    return min(max(1.0, float(np.median(energy[upper] / count[upper]))), EVIDENCE.stated)
