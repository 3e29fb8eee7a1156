"""``flexarm linearise SCENARIO``: the linear model and its files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from engine.errors import ParameterError, Where
from flexarm.console.options import (
    AnalysisOption,
    AtOption,
    InputsOption,
    ModeOption,
    OutputsOption,
    ScenarioArgument,
    SetOption,
    TrimOption,
    load,
    names,
    pairs,
    picture,
    say_bypassed,
    seconds,
)


def linearise(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    mode: ModeOption = None,
    at: AtOption = None,
    trim: TrimOption = None,
    grid: Annotated[
        list[str] | None,
        typer.Option(
            "--grid",
            metavar="NAME=START:STOP:N",
            help="A family over a parameter, state, motion or input; repeatable, each with each.",
        ),
    ] = None,
    snapshots: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="A family along the scenario's run, at this interval and at mode changes."),
    ] = None,
    reduce: Annotated[
        int | None, typer.Option(min=0, help="Reduce to this many states, with the error bound stated.")
    ] = None,
    method: Annotated[str, typer.Option(help="Of the reduction: balanced or modal.")] = "balanced",
    every_mode: Annotated[
        bool, typer.Option("--modes", help="A family over all combinations of modes that can occur.")
    ] = False,
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
    """Print and write the linear model at an operating point, or a family of them over a grid, a run or all modes.

    With sampled blocks there is a model in discrete time beside it.
    """
    from engine.files import check_suffix
    from flexarm.api import discretise
    from flexarm.api import linearise as linear_model
    from flexarm.console.text import discrete_page, linear_head, linear_page, reduction_page
    from flexarm.cut import cut
    from flexarm.output import LINEAR, write_linear

    for path in output or []:
        check_suffix(path, LINEAR)
    loaded = load(scenario, overrides)
    plot = picture(plot, loaded, "-linear")
    made = cut(loaded, "linearise", analysis, inputs=names(inputs), outputs=names(outputs))
    options = made.settings.options
    if grid or snapshots is not None or every_mode or any(options.get(k) for k in ("grid", "snapshots", "every_mode")):
        from flexarm.api import linear_family
        from flexarm.console.text import family_page
        from flexarm.output import write_family

        if reduce is not None:
            raise ParameterError(
                "a family is not reduced: its members have one order of states",
                Where("--reduce"),
                "leave it out, or reduce one model",
            )
        family = linear_family(
            made,
            grid=pairs(grid, "--grid") if grid else None,
            snapshots=seconds(snapshots, "--snapshots"),
            every_mode=every_mode,
            modes=pairs(mode, "--mode"),
            at=pairs(at, "--at"),
            trim=trim,
        )
        typer.echo(family_page(family, loaded.name))
        say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
        for path in output or []:
            for written in write_family(path, family, loaded.name):
                typer.echo(f"written: {written}")
        if plot is not None:
            from flexarm.plotting.family import plot_family

            typer.echo(f"written: {plot_family(family, plot, f'{loaded.name}, a family of linear models')}")
        return
    settings = {"modes": pairs(mode, "--mode"), "at": pairs(at, "--at"), "trim": trim}
    linear = linear_model(made, **settings, discrete=False)  # type: ignore[arg-type]
    discrete = discretise(made, **settings) if made.model.clocks else None  # type: ignore[arg-type]
    typer.echo(linear_head(linear, loaded.name))
    say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
    typer.echo(linear_page(linear))
    if reduce is not None:
        from flexarm.design.reduction import reduce as reduced

        smaller = reduced(linear, reduce, method=method)
        typer.echo(reduction_page(smaller, linear))
        linear = smaller.model
    if discrete is not None:
        typer.echo(discrete_page(discrete))
    for path in output or []:
        write_linear(path, linear, loaded.name, discrete)
        typer.echo(f"written: {path}")
    if plot is not None:
        from flexarm.plotting.frequency import plot_linear

        typer.echo(f"written: {plot_linear(linear, plot, f'{loaded.name}, linearised')}")
