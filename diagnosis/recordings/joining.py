"""Several files of one recording on one time axis: that of the first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns_type import Vector

GAP = 3.0
"""Usual intervals without a sample, beyond which nothing is interpolated."""
SAME = 1e-6
"""Share of an interval within which two instants are one."""


@dataclass(frozen=True)
class Clock:
    """The instants of a column that is not of the leading file.

    Attributes:
        time: s, on the clock of the leading file, shape (rows,).
    """

    time: Vector

    def held(self, values: Vector, axis: Vector) -> Vector:
        """The last value at or before each instant of the axis; NaN before the first and after the last."""
        time, values = _usable(self.time, values)
        near = SAME * float(np.median(np.diff(axis)))
        place = np.searchsorted(time, axis + near, side="right") - 1
        made = np.where(place >= 0, values[np.maximum(place, 0)], np.nan)
        usual = float(np.median(np.diff(time)))
        return np.where(axis <= time[-1] + usual + near, made, np.nan)

    def straight(self, values: Vector, axis: Vector) -> Vector:
        """The straight line between samples; NaN outside."""
        time, values = _usable(self.time, values)
        return np.interp(axis, time, values, left=np.nan, right=np.nan)

    def measured(self, values: Vector, axis: Vector) -> Vector:
        """Samples moved to instants of the axis, along a cubic spline: no more numbers than were measured.

        Where the column was sampled less often than the axis, each sample is moved to the nearest instant, by half an
        interval of the axis at most, and the other instants hold NaN: noise stays what it was. Else each instant takes
        its value. Nothing is made up in gaps.
        """
        from scipy.interpolate import CubicSpline  # on first use, as it is large and seldom needed

        time, values = _usable(self.time, values)
        if len(time) < 4:
            return np.full(len(axis), np.nan)
        own, step = float(np.median(np.diff(time))), float(np.median(np.diff(axis)))
        found = np.asarray(CubicSpline(time, values)(axis), dtype=float)
        place = np.clip(np.searchsorted(time, axis), 1, len(time) - 1)
        before, after = axis - time[place - 1], time[place] - axis
        there = (before >= -SAME * step) & (after >= -SAME * step)
        there &= (before + after <= GAP * own) | (np.minimum(before, after) <= SAME * step)
        if own > 1.5 * step:
            nearest = np.clip(np.searchsorted(axis, time), 1, len(axis) - 1)
            nearest -= time - axis[nearest - 1] < axis[nearest] - time
            chosen = np.zeros(len(axis), dtype=bool)
            chosen[nearest[np.abs(axis[nearest] - time) <= (0.5 + SAME) * step]] = True
            there &= chosen
        return np.where(there, found, np.nan)


def _usable(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Samples that are numbers, in order of time."""
    there: NDArray[np.bool_] = np.isfinite(time) & np.isfinite(values)
    time, values = time[there], values[there]
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    keep = np.concatenate([[True], np.diff(time) > 0]) if len(time) else there[:0]
    return time[keep], values[keep]
