"""``flexarm export`` and ``flexarm cosim``. Heavy imports happen inside the commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.errors import FlexarmError, ParameterError, Where
from flexarm.options import (
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
    seconds,
)

if TYPE_CHECKING:
    from engine.model import Model
    from flexarm.api import Cut


def register(app: typer.Typer) -> None:
    """Add the commands to a command line."""
    app.command()(export)
    app.command()(cosim)


def export(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    inputs: InputsOption = None,
    outputs: OutputsOption = None,
    mode: ModeOption = None,
    at: AtOption = None,
    fmi: Annotated[int, typer.Option("--fmi", metavar="2|3", help="Version of FMI.")] = 2,
    platforms: Annotated[
        list[str] | None,
        typer.Option(
            "--platforms",
            "--platform",
            metavar="NAMES",
            help="linux64,win64 (default), darwin64, darwin-aarch64, aarch64.",
        ),
    ] = None,
    linear_twin: Annotated[
        bool, typer.Option("--linear-twin", help="Also run the linear model, as outputs NAME_lin.")
    ] = False,
    backend: Annotated[
        str, typer.Option(metavar="c|python", help="python for scenarios with Python functions; needs Python there.")
    ] = "c",
    split: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=BLOCKS", help="An FMU of these blocks or sub-assemblies (commas), the rest another; an SSP."
        ),
    ] = None,
    bare: Annotated[
        bool, typer.Option("--bare", help="With --split: no connectors of the SSP itself, for libcosim and Ecos.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="The file; NAME.fmu or NAME.ssp by default.")
    ] = None,
) -> None:
    """Write the model as an FMU, and its linear model beside it as NAME_linear.mat and NAME_linear.m."""
    from engine.files import check_suffix
    from flexarm.api import cut
    from flexarm.api import export as write_fmu

    if output is not None:
        check_suffix(output, (".ssp",) if split else (".fmu",))
    if bare and not split:
        raise ParameterError("only an SSP can be without connectors", Where("--bare"), "add --split NAME=BLOCKS")
    loaded = load(scenario, overrides)
    path = output if output is not None else Path(f"{file_name(loaded)}{'.ssp' if split else '.fmu'}")
    made = cut(loaded, "export", analysis, inputs=names(inputs), outputs=names(outputs))
    say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
    if split:
        _refuse_with_split(linear_twin, backend)
        _split(made, path, split, names(platforms), {"version": fmi, "bare": bare})
        return
    write_fmu(
        made,
        path,
        platforms=names(platforms),
        version=fmi,
        linear_twin=linear_twin,
        backend=backend,
        modes=pairs(mode, "--mode"),
        at=pairs(at, "--at"),
    )
    model: Model = made.model
    typer.echo(f"inputs: {', '.join(f'{v.name} [{v.unit}]' for v in model.inputs) or 'none'}")
    typer.echo(f"outputs: {', '.join(f'{v.name} [{v.unit}]' for v in model.outputs)}")
    for written in (path, *(path.with_name(f"{path.stem}_linear{end}") for end in (".mat", ".m"))):
        if written == path or (backend == "c" and model.inputs and model.states and written.exists()):
            typer.echo(f"written: {written}")


def _refuse_with_split(linear_twin: bool, backend: str) -> None:
    if linear_twin or backend != "c":
        raise ParameterError(
            "an SSP holds FMUs of compiled C without a linear twin",
            Where("--split"),
            "leave out --linear-twin and --backend",
        )


def _split(made: Cut, path: Path, groups: list[str], platforms: list[str] | None, settings: dict[str, Any]) -> None:
    from flexarm.split import split

    if platforms is not None:
        settings |= {"platforms": tuple(platforms)}
    if made.simulation is not None:
        settings |= {"step": made.simulation.step, "stop": made.simulation.stop}
    wanted = {}
    for text in groups:
        name, _, blocks = text.partition("=")
        wanted[name.strip()] = names([blocks or name]) or []
    split(made, path, wanted, **settings)
    typer.echo(f"written: {path}")


def cosim(
    file: Annotated[Path, typer.Argument(metavar="FMU|SSP", help="An FMU for Co-Simulation, or an SSP of such FMUs.")],
    scenario: Annotated[
        str | None, typer.Option("--scenario", metavar="SCENARIO", help="Compare with this scenario's own run.")
    ] = None,
    overrides: SetOption = None,
    analysis: AnalysisOption = None,
    constant: Annotated[
        list[str] | None,
        typer.Option("--input", "-i", metavar="NAME=VALUE", help="Constant input, such as 'motor.voltage=2 V'."),
    ] = None,
    stop: Annotated[str | None, typer.Option(metavar="TIME", help="End; that of the FMU by default.")] = None,
    step: Annotated[str | None, typer.Option(metavar="TIME", help="Communication step; the FMU's by default.")] = None,
) -> None:
    """Simulate an FMU or SSP with FMPy, and compare it with the scenario it was made from.

    Inputs are constant; an input that is not given is 1 in its SI unit, so that something moves.
    """
    from flexarm.cosim import run
    from flexarm.text import columns, number

    if file.suffix.lower() not in (".fmu", ".ssp"):
        raise FlexarmError(f"'{file}' is neither FMU nor SSP", remedy="its name ends in .fmu or .ssp")
    loaded = load(scenario, overrides) if scenario is not None else None
    if loaded is None and overrides:
        raise ParameterError("--set changes a scenario, and none is given", Where("--set"), "add --scenario NAME")
    found = run(file, loaded, analysis, pairs(constant, "--input"), seconds(stop, "--stop"), seconds(step, "--step"))
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
