"""What figures of frequency responses share: units of ratios, ticks in degrees, and plain axes."""

from __future__ import annotations

from typing import Any

FLOOR = 1e-300
"""Gains below it are taken for none."""


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


def degrees(axis: Any, low: float, high: float) -> None:
    """Put the ticks of an axis in degrees at parts of a right angle, as many as fit between two values."""
    from matplotlib.ticker import MultipleLocator

    spread = high - low
    axis.set_major_locator(
        MultipleLocator(45 if spread < 300 else 90 if spread < 800 else 180 if spread < 1600 else 360)
    )
