"""The report of a comparison: every recording beside the model as given, and the error of each signal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm.report.origin import origin
from flexarm.report.page import render, write_page
from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from diagnosis.compare import Comparison, SignalError
    from diagnosis.recordings.types import Recorded
    from scenarios.load import Scenario


def write_comparisons(
    scenario: Scenario,
    found: Sequence[tuple[Recorded, Comparison]],
    path: Path,
    *,
    command: str = "",
) -> Path:
    """Write the report of a comparison.

    Args:
        scenario: what was simulated.
        found: each recording, and what came of it.
        path: the .html file to write; it appears whole or not at all.
        command: the command line.

    Raises:
        FlexarmError: the file cannot be written.
    """
    charts = _charts([comparison for _, comparison in found])
    text = render(
        "comparison.html.j2",
        charts,
        title=f"{scenario.name}: comparison",
        scenario=scenario,
        drawn=[chart.key for chart in charts],
        rows=[(c.recording, s, c.kind == "frequency_response") for _, c in found for s in c.signals.values()],
        notes=[
            (c.recording, (*((f"bypassed: {', '.join(c.bypassed)}",) if c.bypassed else ()), *c.notes))
            for _, c in found
        ],
        origin=origin(scenario, recordings=[recording.file for recording, _ in found], command=command),
    )
    return write_page(path, text)


def _charts(found: Sequence[Comparison]) -> list[Chart]:
    timed = tuple((c.recording, _panels(c)) for c in found if c.kind != "frequency_response")
    tables = tuple((c.recording, _levels(c)) for c in found if c.kind == "frequency_response")
    made = []
    if timed:
        made.append(Chart("signals", "Recordings and the model as given", "time", "s", timed, "Recording"))
    if tables:
        title = "Tables and the model as given"
        made.append(Chart("tables", title, "frequency", "rad/s", tables, "Recording", log=True))
    return made


def _panels(comparison: Comparison) -> tuple[Panel, ...]:
    panels = []
    for s in comparison.signals.values():
        both = (
            Trace("recording", s.axis, s.measured, "recording"),
            Trace("model as given", s.axis, s.simulated, "nominal"),
        )
        panels.append(Panel(s.name, s.unit, both))
        left = Trace("recording less model", s.axis, s.measured - s.simulated, "nominal")
        panels.append(Panel(f"left over of {s.name}", s.unit, (left,)))
    return tuple(panels)


def _levels(comparison: Comparison) -> tuple[Panel, ...]:
    return tuple(_level(s) for s in comparison.signals.values())


def _level(signal: SignalError) -> Panel:
    order = np.argsort(signal.axis, kind="stable")
    with np.errstate(divide="ignore"):
        rows = [20 * np.log10(values[order]) for values in (signal.measured, signal.simulated)]
    measured = Trace("recording", signal.axis[order], rows[0], "recording", points=True)
    return Panel(
        signal.name,
        f"dB re 1 {signal.unit}",
        (measured, Trace("model as given", signal.axis[order], rows[1], "nominal")),
    )
