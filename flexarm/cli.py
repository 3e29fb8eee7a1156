"""The command ``flexarm``. Heavy imports happen inside the commands, so that help comes at once.

Exit code 0: done. 1: a problem with what the user gave, explained on stderr. 2: wrong usage.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from engine.errors import FlexarmError
from flexarm import (
    completion,
    damping_command,
    diagnose_command,
    diagram_command,
    fmu_commands,
    linear_command,
    sweep_command,
)
from flexarm.options import AUTOMATIC, ScenarioArgument, SetOption, file_name, load, say_bypassed, seconds

if TYPE_CHECKING:
    from engine.system import System

app = typer.Typer(
    name="flexarm",
    help="Flexible-link robot arms and servo drives: simulate, linearise, export, compare, diagnose.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        import flexarm

        typer.echo(f"flexarm {flexarm.version()}")
        raise typer.Exit


@app.callback()
def _all(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
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
    from flexarm.output import TABLES, write_result
    from flexarm.plot import FIGURES
    from flexarm.plot import plot as draw
    from flexarm.text import columns, number, plural

    if output is not None:
        check_suffix(output, TABLES)
    loaded = load(scenario, overrides)
    if report is not None:
        check_suffix(report, (".html", ".htm"))
    if plot is not None and str(plot) == AUTOMATIC:
        plot = Path(f"{file_name(loaded)}.png")
    if plot is not None:
        check_suffix(plot, FIGURES)
    begun = time.perf_counter()
    result = simulate(loaded, seconds(stop, "--stop"), seconds(step, "--step"), record_states=may_be_conservative)
    spent = time.perf_counter() - begun
    typer.echo(f"{loaded.name}: {loaded.description}" if loaded.description else loaded.name)
    typer.echo(
        f"{number(result.time[-1])} s in {len(result.time)} rows, {result.steps} steps of at most "
        f"{number(result.internal_step)} s, {plural(result.event_count, 'switch')}, {spent:.2f} s of work"
    )
    if (energy := conserved(result, lambda: loaded.build(energy=True))) is not None:
        typer.echo(
            f"energy: {number(energy.start)} J at the start, {number(energy.end)} J at the end, at most "
            f"{energy.drift:.2g} J off on the way; nothing is supplied or dissipated"
        )
    rows = [
        [name, unit, number(values[-1]), number(values.min()), number(values.max())]
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


def _loose(system: System) -> list[str]:
    """Flanges that nothing is connected to: free ends, or a connection that was forgotten."""
    wired = {end for connection in system.connections for end in connection.ends}
    ends = (
        (f"{name}.{port}", made.role) for name, block in system.blocks.items() for port, made in block.ports.items()
    )
    return [end for end, role in ends if role == "flange" and end not in wired]


@app.command()
def check(scenario: ScenarioArgument, overrides: SetOption = None) -> None:
    """Read and assemble a scenario with its analyses and recordings, and report problems."""
    from diagnosis.compare import verify
    from diagnosis.location import VARIABLE, at_hand
    from diagnosis.recording import FrequencyTable, from_scenario
    from flexarm.api import cut
    from flexarm.api import linearise as linear_model
    from flexarm.text import columns, plural

    loaded = load(scenario, overrides)
    model = loaded.build()
    typer.echo(f"{loaded.name}: {loaded.description}" if loaded.description else loaded.name)
    typer.echo(
        ", ".join(
            plural(count, word)
            for count, word in (
                (len(loaded.system.blocks), "block"),
                (len(loaded.system.connections), "connection"),
                (len(model.states), "state"),
                (len(model.memories), "memory"),
                (len(model.modes), "mode"),
                (len(model.parameters), "parameter"),
            )
        )
    )
    typer.echo(columns(["state", "unit"], [[state.name, state.unit] for state in model.states]))
    if loose := _loose(loaded.system):
        typer.echo(f"connected to nothing: {', '.join(loose)}")
    for name, analysis in loaded.analyses.items():
        made = cut(loaded, analysis.kind, name)
        if analysis.kind == "linearise":
            linear_model(made)
        say_bypassed(made.bypassed, f"analysis {name}")
    for name in loaded.recordings:
        if not at_hand(loaded, name):
            typer.echo(f"recording {name}: not read, since the environment variable {VARIABLE} is not set")
            continue
        recording = from_scenario(loaded, name)
        verify(loaded, recording)
        rows = len(recording.frequency) if isinstance(recording, FrequencyTable) else len(recording.time)
        typer.echo(f"recording {name}: {plural(rows, 'row')} of {recording.file}")
        for note in recording.notes:
            typer.echo(f"  {note}")
        if not isinstance(recording, FrequencyTable) and not recording.drive:
            typer.echo("  no input was recorded; the scenario's own sources drive the simulation")
    typer.echo("no problems found")


@app.command()
def blocks(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A block.", autocompletion=completion.blocks)
    ] = None,
) -> None:
    """List the blocks, or show one: its law, parameters and connectors."""
    from blocks.registry import find, registry
    from flexarm.text import block_page, columns

    if name is not None:
        alike = [key for key in sorted(registry()) if name.lower() in key.lower()]
        if alike and name not in alike:
            raise FlexarmError(f"there is no block type '{name}'", remedy=f"with it in the name: {', '.join(alike)}")
        typer.echo(block_page(name, find(name)))
        return
    typer.echo(columns(["block", "what it is"], [[key, cls.summary()] for key, cls in sorted(registry().items())]))


@app.command()
def schema(
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write it to a file.")] = None,
) -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from engine.files import writing
    from scenarios.jsonschema import json_schema

    text = json.dumps(json_schema(), indent=2)
    if output is None:
        typer.echo(text)
        return
    with writing(output, (".json",)) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    typer.echo(f"written: {output}")


@app.command()
def compare(
    scenario: ScenarioArgument,
    recordings: Annotated[
        list[str] | None,
        typer.Argument(metavar="[RECORDING...]", help="Recordings of the scenario, by name, or files; all by default."),
    ] = None,
    overrides: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
    rows: Annotated[bool, typer.Option("--rows", help="Also print every row of a frequency-response table.")] = False,
) -> None:
    """Simulate with a recording's own input and print the error of every signal."""
    from diagnosis.compare import find_recording
    from flexarm.api import compare as compare_one
    from flexarm.progress import Progress
    from flexarm.text import comparison_page

    loaded = load(scenario, overrides)
    if not recordings and not loaded.recordings:
        raise FlexarmError(
            f"{loaded.name} describes no recordings", remedy="name a file, or add a section 'recordings:'"
        )
    found = [find_recording(loaded, given) for given in recordings or loaded.recordings]
    done: list[dict[str, Any]] = []
    for recording in found:
        with Progress(f"{loaded.name} against {recording.name}") as progress:
            comparison = compare_one(loaded, recording, progress=progress.update)
        done.append(comparison.numbers())
        if not as_json:
            typer.echo(comparison_page(comparison, rows))
    if as_json:
        typer.echo(
            json.dumps({"scenario": loaded.name, "overrides": list(loaded.overrides), "recordings": done}, indent=2)
        )


diagnose_command.register(app)
linear_command.register(app)
diagram_command.register(app)
fmu_commands.register(app)
damping_command.register(app)
sweep_command.register(app)


_FIGURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".gif", ".tif", ".tiff", ".bmp", ".eps", ".ps", ".webp")
"""Endings of pictures, those that cannot be written included: they are refused by name."""


def _with_default_plot(arguments: list[str]) -> list[str]:
    """Let ``--plot`` stand alone: what follows is its file only if it ends like a figure."""
    made = []
    for i, argument in enumerate(arguments):
        made.append(argument)
        following = arguments[i + 1] if i + 1 < len(arguments) else ""
        if argument == "--plot" and not following.lower().endswith(_FIGURES):
            made[-1] = f"--plot={AUTOMATIC}"
    return made


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    sys.stderr.write(f"warning: {message}\n")


def main(arguments: list[str] | None = None) -> None:
    """The command line; ends the process with 0, 1 or 2."""
    warnings.showwarning = _show_warning
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        app(args=_with_default_plot(given), prog_name="flexarm")
    except FlexarmError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(1)
    except MemoryError:
        sys.stderr.write("error: the results do not fit into memory\n  record fewer signals, or use a longer step\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
