"""``flexarm uncertain SCENARIO``: a family of linear models from what recordings say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flexarm.console.options import (
    AnalysisOption,
    AtOption,
    HoldOutOption,
    InputsOption,
    ModeOption,
    OutputsOption,
    RecordingsArgument,
    ScenarioArgument,
    SetOption,
    TrimOption,
    WorkersOption,
    load,
    names,
    pairs,
    picture,
)

if TYPE_CHECKING:
    from flexarm.design.uncertainty.results import UncertainModel


def uncertain(
    scenario: ScenarioArgument,
    recordings: RecordingsArgument = None,
    hold_out: HoldOutOption = None,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    mode: ModeOption = None,
    at: AtOption = None,
    trim: TrimOption = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Members of the family; 50 by default.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the fit and the draws; 0 by default.")] = None,
    workers: WorkersOption = None,
    output: Annotated[
        list[Path] | None, typer.Option("--output", "-o", metavar="FILE", help="Write .json, .mat or .m; repeatable.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="[PNG]", help="Draw the bounds; NAME-uncertain.png without a file name."),
    ] = None,
) -> None:
    """Fit, draw a family of linear models from the covariance, and bound held-out responses at 95 %."""
    from engine.files import check_suffix
    from flexarm.api import uncertain as run
    from flexarm.console.progress import Progress
    from flexarm.design.uncertainty.files import write

    for path in output or []:
        check_suffix(path, (".json", ".mat", ".m"))
    loaded = load(scenario, overrides)
    plot = picture(plot, loaded, "-uncertain")
    with Progress(f"{loaded.name}: held-out responses") as bar:
        found = run(
            loaded,
            analysis,
            recordings=recordings or (),
            hold_out=hold_out or (),
            inputs=names(inputs),
            outputs=names(outputs),
            modes=pairs(mode, "--mode"),
            at=pairs(at, "--at"),
            trim=trim,
            samples=samples,
            seed=seed,
            workers=workers,
            progress=bar.update,
        )
    typer.echo(uncertain_page(found, loaded.name))
    for path in output or []:
        for written in write(found, path, loaded.name):
            typer.echo(f"written: {written}")
    if plot is not None:
        from flexarm.plotting.uncertainty import plot_uncertain

        typer.echo(f"written: {plot_uncertain(found, plot, loaded.name)}")


def uncertain_page(found: UncertainModel, name: str) -> str:
    """Parameters with their intervals, the family's poles, weights, and how many bins each bound holds."""
    import math

    from diagnosis.estimation.least_squares import interval_in_words
    from flexarm.console.text import columns, family_page, number

    parts = [family_page(found.family, name)]
    rows = [
        [i.name, number(i.value), interval_in_words(i.numbers(), 5), i.unit.strip("*")]
        for i in found.fit.intervals()
        if i.name in found.names  # starting values of recordings are no parameters of the model
    ]
    parts.append(columns(["parameter", "fitted", "95 % interval", "unit"], rows))
    if not found.bands:
        parts.append("  no recording is held out, so that nothing says how far the models are off (--hold-out)")
    else:
        cells = [
            [
                b.recording,
                f"{b.part[0]:.0%} ... {b.part[1]:.0%}",
                b.signal,
                str(len(b.frequency)),
                f"{b.coverage:.1%}",
                f"{b.coverage_excited:.1%}",
            ]
            for b in found.bands
        ]
        parts.append(columns(["held out", "part", "signal", "bins", "within the bound", "where excited"], cells))
    for signal, weight in found.weights.items():
        corner = f", from {number(min((*weight.zeros, math.inf)))} rad/s on" if weight.zeros else ""
        parts.append(f"  unexplained of {signal}: {weight.gain:.2%} at rest{corner}, order {len(weight.poles)}")
    return "\n".join(parts)
