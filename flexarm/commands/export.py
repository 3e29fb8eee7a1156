"""``flexarm export SCENARIO``: write an FMU or an SSP."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    file_name,
    load,
    names,
    pairs,
    say_bypassed,
)

if TYPE_CHECKING:
    from engine.model import Model
    from flexarm.cut import Cut


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
    variable_step: Annotated[
        float | None,
        typer.Option(
            "--variable-step",
            metavar="TOLERANCE",
            help="A variable step inside Co-Simulation, such as 1e-6; else fixed.",
        ),
    ] = None,
    results: Annotated[
        list[str] | None,
        typer.Option(
            "--results",
            metavar="NAMES",
            help="Further signals that importers may record: names or patterns, as link.*.",
        ),
    ] = None,
    arrays: Annotated[
        bool,
        typer.Option("--arrays", help="FMI 3: numbered states and parameters, as link.mode1.position, are arrays."),
    ] = False,
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
    from flexarm.api import ExportOptions
    from flexarm.api import export as write_fmu
    from flexarm.cut import cut
    from fmu.package import linear_beside

    if output is not None:
        check_suffix(output, (".ssp",) if split else (".fmu",))
    if bare and not split:
        raise ParameterError("only an SSP can be without connectors", Where("--bare"), "add --split NAME=BLOCKS")
    loaded = load(scenario, overrides)
    path = output if output is not None else Path(f"{file_name(loaded)}{'.ssp' if split else '.fmu'}")
    made = cut(loaded, "export", analysis, inputs=names(inputs), outputs=names(outputs))
    say_bypassed(made.bypassed, ", ".join(made.settings.inputs))
    if split:
        further = linear_twin or variable_step is not None or bool(results) or arrays or bool(mode) or bool(at)
        _refuse_with_split(further, backend)
        _split(made, path, split, names(platforms), {"version": fmi, "bare": bare})
        return
    options = ExportOptions(
        platforms=names(platforms),
        version=fmi,
        linear_twin=linear_twin,
        backend=backend,
        modes=pairs(mode, "--mode"),
        at=pairs(at, "--at"),
        variable_step=variable_step,
        results=names(results) or (),
        arrays=arrays,
    )
    write_fmu(made, path, options=options)
    model: Model = made.model
    typer.echo(f"inputs: {', '.join(f'{v.name} [{v.unit}]' for v in model.inputs) or 'none'}")
    typer.echo(f"outputs: {', '.join(f'{v.name} [{v.unit}]' for v in model.outputs)}")
    for written in (path, *(path.with_name(name) for name in linear_beside(path.stem))):
        if written == path or (backend == "c" and model.inputs and model.states and written.exists()):
            typer.echo(f"written: {written}")


def _refuse_with_split(further: bool, backend: str) -> None:
    if further or backend != "c":
        raise ParameterError(
            "an SSP holds FMUs of compiled C with a fixed step, outputs alone, no arrays and no linear model",
            Where("--split"),
            "leave out --linear-twin, --variable-step, --results, --arrays, --backend, --mode and --at",
        )


def _split(made: Cut, path: Path, groups: list[str], platforms: list[str] | None, settings: dict[str, Any]) -> None:
    from flexarm.splitting.split import split

    if platforms is not None:
        settings |= {"platforms": tuple(platforms)}
    if made.simulation is not None:
        settings |= {"step": made.simulation.step, "stop": made.simulation.stop}
    wanted = {}
    for text in groups:
        name, _, blocks = text.partition("=")
        if name.strip() in wanted:
            raise ParameterError(
                f"two FMUs are called '{name.strip()}'",
                Where(f"--split {text}"),
                "name all its blocks at once: NAME=A,B",
            )
        wanted[name.strip()] = names([blocks or name]) or []
    split(made, path, wanted, **settings)
    typer.echo(f"written: {path}")
