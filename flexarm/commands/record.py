"""``flexarm record FILE... --scenario S``: a draft of the recordings: section from log files."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.errors import FlexarmError, nearest
from flexarm.console import completion
from flexarm.console.options import SetOption, load, seconds

if TYPE_CHECKING:
    from diagnosis.drafting.draft import Draft
    from diagnosis.drafting.log_file import LogFile
    from diagnosis.drafting.match import Match, Matches
    from scenarios.load import Scenario


def record(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Log files of one kind of experiment.")],
    scenario: Annotated[
        str,
        typer.Option(
            "--scenario",
            "-m",
            metavar="SCENARIO",
            help="The nominal model, by which columns are told apart.",
            autocompletion=completion.scenarios,
        ),
    ],
    overrides: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the scenario with the recordings, .yaml."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; what is not sure is a comment.")] = False,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="The column that is the time.")] = None,
    interval: Annotated[
        str | None, typer.Option(metavar="TIME", help="Between samples, such as '2 ms', where no column is the time.")
    ] = None,
    form: Annotated[
        str, typer.Option("--format", metavar="FORMAT", help="Of files whose ending does not tell it, such as csv.")
    ] = "",
) -> None:
    """Draft the recordings: section of a scenario: what drives, what is measured, units, signs, windows, hold-out."""
    from diagnosis.drafting.draft import draft, inserted, text
    from diagnosis.drafting.log_file import look
    from diagnosis.drafting.match import match
    from engine.files import check_suffix, writing
    from flexarm.console.progress import Progress
    from scenarios.amend import relocated

    if output is not None:
        check_suffix(output, (".yaml", ".yml"))
    if not yes and not sys.stdin.isatty():
        raise FlexarmError("the draft is to be confirmed, and there is no terminal", remedy="write --yes")
    twice = [path for k, path in enumerate(files) if path.resolve() in {other.resolve() for other in files[:k]}]
    if twice:
        raise FlexarmError(f"the file '{twice[0]}' is given twice", remedy="name each once")
    loaded = load(scenario, overrides)
    step = seconds(interval, "--interval")
    logs = [look(path, time=time, interval=step, form=form) for path in files]
    if not yes:
        logs = _asked_time(logs)
    # The file that moves most tells most.
    strongest = max(logs, key=lambda log: (log.signals and sum(s.steps for s in log.signals)) or 0)
    with Progress(f"columns of {strongest.path.name} against {loaded.name}") as progress:
        matches = match(loaded, strongest, progress.update)
    if not yes:
        matches = _asked(loaded, strongest, matches)
    if not matches.measurements:
        raise FlexarmError(
            f"no column of '{strongest.path}' is like a signal of {loaded.name}",
            remedy=f"name columns as signals, such as 'link.hub.angle [deg]'; there are "
            f"{', '.join(s.name for s in strongest.signals[:12])}",
        )
    made = draft(loaded, logs, matches)
    folder = output.parent if output is not None else loaded.path.parent
    section = text(made, folder)
    if output is None:
        typer.echo("recordings:")
        typer.echo(section, nl=False)
    else:
        source = relocated(loaded.path.read_text(encoding="utf-8"), loaded.path.parent, folder)
        with writing(output, (".yaml", ".yml")) as temporary:
            temporary.write_text(inserted(source, section), encoding="utf-8")
    _say(made, output, logs)


def _say(made: Draft, output: Path | None, logs: list[LogFile]) -> None:
    """What was left out and what is not sure, on stderr: the section alone is on stdout."""
    from diagnosis.binding import verify
    from diagnosis.recordings.mapping import from_scenario
    from scenarios.load import load as read

    for note in dict.fromkeys(note for log in logs for note in log.notes):
        typer.echo(f"  {note}", err=True)
    for note in made.matches.notes:
        typer.echo(f"  {note}", err=True)
    if made.matches.unused:
        typer.echo(f"  not used: {', '.join(made.matches.unused)}", err=True)
    rows = (*made.matches.drive, *made.matches.measurements)
    unsure = [row.column for row in rows if row.sure == "a guess"]
    if unsure:
        typer.echo(f"  to be confirmed, since they are guesses: {', '.join(unsure)}", err=True)
    for row in rows:
        if row.elsewhere:
            ends = " or ".join((row.end, *row.elsewhere))
            typer.echo(f"  to be confirmed, since the model moves alike there: {row.column} is {ends}", err=True)
    if output is None:
        return
    typer.echo(f"written: {output}", err=True)
    again = read(str(output))
    for entry in made.entries:
        try:
            verify(again, from_scenario(again, entry.name))
        except FlexarmError as error:
            typer.echo(f"  recording {entry.name} needs a hand: {error}", err=True)
    typer.echo(f"  next: flexarm check {output} --recordings --report page.html", err=True)


def _asked_time(logs: list[LogFile]) -> list[LogFile]:
    """The files after the user has confirmed, or named, their time."""
    from diagnosis.drafting.log_file import look

    first = logs[0].time
    said = f"column '{first.column}' in {first.unit}" if first.column else "the interval"
    while True:
        answer = typer.prompt(
            f"The time is {said} ({first.evidence}). Enter: yes; or another column", default="", show_default=False
        ).strip()
        if not answer:
            return logs
        try:
            return [look(log.path, time=answer) for log in logs]
        except FlexarmError as error:
            typer.echo(f"  {error}")


def _asked(loaded: Scenario, log: LogFile, matches: Matches) -> Matches:
    """The matches after the user has confirmed or changed each."""
    from diagnosis.binding import names_of

    signals, _ = names_of(loaded)
    typer.echo("Enter: yes; '-': leave it out; or another name, and a unit, such as: motor.shaft.angle deg")
    inputs = list(loaded.system.inputs())
    drive: list[Match] = []
    measured: list[Match] = []

    def free(known: list[str]) -> list[str]:
        return [name for name in known if name not in [row.end for row in (*drive, *measured)]]

    for row in matches.drive:
        drive += _one(row, "drives", free(inputs))
    for row in matches.measurements:
        measured += _one(row, "is", free(list(signals)))
    for column in matches.unused:
        for row in _further(column, log.signal(column).unit, free([*inputs, *signals])):
            (drive if row.end in inputs else measured).append(row)
    return replace(matches, drive=tuple(drive), measurements=tuple(measured))


def _further(column: str, unit: str, known: list[str]) -> list[Match]:
    """What a column is that was not matched, as the user says; empty if it is left out."""
    from diagnosis.drafting.match import Match

    while True:
        answer = typer.prompt(f"'{column}' is not used. Enter: leave it out", default="", show_default=False).strip()
        name, _, stated = answer.partition(" ")
        if not answer or answer == "-":
            return []
        if name in known:
            stated = stated.strip() or unit or "1"
            return [Match(column, name, stated, 1, "", 0.0, float("nan"), float("nan"), 0.0, 0, "as given")]
        typer.echo(f"  no '{name}' is free: {nearest(name, known)}")


def _one(row: Match, verb: str, known: list[str]) -> list[Match]:
    sign = ", sign -1" if row.sign < 0 else ""
    counts = f", {row.counts_per_rev:g} in a revolution" if row.counts_per_rev else ""
    scale = f", {row.scale} each" if row.scale else ""
    while True:
        answer = typer.prompt(
            f"'{row.column}' {verb} {row.end} in {row.unit}{counts}{scale}{sign} ({row.evidence})",
            default="",
            show_default=False,
        ).strip()
        if not answer and row.end in known:
            return [row]
        if answer == "-":
            return []
        name, _, unit = answer.partition(" ")
        if name in known:
            scale = "" if unit else row.scale
            return [replace(row, end=name, unit=unit.strip() or row.unit, scale=scale, sure="as given")]
        typer.echo(f"  no '{name or row.end}' is free: {nearest(name or row.end, known)}")
