"""Curves for a report's plots: thinned to what a screen can show, and written as compact JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BUDGET = 220_000
"""Numbers on a page: with six digits each, about 2 MB."""
MOST, LEAST = 4000, 240
"""Points of one curve."""


@dataclass(frozen=True)
class Trace:
    """A curve: its name in the legend, x and y of shape (n,), and the style that the page's style sheet gives it.

    ``low`` and ``high`` make a band around it; with ``points`` it is drawn as points without a line.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    style: str = "s1"
    low: ArrayLike | None = None
    high: ArrayLike | None = None
    points: bool = False


@dataclass(frozen=True)
class Panel:
    """Curves over a common y axis; ``band`` is shaded between two heights, with its name in the legend."""

    label: str
    unit: str
    traces: tuple[Trace, ...]
    band: tuple[float, float] | None = None
    band_name: str = ""


@dataclass(frozen=True)
class Chart:
    """Panels over a common x axis; ``views`` are what the reader can choose between, such as recordings.

    Curves whose names are in ``hidden`` are shown only once the reader asks for them; with ``log`` the x axis is
    logarithmic.
    """

    key: str
    title: str
    x_label: str
    x_unit: str
    views: tuple[tuple[str, tuple[Panel, ...]], ...]
    choice: str = ""
    hidden: tuple[str, ...] = ()
    log: bool = False
    notes: list[str] = field(default_factory=list)


def fitting(charts: Sequence[Chart], budget: int = BUDGET) -> list[Chart]:
    """The charts with curves thinned until they fit the budget, each with a note that says so.

    A curve that is too long keeps the least and the greatest value of every stretch, so that no peak is lost. Views
    that would still not fit are left out, and named.
    """
    lengths = [np.size(t.y) for c in charts for _, panels in c.views for p in panels for t in p.traces]
    most = MOST
    while most > LEAST and sum(2 * min(n, most) for n in lengths) > budget:
        most = int(most * 0.8)
    most = max(most, LEAST)
    left, made = budget, []
    for chart in charts:
        views: list[tuple[str, tuple[Panel, ...]]] = []
        dropped: list[str] = []
        thinned = 0
        for name, panels in chart.views:
            cost = sum(2 * min(np.size(t.y), most) for p in panels for t in p.traces)
            if cost > left and views:
                dropped.append(name)
                continue
            left -= cost
            thinned = max([thinned, *(np.size(t.y) for p in panels for t in p.traces if np.size(t.y) > most)])
            views.append((name, tuple(replace(p, traces=tuple(thin(t, most) for t in p.traces)) for p in panels)))
        notes = list(chart.notes)
        if thinned:
            notes.append(
                f"Curves of up to {thinned} points are drawn with {most}: the least and the greatest value of every "
                "stretch, so that no peak is lost."
            )
        if dropped:
            notes.append(f"Left out to keep this page small: {', '.join(dropped)}.")
        made.append(replace(chart, views=tuple(views), notes=notes))
    return made


def thin(trace: Trace, most: int) -> Trace:
    """At most about ``most`` points: the least and the greatest of every stretch, in order."""
    x, y = np.asarray(trace.x, dtype=float), np.asarray(trace.y, dtype=float)
    if len(y) <= most or trace.low is not None:
        return trace
    edges = np.linspace(0, len(y), max(most // 2, 1) + 1).astype(int)
    filled = np.where(np.isfinite(y), y, np.nan)
    picks = {0, len(y) - 1}
    for begin, end in pairwise(edges.tolist()):
        part = filled[begin:end]
        if np.isfinite(part).any():
            picks |= {begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))}
        else:
            picks.add(begin)
    kept = np.array(sorted(picks))
    return replace(trace, x=x[kept], y=y[kept])


def as_json(charts: Iterable[Chart]) -> str:
    """The charts as JSON that may stand inside a script element: nothing in it can end that element."""
    rows = [
        {
            "key": c.key,
            "hidden": list(c.hidden),
            "x": {"label": c.x_label, "unit": c.x_unit, "log": c.log},
            "views": [{"name": name, "panels": [_panel(p) for p in panels]} for name, panels in c.views],
        }
        for c in charts
    ]
    text = json.dumps(rows, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _panel(panel: Panel) -> dict[str, Any]:
    row: dict[str, Any] = {"label": panel.label, "unit": panel.unit, "traces": [_trace(t) for t in panel.traces]}
    if panel.band is not None and all(math.isfinite(v) for v in panel.band):
        row |= {"band": list(panel.band), "bandName": panel.band_name}
    return row


def _trace(trace: Trace) -> dict[str, Any]:
    x = np.asarray(trace.x, dtype=float)
    row: dict[str, Any] = {"name": trace.name, "style": trace.style, "y": _numbers(trace.y)}
    even = len(x) > 2 and bool(np.allclose(np.diff(x), x[1] - x[0], rtol=1e-6, atol=0))
    row |= {"t0": float(x[0]), "dt": float((x[-1] - x[0]) / (len(x) - 1))} if even else {"x": _numbers(x)}
    if trace.points:
        row["points"] = True
    if trace.low is not None and trace.high is not None:
        row |= {"low": _numbers(trace.low), "high": _numbers(trace.high)}
    return row


def _numbers(values: ArrayLike) -> list[float | None]:
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in np.asarray(values, dtype=float).tolist()]
