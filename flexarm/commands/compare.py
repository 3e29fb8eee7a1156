"""``flexarm compare SCENARIO [RECORDING...]``: errors against recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.errors import FlexarmError
from engine.files import check_suffix, json_text
from flexarm.console.options import ScenarioArgument, SetOption, load

if TYPE_CHECKING:
    from diagnosis.compare import Comparison
    from diagnosis.recordings.types import Recorded


def compare(
    scenario: ScenarioArgument,
    recordings: Annotated[
        list[str] | None,
        typer.Argument(metavar="[RECORDING...]", help="Recordings of the scenario, by name, or files; all by default."),
    ] = None,
    overrides: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="HTML", help="Write a page with errors and pictures.")
    ] = None,
    rows: Annotated[bool, typer.Option("--rows", help="Also print every row of a frequency-response table.")] = False,
) -> None:
    """Simulate with a recording's own input and print the error of every signal.

    What 'flexarm diagnose' would warn of is told first.
    """
    from diagnosis.binding import find_recording
    from diagnosis.recordings.checks import check_moving
    from diagnosis.verdict.examination import warnings_about
    from flexarm.api import compare as compare_one
    from flexarm.console.progress import Progress
    from flexarm.console.text import comparison_page
    from flexarm.report.page import HTML

    if report is not None:
        check_suffix(report, HTML)
    made: list[tuple[Recorded, Comparison]] = []
    loaded = load(scenario, overrides)
    if not recordings and not loaded.recordings:
        raise FlexarmError(
            f"{loaded.name} describes no recordings", remedy="name a file, or add a section 'recordings:'"
        )
    found = [find_recording(loaded, given) for given in recordings or loaded.recordings]
    check_moving(found)
    warnings = warnings_about(loaded, found)
    if not as_json:
        for text in warnings:
            typer.echo(f"warning: {text}")
    done: list[dict[str, Any]] = []
    for recording in found:
        with Progress(f"{loaded.name} against {recording.name}") as progress:
            comparison = compare_one(loaded, recording, progress=progress.update)
        made.append((recording, comparison))
        done.append(comparison.numbers())
        if not as_json:
            typer.echo(comparison_page(comparison, rows))
    if report is not None:
        from flexarm.report import write_comparisons
        from flexarm.report.origin import command_line

        write_comparisons(loaded, made, report, command=command_line())
        if not as_json:
            typer.echo(f"written: {report}")
    if as_json:
        typer.echo(
            json_text(
                {
                    "scenario": loaded.name,
                    "overrides": list(loaded.overrides),
                    "warnings": warnings,
                    "recordings": done,
                },
                indent=2,
            )
        )
