"""``flexarm close SCENARIO CONTROLLER``: a controller put back into a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexarm.console.options import ScenarioArgument, SetOption, load, names, seconds


def close(
    scenario: ScenarioArgument,
    controller: Annotated[Path, typer.Argument(metavar="CONTROLLER", help="A .json or .mat file with A, B, C and D.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE", help="The scenario to write, .yaml; it may be SCENARIO itself."),
    ],
    feed: Annotated[str, typer.Option(metavar="INPUT", help="The input that the controller drives.")],
    measure: Annotated[
        list[str], typer.Option(metavar="SIGNAL", help="A signal that it measures; repeatable, or with commas.")
    ],
    reference: Annotated[
        str | None, typer.Option(metavar="SIGNAL", help="What the first measured signal is to follow; zero by default.")
    ] = None,
    period: Annotated[str | None, typer.Option(metavar="TIME", help="Sample period; continuous without one.")] = None,
    method: Annotated[str, typer.Option(help="Of sampling: tustin, zoh, foh, impulse, matched, euler.")] = "tustin",
    delay: Annotated[int, typer.Option(min=0, help="Of the computation, in whole periods.")] = 0,
    name: Annotated[str, typer.Option(help="Of the new block.")] = "controller",
    overrides: SetOption = None,
) -> None:
    """Put a linear controller u = K (r - y) into a scenario as a block, in place of what fed an input."""
    from engine.files import check_suffix
    from flexarm.design.closing import close as run

    check_suffix(output, (".yaml", ".yml"))
    loaded = load(scenario, overrides)
    made = run(
        loaded,
        controller,
        output,
        feed=feed,
        measure=names(measure) or [],
        reference=reference,
        period=seconds(period, "--period") or 0.0,
        method=method,
        delay=delay,
        name=name,
    )
    kind = type(made.system.blocks[name]).__name__
    typer.echo(f"{loaded.name} with {kind} '{name}', which drives {feed}")
    typer.echo(f"written: {output}")
