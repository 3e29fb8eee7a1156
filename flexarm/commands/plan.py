"""``flexarm plan SCENARIO [RECORDING...]``: what a planned experiment could tell, before it is done."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.files import json_text
from flexarm.console.interrupt import INTERRUPTED
from flexarm.console.options import RecordingsArgument, ScenarioArgument, SetOption, WorkersOption

if TYPE_CHECKING:
    from diagnosis.planning.plan import Plan, Row


def plan(
    scenario: ScenarioArgument,
    recordings: RecordingsArgument = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(
            "--measure",
            "-m",
            metavar="SIGNAL[=NOISE]",
            help="A signal that is measured in the scenario's own run, and the standard deviation of its noise, such "
            "as motor.shaft.angle=0.1deg; repeatable.",
        ),
    ] = None,
    multiples: Annotated[
        list[float] | None,
        typer.Option(
            "--at", metavar="N", help="Tell effects apart at N times the smallest size that shows; repeatable: 3, 10."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for report.html, plan.json and plan.png."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="EFFECT", help="An effect that is looked at, in place of all; repeatable."),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="EFFECT", help="An effect that is not looked at; repeatable."),
    ] = None,
    overrides: SetOption = None,
    workers: WorkersOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the plan as JSON alone.")] = False,
) -> None:
    """Say before an experiment which missing effects it would show and tell apart, and what would improve it."""
    from diagnosis.api import plan as run
    from diagnosis.planning.plan import MULTIPLES
    from flexarm.console.interrupt import heard
    from flexarm.console.progress import Progress

    wanted = None
    if measure:
        wanted = {}
        for text in measure:
            name, _, noise = text.partition("=")
            wanted[name.strip()] = noise.strip()
    try:
        with heard() as check, Progress(Path(scenario).stem) as bar:

            def progress(what: str, done: int, total: int) -> None:
                check()
                bar.update(done / max(total, 1), what)

            found = run(
                scenario,
                recordings or (),
                measure=wanted,
                overrides=overrides or (),
                only=only or (),
                without=without or (),
                multiples=tuple(sorted(multiples)) if multiples else MULTIPLES,
                workers=workers,
                progress=progress,
            )
        if output is not None:
            from diagnosis.planning.write import write
            from flexarm.report import write_plan
            from flexarm.report.origin import command_line

            write(found, output)
            write_plan(found, output / "report.html", command=command_line())
    except KeyboardInterrupt:
        typer.echo("interrupted; nothing was written", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if as_json:
        typer.echo(json_text(found.numbers(), indent=2))
        return
    typer.echo(page(found))
    if output is not None:
        typer.echo(f"\nwritten: {', '.join(str(p) for p in sorted(output.iterdir()))}")


def page(found: Plan) -> str:
    """The plan in a table and sentences."""
    from diagnosis.planning.wording import apart_sentences, cannot_tell, input_sentence, sensor_sentence, size_in_words
    from flexarm.console.text import columns, number

    first = found.multiples[0]
    shown = found.shown
    parts = [f"{found.scenario.name}: what this experiment could tell"]
    for sensor in found.planned.sensors:
        parts.append(f"  {sensor.label}: noise {number(sensor.sigma)} {sensor.unit}, {sensor.noise}")
    parts += [f"  assumed: {text}" for text in found.planned.assumed]

    def line(row: Row) -> list[str]:
        return [str(row.number), row.effect, row.shape, row.place, size_in_words(row), cannot_tell(row, found)]

    heads = ["no.", "effect", "", "place", "smallest that shows", f"at {first:g} times that, not told from"]
    parts.append(columns(heads, [line(row) for row in shown]))
    if len(found.multiples) > 1:
        parts.append(f"  (* nor at {found.multiples[-1]:g} times)")
    hidden = [row for row in found.rows if not row.shows]
    if hidden:
        parts.append(
            "  would not show at any size tried: the model's own parameters do the same, or the input does not reach it"
        )
        parts += [f"    {row.number} {row.label}" for row in hidden]
    parts += [f"  {text}" for text in (*apart_sentences(found), input_sentence(found), sensor_sentence(found))]
    if found.failures:
        kinds = {why: [name for name, other in found.failures if other == why] for _, why in found.failures}
        parts += [f"  not tried: {', '.join(names)}: {why}" for why, names in kinds.items()]
    return "\n".join(parts)
