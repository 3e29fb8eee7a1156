"""``flexarm fit SCENARIO [RECORDING...]``: fit parameters to recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.files import json_text
from flexarm.console.options import (
    HoldOutOption,
    RecordingsArgument,
    ScenarioArgument,
    SeedOption,
    SetOption,
    WorkersOption,
)

if TYPE_CHECKING:
    from diagnosis.estimation.least_squares import Fit, Interval


def fit(
    scenario: ScenarioArgument,
    recordings: RecordingsArgument = None,
    hold_out: HoldOutOption = None,
    overrides: SetOption = None,
    workers: WorkersOption = None,
    seed: SeedOption = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FITTED.yaml", help="Write the scenario with the fitted values."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="HTML", help="Write a page with values, intervals and pictures.")
    ] = None,
) -> None:
    """Fit the parameters, within their tolerances, to recordings."""
    from diagnosis.api import fit as run
    from engine.files import check_suffix
    from flexarm.console.progress import Progress
    from flexarm.report.page import HTML

    if output is not None:
        check_suffix(output, (".yaml", ".yml"))
    if report is not None:
        check_suffix(report, HTML)
    with Progress(f"{Path(scenario).stem}: fit") as bar:
        made, scores = run(
            scenario,
            recordings or (),
            hold_out=hold_out or (),
            overrides=overrides or (),
            workers=workers,
            seed=seed,
            progress=bar.update,
        )
    if output is not None:
        from scenarios.load import find

        _write(output, made, Path(find(scenario)), overrides or ())
    if report is not None:
        from diagnosis.binding import find_recording
        from flexarm.report import write_fit
        from flexarm.report.origin import command_line

        source = made.problem.scenario
        used = [find_recording(source, name).file for name in (*(recordings or source.recordings), *(hold_out or ()))]
        write_fit(made, scores, report, files=used, seed=seed, command=command_line())
    if as_json:
        typer.echo(json_text(_fit_numbers(made, scores), indent=2))
        return
    typer.echo(fit_page(made, scores))
    for path in (output, report):
        if path is not None:
            typer.echo(f"written: {path}")


def _write(path: Path, made: Fit, source: Path, overrides: Sequence[str]) -> None:
    """The scenario with the fitted values in their places, and what is known of them as a comment on top."""
    from diagnosis.estimation.least_squares import interval_in_words
    from engine.files import writing
    from scenarios.amend import relocated, with_overrides, with_readings, with_values

    known = {p.name: p.unit for p in made.problem.model.parameters}
    rows = [i for i in made.intervals() if i.name in known]
    values: dict[str, str | float] = {
        i.name: f"{i.value:.8g} {known[i.name]}" if known[i.name] not in ("1", "*") else float(f"{i.value:.8g}")
        for i in rows
    }
    head = [f"{source.name}, fitted{' with ' + ' '.join(overrides) if overrides else ''}; 95 % intervals:"]
    head += [f"  {i.name}: {interval_in_words(i.numbers(), 6)} {i.unit.strip('*1')}".rstrip() for i in rows]
    text = with_overrides(source.read_text(encoding="utf-8"), overrides)
    text = with_values(text, values, "\n".join(head))
    text = with_readings(text, made.problem.assumed)
    with writing(path, (".yaml", ".yml")) as temporary:
        temporary.write_text(relocated(text, source.parent, path.parent), encoding="utf-8")


def _fit_numbers(made: Fit, scores: dict[str, float]) -> dict[str, Any]:
    rows: dict[str, Any] = {}
    starts: dict[str, dict[str, Any]] = {}
    for name, unit, recording, i in _rows(made):
        place = starts.setdefault(recording, {}) if recording else rows
        place[name] = i.numbers() | {"start": i.start, "unit": unit}
    return {
        "parameters": rows,
        "starts": starts,
        "chi2": scores,
        "converged": made.converged,
        "not_settled": list(made.weak),
        "spread": _spread(made),
    }


def _spread(made: Fit) -> dict[str, Any]:
    """What the fit leaves uncertain, for `flexarm sweep --from-fit`: of the logarithm where that was searched.

    Parameters that the data only bound have no standard deviation, and are left out.
    """
    import numpy as np

    bounded = {i for i, *_ in made.flat}
    kept = [i for i in range(len(made.problem.free)) if i not in bounded and made.covariance[i, i] > 0]
    free = [made.problem.free[i] for i in kept]
    part = made.covariance[np.ix_(kept, kept)]
    deviation = np.sqrt(np.diag(part))
    return {
        "names": [f.name for f in free],
        "logarithmic": [f.logarithmic for f in free],
        "deviation": [float(d * abs(f.scale)) for f, d in zip(free, deviation, strict=True)],
        "correlation": (part / np.outer(deviation, deviation)).tolist(),
    }


def _rows(made: Fit) -> list[tuple[str, str, str, Interval]]:
    """Name, unit and interval of what was fitted, and the recording that a starting value belongs to."""
    from diagnosis.binding import starting_unit

    problem = made.problem
    return [
        (i.name, starting_unit(problem.scenario, problem.model, i.name) if f.recording else i.unit, f.recording, i)
        for f, i in zip(problem.free, made.intervals(), strict=True)
    ]


def fit_page(made: Fit, scores: dict[str, float]) -> str:
    """A fit as text: values, intervals, scores and what the data do not settle."""
    from diagnosis.estimation.least_squares import interval_in_words
    from flexarm.console.text import columns, number

    def table(heads: list[str], wanted: list[tuple[list[str], str, Interval]]) -> str:
        rows = [
            [*named, number(i.start), number(i.value), interval_in_words(i.numbers(), 6), unit.strip("*")]
            for named, unit, i in wanted
        ]
        return columns([*heads, "fitted", "95 % interval", "unit"], rows)

    every = _rows(made)
    parts = [table(["parameter", "given"], [([name], unit, i) for name, unit, recording, i in every if not recording])]
    if starts := [([recording, name], unit, i) for name, unit, recording, i in every if recording]:
        parts.append(table(["recording", "starting value", "first sample"], starts))
        held = {e.name for e in made.problem.held_out}
        if fitted := sorted({named[0] for named, _, _ in starts} & held):
            parts.append(f"  held out, the start alone fitted: {', '.join(fitted)}")
    parts += [f"  {name}: mean squared error {value:.4g} times the noise variance" for name, value in scores.items()]
    if made.weak:
        parts.append("  the recordings do not settle: " + "; ".join(made.weak))
    if not made.converged:
        parts.append("  the fit did not converge")
    return "\n".join(parts)
