"""The report of a simulation: wiring, outputs, energy, switches, parameters, and everything needed to repeat it."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from engine.errors import FlexarmError
from engine.simulate import Result, simulate
from flexarm.plotting.results import panels as grouped
from flexarm.plotting.wiring.diagram import diagram
from flexarm.report.origin import origin
from flexarm.report.page import render, write_page
from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from scenarios.load import Scenario

MOST_EVENTS = 300
STYLES = ("s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8")
ENERGY = ("energy.stored", "energy.supplied", "energy.dissipated", "energy.residual")


def write_run(scenario: Scenario, result: Result, path: Path, *, command: str = "") -> Path:
    """Write the report of a simulation.

    Args:
        scenario: what was simulated.
        result: what came of it.
        path: the .html file to write; it appears whole or not at all.
        command: the command line.

    Raises:
        FlexarmError: the file cannot be written.
    """
    return write_page(path, page(scenario, result, command=command))


def page(scenario: Scenario, result: Result, *, command: str = "") -> str:
    """The report as HTML; arguments as of `write_run`."""
    rows: list[Panel] = []
    styles = cycle(STYLES)
    for unit, names in grouped(result.units):
        traces = tuple(Trace(n, result.time, result[n], next(styles)) for n in names)
        rows.append(
            Panel(", ".join(names) if len(names) < 4 else f"{names[0]} and {len(names) - 1} more", unit, traces)
        )
    charts = [Chart("outputs", "Outputs over time", "time", "s", (("", tuple(rows)),))]
    energy, why = _energy(scenario, result)
    if energy is not None:
        charts.append(energy)
    labels = {mode.name: mode.labels for mode in result.model.modes}
    events = [(t, name, _label(labels.get(name, ()), value)) for t, name, value in result.events[:MOST_EVENTS]]
    return render(
        "run.html.j2",
        charts,
        title=f"{scenario.name}: simulation",
        scenario=scenario,
        result=result,
        picture=diagram(scenario),
        signals=[(n, result.units[n], result[n]) for n in result.names],
        energy=energy is not None,
        no_energy=why,
        events=events,
        parameters=[
            (p.name, result.parameters.get(p.name, v), p.unit)
            for p, v in zip(result.model.parameters, np.ravel(result.model.parameter_values), strict=True)
        ],
        origin=origin(scenario, command=command),
    )


def _label(labels: tuple[str, ...], value: float) -> str:
    index = int(value) + 1
    return labels[index] if 0 <= index < len(labels) else f"{value:g}"


def _energy(scenario: Scenario, result: Result) -> tuple[Chart | None, str]:
    """The energy balance, from a second run that keeps its books; or why there is none."""
    try:
        model = scenario.build(outputs=[], energy=True)
        step = float(result.time[1] - result.time[0])
        run = simulate(
            model,
            float(result.time[-1]),
            step,
            internal_step=result.internal_step,
            parameters=result.parameters or None,
        )
    except FlexarmError as error:
        return None, error.message
    traces = tuple(
        Trace(name.partition(".")[2], run.time, run[name], STYLES[i])
        for i, name in enumerate(ENERGY[:3])
        if name in run.names
    )
    if not traces:
        return None, "the model keeps no energy balance"
    rows = [Panel("", "J", traces)]
    if "energy.residual" in run.names:
        rows.append(
            Panel("not explained by the balance", "J", (Trace("residual", run.time, run["energy.residual"], "s4"),))
        )
    return Chart("energy", "Energy over time", "time", "s", (("", tuple(rows)),)), ""
