"""Tones: frequencies at which residuals have more power than around them, taken over all recordings together.

What vibrates from outside has one frequency, whatever the input is. A resonance or a wrong law leaves more power, but
over a band. So power is compared with the median of what is around it, and added up over signals and recordings. The
transforms are padded with zeros: an oscillation is followed through a recording only from a fraction of a line away.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.fft

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.time_experiment import over_time, power_spectrum
from diagnosis.thresholds import NOISE, TONES


def tones(experiments: Sequence[Experiment], left: Mapping[str, Array], most: int) -> list[float]:
    """The frequencies (rad/s) that stand out most, the first most of all; none where no recording is over time.

    Args:
        experiments: of which some are over time.
        left: their residuals by name, shape (samples, signals) each.
        most: how many.
    """
    recorded = [e for e in over_time(experiments) if len(e.time) >= NOISE.fewest]
    spectra = [_prominence(*e.evenly(left[e.name])) for e in recorded]
    if not spectra:
        return []
    finest = min(rate for rate, _ in spectra)
    count = int(max(rate * len(found) for rate, found in spectra) / finest)
    grid = finest * np.arange(count)
    total = np.sum([np.interp(grid, rate * np.arange(len(p)), p, right=0.0) for rate, p in spectra], axis=0)
    width = TONES.finer * TONES.apart  # what falls from the lowest lines on is a drift
    peaks = [k for k in range(width, count - width) if total[k] == total[k - width : k + width + 1].max() > 0]
    return [float(grid[k]) for k in sorted(peaks, key=lambda k: -total[k])[:most]]


def _prominence(r: Array, interval: float) -> tuple[float, Array]:
    """How many times what is around it a residual's power is, over its signals, and the distance of lines (rad/s)."""
    length = scipy.fft.next_fast_len(TONES.finer * len(r), real=True)
    power = power_spectrum(r, length)
    ratios = power / np.maximum(_around(power), np.finfo(float).tiny)
    return 2 * math.pi / (length * interval), np.asarray(ratios.sum(axis=1))


def _around(power: Array) -> Array:
    """The median of the power around each line of a padded spectrum, shape (lines, signals)."""
    edges = [TONES.finer]
    while edges[-1] < len(power):
        edges.append(min(len(power), max(edges[-1] + TONES.finer * TONES.around, round(edges[-1] * 2 ** (1 / 3)))))
    bands = [slice(a, b) for a, b in itertools.pairwise(edges)]
    middles = [0.5 * math.log(b.start * b.stop) for b in bands]
    place = np.log(np.maximum(np.arange(len(power)), 1))
    levels = np.array([np.median(power[b], axis=0) for b in bands])
    return np.column_stack([np.interp(place, middles, column) for column in levels.T])
