"""``flexarm diagnose SCENARIO [RECORDING...]``: what the model leaves out."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.files import json_text
from flexarm.console.interrupt import INTERRUPTED
from flexarm.console.options import (
    HoldOutOption,
    RecordingsArgument,
    ScenarioArgument,
    SeedOption,
    SetOption,
    WorkersOption,
    names,
    seconds,
)

if TYPE_CHECKING:
    from diagnosis.verdict.verdict import Diagnosis

PROGRESS = ".progress"
"""Folder of the fits that are done, in the output folder, while a diagnosis is under way."""


def diagnose(
    scenario: ScenarioArgument,
    recordings: RecordingsArgument = None,
    hold_out: HoldOutOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder for report.html, diagnosis.json, amended.yaml and figures."
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="EFFECT", help="Effects that are not to be tried: A,B; repeatable."),
    ] = None,
    overrides: SetOption = None,
    workers: WorkersOption = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler whose workers do the fits.")
    ] = None,
    longest: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Tell what was found after about so much processor time, such as '3 min'; counted in operations, so "
            "that every machine tells the same.",
        ),
    ] = None,
    seed: SeedOption = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the verdict as JSON alone.")] = False,
) -> None:
    """Say what the model leaves out, put it in, and show the fit improve on held-out data."""
    from diagnosis.api import diagnose as run
    from diagnosis.verdict.write import write
    from flexarm.console.interrupt import heard
    from flexarm.console.progress import Progress

    keep = output / PROGRESS if output is not None else None
    try:
        with heard() as check, Progress(Path(scenario).stem) as bar:

            def progress(what: str, done: int, total: int) -> None:
                check()
                bar.update(done / max(total, 1), what)

            def warn(texts: Sequence[str]) -> None:
                # Whoever mapped a column wrongly need not wait for the search.
                for text in texts:
                    bar.note(f"warning: {text}")

            found = run(
                scenario,
                recordings or (),
                hold_out=hold_out or (),
                overrides=overrides or (),
                workers=workers,
                seed=seed,
                without=names(without) or (),
                progress=progress,
                warn=warn,
                keep=keep,
                scheduler=scheduler,
                longest=seconds(longest, "--longest"),
            )
        if output is not None:
            from flexarm.report import write_diagnosis
            from flexarm.report.origin import command_line

            write(found, output)
            write_diagnosis(found, output / "report.html", seed=seed, command=command_line())
            if not found.study.ended_early:  # else it goes on from there with more time
                shutil.rmtree(output / PROGRESS, ignore_errors=True)
    except KeyboardInterrupt:
        hint = "the same command goes on where it stopped" if keep else "with --output DIR it could be resumed"
        typer.echo(f"interrupted; {hint}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if as_json:
        typer.echo(json_text(found.numbers(), indent=2))
        return
    typer.echo(page(found))
    if output is not None:
        typer.echo(f"\nwritten: {', '.join(str(p) for p in sorted(output.iterdir()))}")


def page(found: Diagnosis) -> str:
    """The verdict in plain sentences."""
    from diagnosis.estimation.least_squares import interval_in_words
    from flexarm.console.text import columns, number, plural

    study = found.study
    parts = [f"{study.scenario.name}: {found.verdict.replace('_', ' ')}"]
    for finding in found.findings:
        parts.append(f"  {finding['sentence']}")
        heights = [name for name in finding["parameters"] if finding["effect"] == "unknown" and "[" in name]
        if heights:
            parts.append(
                f"    a curve of {plural(len(heights), 'point')}; its values are in diagnosis.json and amended.yaml"
            )
        for name, row in finding["parameters"].items():
            if name in heights:
                continue
            factor = f", {row['factor']:.3g} times the given value" if "factor" in row else ""
            unit = "" if row["unit"] in ("*", "1") else f" {row['unit']}"
            parts.append(f"    {name} = {number(row['value'])}{unit}  (95 %: {interval_in_words(row, 6)}){factor}")
        if finding["when"]:
            parts.append(f"    the mismatch: {finding['when']}; {finding['frequency']}")
    rows = [
        ["as given", number(study.nominal[0]), number(study.nominal[1])],
        ["refitted", number(study.refit.fit.chi2), number(study.refit.hold_out)],
    ]
    if study.chosen.effects:
        rows.append([f"with {study.chosen.label}", number(study.chosen.fit.chi2), number(study.chosen.hold_out)])
    parts.append(columns(["model", "error, fitted data", "error, held out"], rows))
    parts.append("  (mean squared error over noise variance; 1 is the noise floor)")
    odds = list(study.place_odds.items())[:3]
    if study.chosen.effects and odds:
        parts.append("  places: " + ", ".join(f"{place} {min(value, 0.999):.3f}" for place, value in odds))
    if found.proposal:
        parts.append(f"  next experiment: {found.proposal.sentence} ({found.proposal.kind})")
    if study.failures:
        kinds = {why: [effect for effect, other in study.failures if other == why] for _, why in study.failures}
        parts += [f"  not tried: {', '.join(effects)}: {why}" for why, effects in kinds.items()]
    parts += [f"  warning: {text}" for text in found.warnings]
    return "\n".join(parts)
