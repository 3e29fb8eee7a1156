"""``flexarm linearise SCENARIO``: the linear model and its files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexarm.console.options import (
    AUTOMATIC,
    AnalysisOption,
    AtOption,
    InputsOption,
    ModeOption,
    OutputsOption,
    ScenarioArgument,
    SetOption,
    file_name,
    load,
    names,
    pairs,
    say_bypassed,
)


def linearise(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    mode: ModeOption = None,
    at: AtOption = None,
    output: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write .json, .npz, .mat or .m; repeatable."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", metavar="[PNG]", help="Draw Bode, poles and zeros, Nichols; NAME-linear.png without a file name."
        ),
    ] = None,
) -> None:
    """Print and write the linear model at an operating point; with sampled blocks also that in discrete time."""
    from engine.files import check_suffix
    from flexarm.api import discretise
    from flexarm.api import linearise as linear_model
    from flexarm.console.text import discrete_page, linear_page
    from flexarm.cut import cut
    from flexarm.output import LINEAR, write_linear
    from flexarm.plotting.results import FIGURES

    for path in output or []:
        check_suffix(path, LINEAR)
    loaded = load(scenario, overrides)
    if plot is not None:
        plot = Path(f"{file_name(loaded)}-linear.png") if str(plot) == AUTOMATIC else plot
        check_suffix(plot, FIGURES)
    made = cut(loaded, "linearise", analysis, inputs=names(inputs), outputs=names(outputs))
    settings = {"modes": pairs(mode, "--mode"), "at": pairs(at, "--at")}
    linear = linear_model(made, **settings, discrete=False)  # type: ignore[arg-type]
    discrete = discretise(made, **settings) if made.model.clocks else None  # type: ignore[arg-type]
    typer.echo(f"{loaded.name}, linearised")
    say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
    typer.echo(linear_page(linear))
    if discrete is not None:
        typer.echo(discrete_page(discrete))
    for path in output or []:
        write_linear(path, linear, loaded.name, discrete)
        typer.echo(f"written: {path}")
    if plot is not None:
        from flexarm.plotting.frequency import plot_linear

        typer.echo(f"written: {plot_linear(linear, plot, f'{loaded.name}, linearised')}")
