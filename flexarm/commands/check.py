"""``flexarm check SCENARIO``: read, assemble and say what does not fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.errors import FlexarmError
from flexarm.console.options import ScenarioArgument, SetOption, load, say_bypassed

if TYPE_CHECKING:
    from diagnosis.verdict.examination import Examination
    from scenarios.load import Scenario


def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    recordings: Annotated[
        bool,
        typer.Option(
            "--recordings",
            help="Hold the recordings against their clocks, each other and the model: wraps, stuck or late sensors, "
            "noise, spikes.",
        ),
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="HTML", help="With --recordings: write a page with tables and pictures."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="With --recordings: print JSON alone.")] = False,
) -> None:
    """Read and assemble a scenario with its analyses and recordings, and report problems."""
    loaded = load(scenario, overrides)
    if recordings:
        _recordings(loaded, report, as_json)
        return
    if report is not None or as_json:
        option = "--report" if report is not None else "--json"
        raise FlexarmError(f"{option} is about recordings", remedy=f"write --recordings {option} ...")
    _assembly(loaded)


def _recordings(loaded: Scenario, report: Path | None, as_json: bool) -> None:
    """Examine all recordings; what is odd is told, and is no error."""
    from diagnosis.recordings.mapping import from_scenario
    from diagnosis.verdict.examination import examine
    from engine.files import check_suffix, json_text
    from flexarm.console.progress import Progress
    from flexarm.report.origin import command_line
    from flexarm.report.page import HTML
    from flexarm.report.recordings_page import write_recordings

    if report is not None:
        check_suffix(report, HTML)
    if not loaded.recordings:
        raise FlexarmError(f"{loaded.name} describes no recordings", remedy="add a section 'recordings:'")
    with Progress(f"recordings of {loaded.name}") as progress:
        found = examine(loaded, [from_scenario(loaded, name) for name in loaded.recordings], progress.update)
    if report is not None:
        write_recordings(loaded, found, report, command=command_line())
    if as_json:
        typer.echo(json_text({"scenario": loaded.name, **found.numbers()}, indent=2))
        return
    typer.echo(_page(found))
    if report is not None:
        typer.echo(f"written: {report}")


def _page(found: Examination) -> str:
    """Examined recordings as text."""
    from flexarm.console.text import columns, number, plural

    parts = []
    for one in found.recordings:
        clock = one.clock
        parts.append(
            f"{one.recording.name}: {plural(len(one.recording.time), 'sample')} in {one.recording.time[-1]:.5g} s, "
            f"every {1e3 * clock.interval:.5g} ms"
        )
        rows = []
        for row in one.signals:
            sigma = row.stated if row.stated is not None else row.noise.sigma
            source = "as stated" if row.stated is not None else row.noise.source
            delay = "" if row.delay is None else f"{1e3 * row.delay:.3g}"
            like = f"{row.correlation:.3f}" if row.correlation == row.correlation else ""
            rows.append([row.name, number(row.span), number(sigma), row.unit.strip("*"), source, like, delay])
        heads = ["signal", "range", "noise", "unit", "from", "like the model", "behind it [ms]"]
        parts.append(columns(heads, rows))
    parts += [
        f"  {one} and {other}: {signal} apart by {a:.3g} times the noise" for one, other, signal, a in found.repeats
    ]
    parts += [f"  warning: {remark.text}" for remark in found.remarks]
    parts.append(f"{plural(len(found.remarks), 'warning')}" if found.remarks else "nothing odd was found")
    return "\n".join(parts)


def _assembly(loaded: Scenario) -> None:
    from diagnosis.binding import verify
    from diagnosis.recordings.mapping import from_scenario
    from diagnosis.recordings.paths import VARIABLE, is_available
    from diagnosis.recordings.types import FrequencyTable
    from flexarm.api import linearise as linear_model
    from flexarm.console.text import columns, plural
    from flexarm.cut import cut
    from flexarm.design.families import verify as verify_analysis

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
    loaded.tolerances_of(model)
    if loose := loaded.system.loose():
        typer.echo(f"connected to nothing: {', '.join(loose)}; is a connection missing?")
    for name, analysis in loaded.analyses.items():
        made = cut(loaded, analysis.kind, name)
        verify_analysis(made)
        if analysis.kind == "linearise":
            linear_model(made)
        say_bypassed(made.bypassed, f"analysis {name}")
    for name in loaded.recordings:
        if not is_available(loaded, name):
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
