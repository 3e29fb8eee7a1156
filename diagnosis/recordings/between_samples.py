"""Inputs between their samples: held, straight, or band-limited, as a generator's reconstruction filter leaves them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import RecordingError, Vector

BAND_LIMITED = "band_limited"
PARTS = 16
"""Straight pieces per interval: at 0.4 of the sampling frequency they are within (0.8 pi / 16)^2 / 8 = 0.3 % of it."""
TAPS = 48
"""Samples on either side that a point between samples is made of."""
KAISER = 10.0
"""Shape of the window over the taps: ripple 1e-5, transition band 1 / 12 of the sampling frequency."""
UNEVEN = 1e-3
"""Share of an interval by which instants may deviate from even ones."""


def between_samples(
    time: Vector, values: NDArray[np.float64], holds: Sequence[str]
) -> tuple[Vector, NDArray[np.float64]]:
    """Instants and values of inputs, at `PARTS` to an interval if one of them is band-limited.

    Band-limited: the sum of samples times shifted sinc functions (Whittaker and Shannon), windowed [Kaiser]. Before the
    first and after the last sample the signal is mirrored at them, which keeps value and slope.

    Args:
        time: of the samples (s), shape (samples,).
        values: shape (samples, inputs).
        holds: of each input.

    Raises:
        RecordingError: a band-limited input whose samples are not evenly spaced.
    """
    if BAND_LIMITED not in holds:
        return time, values
    even = np.linspace(time[0], time[-1], len(time))
    interval = (time[-1] - time[0]) / (len(time) - 1)
    if np.abs(time - even).max() > UNEVEN * interval:
        raise RecordingError(
            "samples that are not evenly spaced have no band-limited course between them", remedy="write 'hold: linear'"
        )
    count = PARTS * (len(time) - 1) + 1
    fine = np.linspace(time[0], time[-1], count)
    columns = []
    for column, hold in zip(values.T, holds, strict=True):
        if hold == BAND_LIMITED:
            columns.append(_interpolated(column))
        elif hold == "linear":
            columns.append(np.interp(fine, time, column))
        else:
            columns.append(np.append(np.repeat(column[:-1], PARTS), column[-1]))
    return fine, np.column_stack(columns)


def _interpolated(samples: Vector) -> Vector:
    """A signal at `PARTS` points to an interval, the samples among them."""
    reach = min(TAPS, len(samples) - 1)
    padded = np.concatenate(
        [2 * samples[0] - samples[reach:0:-1], samples, 2 * samples[-1] - samples[-2 : -2 - reach : -1]]
    )
    offsets = np.arange(-reach + 1, reach + 1)
    made = np.empty((len(samples) - 1, PARTS))
    made[:, 0] = samples[:-1]
    for part in range(1, PARTS):
        place = part / PARTS - offsets
        window = np.i0(KAISER * np.sqrt(np.clip(1 - (place / (reach + 1)) ** 2, 0, None))) / np.i0(KAISER)
        weights = np.sinc(place) * window
        made[:, part] = np.convolve(padded, weights[::-1], mode="valid")[1 : 1 + len(made)]
    return np.append(made.ravel(), samples[-1])
