"""The evidence of a diagnosis as charts: the effort that is missing, against what it seems to depend on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.report.series import Chart, Panel, Trace


def evidence_charts(found: Any) -> list[Chart]:
    """One chart for each curve of ``found.evidence``; none where the diagnosis recovered no curve."""
    given = getattr(found, "evidence", None)
    curves = [] if given is None else list(given) if isinstance(given, Sequence) else [given]
    charts = []
    for i, curve in enumerate(curves):
        made = _chart(f"evidence{i}", curve)
        if made is not None:
            charts.append(made)
    return charts


def _chart(key: str, curve: Any) -> Chart | None:
    x, y = np.asarray(_of(curve, "x", default=()), dtype=float), np.asarray(_of(curve, "y", default=()), dtype=float)
    if x.ndim != 1 or x.shape != y.shape or not len(x):
        return None
    order = np.argsort(x)
    low, high = (_of(curve, name, default=None) for name in ("low", "high"))
    low, high = (None if v is None else np.asarray(v, dtype=float)[order] for v in (low, high))
    x_label = str(_of(curve, "x_label", "regressor", default="regressor"))
    y_label = str(_of(curve, "y_label", "label", default="recovered effort"))
    trace = Trace(y_label, x[order], y[order], "amended", low, high)
    panel = Panel(y_label, str(_of(curve, "y_unit", default="")), (trace,))
    title = str(_of(curve, "title", "sentence", default=f"{y_label} against {x_label}"))
    return Chart(key, title, x_label, str(_of(curve, "x_unit", default="")), (("", (panel,)),))


def _of(curve: Any, *names: str, default: Any) -> Any:
    for name in names:
        value = curve.get(name) if isinstance(curve, dict) else getattr(curve, name, None)
        if value is not None:
            return value
    return default
