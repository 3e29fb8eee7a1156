"""The report of a fit: values and intervals, recordings before and after, and what the recordings do not settle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis.binding import starting_unit
from flexarm.report.held_out import ROLES, beside
from flexarm.report.origin import origin
from flexarm.report.page import render, write_page

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from diagnosis.estimation.least_squares import Fit

MOST_NAMED = 8
"""Entries of the correlation matrix that are shown, the largest first."""


def write_fit(
    made: Fit,
    scores: Mapping[str, float],
    path: Path,
    *,
    files: Sequence[str] = (),
    seed: int | None = None,
    command: str = "",
) -> Path:
    """Write the report of a fit.

    Args:
        made: the fit.
        scores: mean squared error over the noise variance, by role.
        path: the .html file to write; it appears whole or not at all.
        files: of the recordings.
        seed: of the fit.
        command: the command line.

    Raises:
        FlexarmError: the file cannot be written.
    """
    problem = made.problem
    nominal = replace(made, x=np.zeros(len(problem.free)))
    chart = beside({"nominal": nominal, "refit": made}, problem.experiments)
    rows = list(zip(problem.free, made.intervals(), strict=True))
    given = {"fitted": problem.chi2(nominal.x, problem.training)}
    if problem.held_out:
        given["held out"] = problem.chi2(nominal.x, problem.held_out)
    text = render(
        "fit.html.j2",
        [chart],
        title=f"{problem.scenario.name}: fit",
        scenario=problem.scenario,
        made=made,
        scores=[(role, given.get(role), value) for role, value in scores.items()],
        parameters=[(i.name, i.start, i.numbers(), i.unit) for f, i in rows if not f.recording],
        starts=fitted_starts(made),
        together=_together(made),
        roles=[(e.name, ROLES.get(e.role, e.role)) for e in problem.experiments],
        origin=origin(problem.scenario, recordings=files, seed=seed, command=command),
    )
    return write_page(path, text)


def fitted_starts(made: Fit) -> list[tuple[str, str, float, dict[str, Any], str]]:
    """Recording, name, first sample, interval and unit of every starting value that was fitted."""
    problem = made.problem
    return [
        (f.recording, i.name, i.start, i.numbers(), starting_unit(problem.scenario, problem.model, i.name))
        for f, i in zip(problem.free, made.intervals(), strict=True)
        if f.recording
    ]


def _together(made: Fit) -> list[tuple[str, str, float]]:
    """Pairs of parameters whose estimates move together, the strongest first."""
    deviation = np.sqrt(np.maximum(np.diag(made.covariance), 0.0))
    names = [f.name if not f.recording else f"{f.name} of {f.recording}" for f in made.problem.free]
    pairs = []
    for i in range(len(names)):
        for j in range(i):
            if deviation[i] > 0 and deviation[j] > 0:
                pairs.append((names[j], names[i], float(made.covariance[i, j] / (deviation[i] * deviation[j]))))
    pairs.sort(key=lambda pair: -abs(pair[2]))
    return [pair for pair in pairs[:MOST_NAMED] if abs(pair[2]) > 0.5]
