"""Spectra of held-out recordings, by pieces: what was measured and predicted, what is left, and how draws vary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import FlexarmError

if TYPE_CHECKING:
    from diagnosis.estimation.least_squares import Fit
    from diagnosis.estimation.time_experiment import TimeExperiment

SMOOTH = 9
"""Bins over which spectra are averaged where a weight is fitted."""

LOWEST_BIN = 2
"""First bin of a window that counts: the mean and the trend of a record are not its response."""


@dataclass(frozen=True)
class Piece:
    """Spectra of a part of a held-out recording, shape (k,); ``variance`` is that of the draws."""

    recording: str
    signal: str
    unit: str
    part: tuple[float, float]
    frequency: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    left: NDArray[np.float64]
    variance: NDArray[np.float64]


def pieces_of(fit: Fit, draws: Sequence[NDArray[np.float64]], e: TimeExperiment, halves: bool) -> list[Piece]:
    """Spectra of a held-out recording, of its two halves where it is the only one."""
    from engine.errors import SimulationError

    simulated = fit.problem.simulate(draws[0], e)
    nominal, left = e.sampled(simulated), e.residual(simulated) * e.sigma
    spread = []
    for draw in draws[1:]:
        try:
            spread.append(e.sampled(fit.problem.simulate(draw, e)) - nominal)
        except SimulationError:
            continue
    rows, step = len(e.time), float(np.median(np.diff(e.time)))
    ends = [(0, rows // 2), (rows // 2, rows)] if halves else [(0, rows)]
    made = []
    for first, last in ends:
        count = last - first
        if count < 8 * SMOOTH:
            raise FlexarmError(
                f"recording '{e.name}' has {rows} rows, too few for a spectrum", remedy="hold out a longer one"
            )
        window = np.hanning(count)
        size = math.sqrt(float(np.sum(window**2)))
        keep = slice(LOWEST_BIN, None)
        omega = np.asarray(2 * np.pi * np.fft.rfftfreq(count, step)[keep], dtype=np.float64)

        def spectrum(values: Any, window: Any = window, size: float = size, keep: slice = keep) -> Any:
            plain = np.nan_to_num(values - np.nanmean(values))
            return np.abs(np.fft.rfft(plain * window)[keep]) / size

        for k, variable in enumerate(fit.problem.model.outputs):
            changes = np.array([spectrum(row[first:last, k]) ** 2 for row in spread] or [np.zeros(len(omega))])
            variance = changes.mean(axis=0)
            made.append(
                Piece(
                    e.name,
                    variable.name,
                    variable.unit,
                    (first / rows, last / rows),
                    omega,
                    spectrum(e.measured[first:last, k]),
                    spectrum(nominal[first:last, k]),
                    spectrum(left[first:last, k]),
                    variance,
                )
            )
    return made


def smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over `SMOOTH` neighbouring bins, fewer at the ends."""
    kernel = np.ones(SMOOTH)
    return np.asarray(np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same"))


def binned(omega: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Mean frequencies and mean values of 24 intervals of equal ratio; of those that hold bins."""
    place = np.digitize(omega, np.geomspace(float(omega.min()), float(omega.max()) * (1 + 1e-9), 25))
    found = np.unique(place)
    return tuple(np.array([rows[place == k].mean() for k in found]) for rows in (omega, values))
