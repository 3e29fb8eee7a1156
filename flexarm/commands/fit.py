"""``flexarm fit SCENARIO [RECORDING...]``: fit parameters to recordings."""

from __future__ import annotations

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
    from diagnosis.estimation.least_squares import Fit


def fit(
    scenario: ScenarioArgument,
    recordings: RecordingsArgument = None,
    hold_out: HoldOutOption = None,
    overrides: SetOption = None,
    workers: WorkersOption = None,
    seed: SeedOption = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """Fit the parameters, within their tolerances, to recordings."""
    from diagnosis.api import fit as run

    made, scores = run(
        scenario, recordings or (), hold_out=hold_out or (), overrides=overrides or (), workers=workers, seed=seed
    )
    if as_json:
        typer.echo(json_text(_fit_numbers(made, scores), indent=2))
        return
    typer.echo(fit_page(made, scores))


def _fit_numbers(made: Fit, scores: dict[str, float]) -> dict[str, Any]:
    rows = {i.name: i.numbers() | {"start": i.start} for i in made.intervals()}
    found = {"parameters": rows, "chi2": scores, "converged": made.converged, "not_settled": list(made.weak)}
    return found | {"spread": _spread(made)}


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


def fit_page(made: Fit, scores: dict[str, float]) -> str:
    """A fit as text: values, intervals, scores and what the data do not settle."""
    from diagnosis.estimation.least_squares import interval_in_words
    from flexarm.console.text import columns, number

    rows = [
        [i.name, number(i.start), number(i.value), interval_in_words(i.numbers(), 6), i.unit.strip("*")]
        for i in made.intervals()
    ]
    parts = [columns(["parameter", "given", "fitted", "95 % interval", "unit"], rows)]
    parts += [f"  {name}: mean squared error {value:.4g} times the noise variance" for name, value in scores.items()]
    if made.weak:
        parts.append("  the recordings do not settle: " + "; ".join(made.weak))
    if not made.converged:
        parts.append("  the fit did not converge")
    return "\n".join(parts)
