"""``flexarm sweep SCENARIO``: grids and Monte Carlo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.errors import FlexarmError
from flexarm.console import completion
from flexarm.console.interrupt import INTERRUPTED
from flexarm.console.options import OutputsOption, ScenarioArgument, SetOption, load, names, seconds

if TYPE_CHECKING:
    from flexarm.sweeps.metrics import Metric


def sweep(
    scenario: ScenarioArgument,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR|FILE.parquet", help="A folder, or the table itself.")
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="KEY=...",
            help="KEY=START:STOP:N, KEY=A,B,C, KEY~tolerance, KEY~10%, KEY~LOW:HIGH, KEY~normal(10%), "
            "KEY~lognormal(10%) or KEY~triangular(LOW, PEAK, HIGH); repeatable.",
            autocompletion=completion.keys,
        ),
    ] = None,
    overrides: SetOption = None,
    runs: Annotated[int | None, typer.Option("--runs", "-n", help="Draws at each point of the grid.")] = None,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    outputs: OutputsOption = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="End, such as '10 s'.")] = None,
    step: Annotated[str | None, typer.Option(metavar="TIME", help="Interval between rows, such as '1 ms'.")] = None,
    keep: Annotated[
        str | None, typer.Option(metavar="TIME", help="Also keep the outputs over time, at this interval.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; as many as cores by default.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler whose workers are used instead.")
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Throw away what is there, and begin again.")] = False,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            "--metric",
            "-m",
            metavar="NAME=...",
            help="Number of each run: overshoot(SIGNAL), settling_time(SIGNAL, band=2%), rms(SIGNAL, after=1 s) "
            "or FILE.py:FUNCTION; repeatable.",
        ),
    ] = None,
    from_fit: Annotated[
        Path | None, typer.Option(metavar="FIT.json", help="Draw what 'flexarm fit --json' left uncertain, as it is.")
    ] = None,
    figures: Annotated[
        bool, typer.Option("--figures", help="Draw tornado.png and scatter.png beside the table.")
    ] = False,
) -> None:
    """Run a scenario over grids of values and draws within tolerances; a table with a row for each run.

    Interrupted, it goes on where it was when the same command is given again.
    """
    import sys

    from flexarm.console.interrupt import heard
    from flexarm.console.progress import Progress
    from flexarm.console.text import plural
    from flexarm.sweeps.sweep import SweepOptions
    from flexarm.sweeps.sweep import sweep as run

    loaded = load(scenario, overrides)
    at = (0, 0)
    try:
        with heard() as check, Progress(f"{loaded.name}: runs") as bar:

            def progress(done: int, total: int) -> None:
                nonlocal at
                first, at = at[1] == 0, (done, total)
                check()
                # Processes start and models are compiled before the first run is over.
                bar.update(None if first else done / total, f"starting, {done} of {total} are done" if first else "")

            def warn(text: str) -> None:
                bar.note(f"warning: such runs have no numbers, the others go on: {text}")

            bar.update(None, "trying the values of --vary")
            options = SweepOptions(
                runs=runs,
                seed=seed,
                outputs=names(outputs),
                stop=seconds(stop, "--stop"),
                step=seconds(step, "--step"),
                keep=seconds(keep, "--keep"),
                workers=workers,
                scheduler=scheduler,
                restart=restart,
                progress=progress,
                warn=warn,
                metrics=metric or (),
                from_fit=from_fit,
            )
            made = run(loaded, vary or [], output, options)
    except KeyboardInterrupt:
        sys.stderr.write(f"interrupted after {at[0]} of {at[1]} runs; the same command goes on from there\n")
        raise typer.Exit(INTERRUPTED) from None
    typer.echo(f"{loaded.name}: {plural(made.plan.total, 'run')}, {made.computed} of them computed now")
    typer.echo(_ranges(made.table, made.plan.outputs, made.plan.metrics))
    drawn: tuple[Path, ...] = ()
    if figures:
        from flexarm.plotting.sweeps import plot_sweep

        try:
            drawn = plot_sweep(made)
        except FlexarmError as error:  # the runs are done and their table is whole
            typer.echo(f"no figures: {error}", err=True)
    for path in (made.table, made.trajectories, *drawn):
        if path is not None:
            typer.echo(f"written: {path}")
    if (reasons := _reasons(made.table)) and len(reasons) == made.plan.total:
        raise FlexarmError(f"every run failed; the first: {reasons[0]}")


def _ranges(table: Path, outputs: tuple[tuple[str, str], ...], metrics: tuple[Metric, ...]) -> str:
    """What the runs span, output by output, and how many failed."""
    import numpy as np

    from flexarm.console.text import columns, number, plural
    from flexarm.table import read

    rows = []
    for name, unit in outputs:
        spans = []
        for kind in ("final", "min", "max"):
            values = read(table, [f"{name}.{kind}"])[f"{name}.{kind}"]
            values = values[np.isfinite(values)]
            spans += [number(values.min()), number(values.max())] if len(values) else ["-", "-"]
        rows.append([name, unit, f"{spans[0]} ... {spans[1]}", spans[2], spans[5]])
    parts = [columns(["signal", "unit", "end", "least", "greatest"], rows)]
    for metric in metrics:
        values = read(table, [metric.name])[metric.name]
        values = values[np.isfinite(values)]
        if len(values):
            low, middle, high = (number(v) for v in np.quantile(values, [0.05, 0.5, 0.95]))
            unit = "" if metric.unit in ("1", "*") else metric.unit
            parts.append(
                f"  {metric.name}: {' '.join(filter(None, ('median', middle, unit)))}, 5 to 95 % {low} to {high}"
            )
    if reasons := _reasons(table):
        parts.append(f"  {plural(len(reasons), 'run')} failed; the first: {reasons[0]}")
    return "\n".join(parts)


def _reasons(table: Path) -> list[str]:
    """Why runs failed, those that did."""
    from flexarm.table import read

    return [reason for reason in read(table, ["failure"])["failure"] if reason is not None]
