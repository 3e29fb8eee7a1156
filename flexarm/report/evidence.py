"""The evidence of a diagnosis as charts: the effort that is missing, against what it seems to depend on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from diagnosis.search.force_recovery import Curve


def evidence_charts(curves: Iterable[Curve]) -> list[Chart]:
    """One chart for each curve of the recovered force; see `diagnosis.verdict.verdict.Diagnosis.evidence`."""
    return [_chart(f"evidence{i}", curve) for i, curve in enumerate(curves)]


def _chart(key: str, curve: Curve) -> Chart:
    order = np.argsort(curve.x)
    x, y, low, high = (values[order] for values in (curve.x, curve.y, curve.low, curve.high))
    panel = Panel(curve.y_label, curve.y_unit, (Trace(curve.y_label, x, y, "amended", low, high),))
    return Chart(key, curve.title, curve.x_label, curve.x_unit, (("", (panel,)),))
