"""``flexarm diagram SCENARIO``: the wiring as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexarm.console.options import ScenarioArgument, SetOption, file_name, load


def diagram(
    scenario: ScenarioArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write .svg, .png or .pdf; NAME.svg by default."),
    ] = None,
    overrides: SetOption = None,
) -> None:
    """Draw the wiring: blocks, flanges, signals, sub-assemblies, and what is recorded where."""
    from engine.files import check_suffix
    from flexarm.plotting.wiring.diagram import PICTURES, write
    from flexarm.plotting.wiring.diagram import diagram as draw

    if output is not None:
        check_suffix(output, PICTURES)
    loaded = load(scenario, overrides)
    target = output or Path(f"{file_name(loaded)}.svg")
    typer.echo(f"written: {write(draw(loaded), target)}")
