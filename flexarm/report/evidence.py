"""The evidence of a diagnosis as charts: the effort that is missing, against what it seems to depend on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from diagnosis.search.force_recovery import Curve

WIDEST = 1.0
"""Height of a curve by which its band may lie above or below it."""


def evidence_charts(curves: Iterable[Curve]) -> list[Chart]:
    """One chart for each curve of the recovered force; see `diagnosis.verdict.verdict.Diagnosis.evidence`."""
    return [_chart(f"evidence{i}", curve) for i, curve in enumerate(curves)]


def _chart(key: str, curve: Curve) -> Chart:
    order = np.argsort(curve.x)
    x, y, low, high = (values[order] for values in (curve.x, curve.y, curve.low, curve.high))
    # Where little was met the band may be many times what it shows, which would then be a flat line.
    there = y[np.isfinite(y)]
    least, most = (float(there.min()), float(there.max())) if there.size else (0.0, 0.0)
    room = WIDEST * (most - least)
    cut = room > 0 and bool((low < least - room).any() or (high > most + room).any())
    if cut:
        low, high = np.maximum(low, least - room), np.minimum(high, most + room)
    panel = Panel(curve.y_label, curve.y_unit, (Trace(curve.y_label, x, y, "amended", low, high),))
    notes = (
        ["The band is cut where it is wider than the whole curve is high: there the recordings say little."]
        if cut
        else []
    )
    return Chart(key, curve.title, curve.x_label, curve.x_unit, (("", (panel,)),), notes=notes)
