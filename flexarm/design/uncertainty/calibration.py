"""A bound on the spectra of what a model leaves over, and its calibration on pieces of recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexarm.design.uncertainty.results import Weight
from flexarm.design.uncertainty.spectra import Piece, binned, smooth
from flexarm.design.uncertainty.weight_fit import fit_weight

LEVEL = 0.95
"""Share of the bins of a spectrum that the bound is to hold."""


@dataclass(frozen=True)
class Calibration:
    """What is predicted for the difference, times a factor: draws, a white floor, and what they leave over.

    What is left over goes with the response, by a weight, or does not, as a disturbance; whichever is more.

    Attributes:
        weight: on the response.
        floor: mean square of a bin.
        knots, disturbance: rad/s, and the logarithm of the mean square left over about each, linear between them.
        factor: of the whole.
    """

    weight: Weight
    floor: float
    knots: NDArray[np.float64]
    disturbance: NDArray[np.float64]
    factor: float = 1.0

    def bound(self, piece: Piece) -> NDArray[np.float64]:
        """On the amplitude of each bin."""
        follows = (self.weight(piece.frequency) ** 2) * smooth(piece.predicted**2)
        stays = np.exp(np.interp(np.log(piece.frequency), np.log(self.knots), self.disturbance))
        return np.asarray(self.factor * np.sqrt(piece.variance + self.floor + np.maximum(follows, stays)))


def calibrated(pieces: Sequence[Piece]) -> Calibration:
    """A weight and a floor that cover what pieces leave over, and the factor by which 95 % of their bins are held.

    The floor is the typical square in the upper quarter of the bins, not the noise that is stated: that may be an
    offset. Bins count by the logarithm of their frequency, so that the few about a resonance weigh as much as the many
    in which there is noise alone.
    """
    omega = np.concatenate([p.frequency for p in pieces])
    upper = np.concatenate([p.left[3 * len(p.left) // 4 :] for p in pieces])
    floor = float(np.median(upper**2)) / math.log(2)
    squares = [smooth(p.left**2) for p in pieces]
    over = np.concatenate([np.maximum(s - p.variance - floor, 0.02 * s) for s, p in zip(squares, pieces, strict=True)])
    drive = np.concatenate([smooth(p.predicted**2) + 1e-300 for p in pieces])
    knots, means = binned(omega, over)
    weight = fit_weight(pieces[0].signal, omega, np.sqrt(over / drive))
    rough = Calibration(weight, floor, knots, np.log(np.maximum(means, 1e-300)))
    ratios = np.concatenate([p.left / rough.bound(p) for p in pieces])
    order = np.argsort(ratios)
    share = np.cumsum((1 / omega)[order])
    weighted = float(ratios[order][int(np.searchsorted(share, LEVEL * share[-1]))])
    # Whichever asks for more: the bins as they are, or weighed by their frequency.
    return replace(rough, factor=max(weighted, float(np.quantile(ratios, LEVEL))))
