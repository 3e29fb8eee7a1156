"""How results and linear models look in a notebook: small tables in HTML, a spark line for each signal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

MOST_ROWS = 30
"""Rows of a table that are shown."""

ROUNDING = 1e-12
"""Share of the largest root below which another one is shown as 0: eigenvalues are rounded by about as much."""

_POINTS = 60


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """A table; cells are HTML already."""
    rows = list(rows)
    shown = [f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows[:MOST_ROWS]]
    if len(rows) > MOST_ROWS:
        shown.append(f'<tr><td colspan="{len(heads)}">and {len(rows) - MOST_ROWS} more</td></tr>')
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    said = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{said}<thead><tr>{head}</tr></thead><tbody>{''.join(shown)}</tbody></table>"


def counts(**numbers: int) -> str:
    """Counts with their words: ``6 states, 1 input``."""
    return ", ".join(f"{n} {word if n != 1 else word[:-1]}" for word, n in numbers.items())


def number(value: float) -> str:
    """A number in six digits."""
    return f"{value:.6g}"


def root(value: complex) -> str:
    """A root in six digits: ``-7.917+24.785i``."""
    if abs(value.imag) < 1e-9 * max(1.0, abs(value)):
        return number(value.real)
    return f"{value.real:.6g}{value.imag:+.6g}i"


def without_rounding(values: Iterable[complex], beside: Iterable[complex] = ()) -> list[complex]:
    """Roots, those within rounding of the largest as 0: what a free body's pole comes to differs between processors.

    Args:
        values: the roots.
        beside: others of the same model, by which rounding is measured too, such as its poles for its zeros.
    """
    found = [complex(value) for value in values]
    least = ROUNDING * max(map(abs, [*found, *beside]), default=0.0)
    return [value if abs(value) > least else 0j for value in found]


def roots(values: Iterable[complex], most: int = 12) -> str:
    """Roots in a row, the first ``most`` of them."""
    found = without_rounding(values)
    return ", ".join(map(root, found[:most])) + (f", and {len(found) - most} more" if len(found) > most else "")


def spark(values: NDArray[np.float64], width: int = 120, height: int = 22) -> str:
    """A signal as a small line, least and greatest value of each stretch kept; empty where it is not finite."""
    if not len(values) or not np.isfinite(values).all():
        return ""
    low, high = float(values.min()), float(values.max())
    span = high - low or 1.0
    if len(values) > 2 * _POINTS:
        parts = np.array_split(values, _POINTS)
        values = np.array([end for part in parts for end in (part.min(), part.max())])
    x = np.linspace(1, width - 1, len(values)) if len(values) > 1 else np.array([width / 2])
    y = height - 1 - (values - low) / span * (height - 2)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True) if math.isfinite(b))
    return (
        f'<svg width="{width}" height="{height}" role="img" aria-label="from {low:.3g} to {high:.3g}">'
        f'<polyline points="{points}" fill="none" stroke="#1b6ca8" stroke-width="1"/></svg>'
    )
