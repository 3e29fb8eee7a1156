"""``flexarm cosim FMU|SSP``: co-simulate with FMPy, and compare with the scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from engine.errors import FlexarmError, ParameterError, Where
from flexarm.console.options import AnalysisOption, InputsOption, OutputsOption, SetOption, load, names, pairs, seconds


def cosim(
    file: Annotated[Path, typer.Argument(metavar="FMU|SSP", help="An FMU for Co-Simulation, or an SSP of such FMUs.")],
    scenario: Annotated[
        str | None, typer.Option("--scenario", metavar="SCENARIO", help="Compare with this scenario's own run.")
    ] = None,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    constant: Annotated[
        list[str] | None,
        typer.Option("--input", "-i", metavar="NAME=VALUE", help="Constant input, such as 'motor.voltage=2 V'."),
    ] = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="End; that of the FMU by default.")] = None,
    step: Annotated[str | None, typer.Option(metavar="TIME", help="Communication step; the FMU's by default.")] = None,
) -> None:
    """Simulate an FMU or SSP with FMPy, and compare it with the scenario it was made from.

    Inputs are constant; an input that is not given is 1 in its SI unit, so that something moves. With --scenario, give
    the --analysis or the --inputs and --outputs with which the file was exported.
    """
    from flexarm.console.text import columns, number
    from flexarm.cosim import run

    if file.suffix.lower() not in (".fmu", ".ssp"):
        raise FlexarmError(f"'{file}' is neither FMU nor SSP", remedy="its name ends in .fmu or .ssp")
    loaded = load(scenario, overrides) if scenario is not None else None
    for option, given in (
        ("--set", overrides),
        ("--analysis", analysis),
        ("--inputs", inputs),
        ("--outputs", outputs),
    ):
        if loaded is None and given:
            raise ParameterError(f"{option} is of a scenario, and none is given", Where(option), "add --scenario NAME")
    found = run(
        file,
        loaded,
        analysis,
        pairs(constant, "--input"),
        seconds(stop, "--stop"),
        seconds(step, "--step"),
        made_with=(names(inputs), names(outputs)),
    )
    typer.echo(f"{file.name}: {number(found.trace.time[-1])} s in steps of {number(found.step)} s")
    for name, value in found.inputs.items():
        typer.echo(f"input {name} = {number(value)} {found.units.get(name, '')}".rstrip())
    heads = ["output", "end", "least", "greatest"]
    rows = [
        [name, number(values[-1]), number(values.min()), number(values.max())]
        for name, values in ((name, found.trace[name]) for name in found.trace.names)
    ]
    if found.differences is not None:
        heads.append("largest difference from the scenario")
        rows = [[*row, number(found.differences[row[0]]) if row[0] in found.differences else "-"] for row in rows]
    typer.echo(columns(heads, rows))
    if found.differences is not None:
        largest = max(found.differences.values(), default=0.0)
        typer.echo(f"largest difference: {largest:.3g}")
