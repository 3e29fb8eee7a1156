"""What figures of frequency responses share: units of ratios, ticks in degrees, and plain axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

FLOOR = 1e-300
"""Gains below it are taken for none."""
ON_THE_CUT = 1e-3
"""Degrees below half a turn that rounding may leave of it."""
TICKS = (2, 5, 15, 45, 90, 180, 360)
"""Degrees between two ticks."""


def per(above: str, below: str) -> str:
    """The unit of a ratio, such as ``rad/(N·m)``."""
    top, bottom = (u.replace(".", "·") if u not in ("", "*") else "1" for u in (above, below))
    if bottom == "1":
        return top
    return f"{top}/({bottom})" if set(bottom) & set("·/") else f"{top}/{bottom}"


def clean(axis: Any) -> None:
    """Give an axis a light grid, and take its upper and right edges away."""
    axis.grid(True, color="#dddddd", linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_axisbelow(True)


def phase(answer: NDArray[Any], frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """The phase (deg) of complex answers, without jumps.

    Where the answers begin as k (j w)^n does, by gain and phase, it begins near 90 n degrees: behind a double
    integrator at -180, and not at +180. Elsewhere, as near a resonance, it begins from -180 up to 180 degrees.
    """
    found = np.degrees(np.unwrap(np.angle(answer)))
    if len(found) and found[0] > 180 - ON_THE_CUT:
        found = found - 360.0
    gains = np.abs(answer[:2])
    if len(gains) == 2 and gains.min() > FLOOR and frequency[1] > frequency[0] > 0:
        order = round(math.log(gains[1] / gains[0]) / math.log(frequency[1] / frequency[0]))
        turns = (90 * order - found[0]) / 360
        if abs(order) < 4 and abs(turns - round(turns)) < 1 / 8:
            found = found + 360.0 * round(turns)
    return np.asarray(found)


def degrees(axis: Any, low: float, high: float) -> None:
    """Put the ticks of an axis in degrees at parts of a right angle, up to seven between two values."""
    from matplotlib.ticker import MultipleLocator

    fitting = (step for step in TICKS if high - low < 6.7 * step)
    axis.set_major_locator(MultipleLocator(next(fitting, TICKS[-1])))
