"""``flexarm run SCENARIO``: simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexarm.console.options import ScenarioArgument, SetOption, load, picture, seconds


def run(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="[PNG]", help="Draw the result; NAME.png without a file name.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write .csv, .parquet or .mat.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="HTML", help="Write a page with diagram, plots and provenance.")
    ] = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="End, such as '10 s'.")] = None,
    step: Annotated[str | None, typer.Option(metavar="TIME", help="Interval between rows, such as '1 ms'.")] = None,
) -> None:
    """Simulate a scenario."""
    import time

    from engine.energy import conserved, may_be_conservative
    from engine.files import check_suffix
    from flexarm.api import simulate
    from flexarm.console.text import columns, number, plural
    from flexarm.output import TABLES, write_result
    from flexarm.plotting.results import plot as draw

    if output is not None:
        check_suffix(output, TABLES)
    loaded = load(scenario, overrides)
    if report is not None:
        check_suffix(report, (".html", ".htm"))
    plot = picture(plot, loaded)
    begun = time.perf_counter()
    result = simulate(loaded, seconds(stop, "--stop"), seconds(step, "--step"), record_states=may_be_conservative)
    spent = time.perf_counter() - begun
    typer.echo(f"{loaded.name}: {loaded.description}" if loaded.description else loaded.name)
    typer.echo(
        f"{number(result.time[-1])} s in {len(result.time)} rows, {result.steps} steps of at most "
        f"{number(result.internal_step)} s, {plural(result.event_count, 'switch')}, {spent:.2f} s of work"
    )
    asked = seconds(stop, "--stop") or (loaded.simulation.stop if loaded.simulation else None)
    if asked is not None and asked - result.time[-1] > 1e-9 * asked:
        typer.echo(f"the last row is at {number(result.time[-1])} s: the step does not divide the {number(asked)} s")
    if (energy := conserved(result, lambda: loaded.build(energy=True))) is not None:
        typer.echo(
            f"energy: {number(energy.start)} J at the start, {number(energy.end)} J at the end, at most "
            f"{energy.drift:.2g} J off on the way; nothing is supplied or dissipated"
        )
    rows = [
        [name, unit.strip("*"), number(values[-1]), number(values.min()), number(values.max())]
        for name, unit, values in ((n, result.units[n], result[n]) for n in result.names)
    ]
    typer.echo(columns(["signal", "unit", "end", "least", "greatest"], rows))
    if output is not None:
        write_result(output, result, loaded)
        typer.echo(f"written: {output}")
    if plot is not None:
        typer.echo(f"written: {draw(result, plot, loaded.name)}")
    if report is not None:
        from flexarm.report import write_run
        from flexarm.report.origin import command_line

        typer.echo(f"written: {write_run(loaded, result, report, command=command_line())}")
