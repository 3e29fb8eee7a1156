"""The report of a diagnosis: what is missing, where, how sure that is, and everything needed to repeat it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnosis.verdict.verdict import fit_table
from diagnosis.verdict.write import amended_text, given_text
from flexarm.plotting.wiring.diagram import diagram
from flexarm.report.evidence import evidence_charts
from flexarm.report.fit_page import fitted_starts
from flexarm.report.held_out import LABELS, ROLES, before_after, prediction
from flexarm.report.origin import origin
from flexarm.report.page import difference, render, view_of, write_page
from scenarios.amend import relocated

if TYPE_CHECKING:
    from diagnosis.verdict.verdict import Diagnosis

VERDICTS = {
    "named": "The missing effect is named",
    "none": "Nothing is missing that these recordings show",
    "tie": "Several effects explain the recordings equally well",
    "unknown": "Something is missing that has no name here",
    "wrong_parameter": "A parameter is wrong",
}


def write_diagnosis(found: Diagnosis, path: Path, *, seed: int | None = None, command: str = "") -> Path:
    """Write the report of a diagnosis.

    Args:
        found: the diagnosis.
        path: the .html file to write; it appears whole or not at all.
        seed: of the diagnosis, for the part on repeating it.
        command: the command line, for the same.

    Raises:
        FlexarmError: the file cannot be written.
    """
    return write_page(path, page(found, path.parent, seed=seed, command=command))


def page(found: Diagnosis, folder: Path, *, seed: int | None = None, command: str = "") -> str:
    """The report as HTML, for a folder from which it names files; other arguments as of `write_diagnosis`."""
    study = found.study
    # Odds say where an effect would be, given that there is one.
    odds = {} if found.verdict == "none" else study.place_odds
    lit = _lit(found, odds)
    picture = diagram(study.scenario, lit)
    evidence = evidence_charts(found.evidence)
    after = before_after(found)
    given = given_text(study.scenario)
    units = {v.name: v.unit for v in study.refit.fit.problem.model.outputs}
    # An input on which rivals hardly differ is not one to apply.
    useful = found.proposal is not None and found.proposal.separating
    charts = [*evidence, after, *([prediction(found.proposal, units)] if found.proposal and useful else [])]
    fitted = zip(found.fit.problem.free, found.fit.intervals(), strict=True)
    return render(
        "diagnosis.html.j2",
        charts,
        title=f"{study.scenario.name}: diagnosis",
        scenario=study.scenario,
        found=found,
        heading=heading(found),
        warnings=[(text, view_of(text, after)) for text in found.warnings],
        statuses=VERDICTS,
        picture=picture,
        odds=list(odds.items()),
        evidence=[chart.key for chart in evidence],
        held=study.refit.fit.problem.held_out,
        scores=_scores(found),
        fit=_fit_rows(found),
        labels=LABELS,
        rivals=_trials(found, found.rivals),
        tried=_trials(found, study.trials[:12]),
        trials=len(study.trials),
        parameters=[(i.name, i.start, i.numbers()) for f, i in fitted if not f.recording],
        starts=fitted_starts(found.fit),
        weak=found.fit.weak,
        proposal=found.proposal,
        rows=difference(
            *(relocated(text, study.scenario.path.parent, folder) for text in (given, amended_text(found)))
        ),
        origin=origin(
            study.scenario, recordings=[r.file for r in study.recordings if r.file], seed=seed, command=command
        ),
        recordings=[(r.name, ROLES.get(r.role, r.role), *r.extent, r.notes) for r in study.recordings],
    )


def heading(found: Diagnosis) -> str:
    """A title for all findings: that of the weakest where they agree, else what is named and what stays open."""
    statuses = [finding["status"] for finding in found.findings]
    sure = [status for status in statuses if status in ("named", "wrong_parameter")]
    if not sure or len(statuses) == 1:
        if found.verdict == "unknown" and found.study.chosen.effects:
            return "Something is missing; what stands below explains part of it, and no name is sure"
        return VERDICTS.get(found.verdict, found.verdict.replace("_", " "))
    if len(sure) == len(statuses):
        if set(sure) == {"named"}:
            return "The missing effects are named"
        return (
            "Parameters are wrong"
            if set(sure) == {"wrong_parameter"}
            else "An effect is missing, and a parameter is wrong"
        )
    first = "A missing effect is named" if "named" in sure else "A parameter is wrong"
    rest = (
        "of another several explain the recordings equally well"
        if "tie" in statuses
        else "more is missing, without a sure name"
    )
    return f"{first}; {rest}"


def _lit(found: Diagnosis, odds: dict[str, float]) -> dict[str, float]:
    """Places to light up: the odds, and what was found where odds say nothing of it."""
    if found.verdict == "none":
        return {}
    places = dict(odds)
    for finding in found.findings:
        if finding["place"] and finding["status"] == "wrong_parameter":
            places = {finding["place"]: 1.0}
        elif finding["place"]:
            places.setdefault(finding["place"], 1.0)
    return places


def _scores(found: Diagnosis) -> list[tuple[str, float, float]]:
    """Model, and its error on fitted and on held-out data."""
    study = found.study
    rows = [("model as given", *study.nominal), ("refitted", study.refit.fit.chi2, study.refit.hold_out)]
    if study.chosen.effects:
        rows.append((f"with {study.chosen.label}", study.chosen.fit.chi2, study.chosen.hold_out))
    return rows


def _fit_rows(found: Diagnosis) -> list[tuple[str, str, dict[str, dict[str, float]]]]:
    """Role, signal, and fit and error of each model."""
    table = fit_table(found.study)
    rows = []
    for role in ("train", "hold_out"):
        # The amended model may read a signal behind what was put in: rows go by position.
        for k, signal in enumerate(table[role]["refit"]):
            cells = {name: list(table[role][name].values())[k] for name in LABELS if len(table[role][name]) > k}
            rows.append((ROLES[role], signal, cells))
    return rows


def _trials(found: Diagnosis, trials: Any) -> list[dict[str, Any]]:
    best = found.study.chosen
    return [
        {
            "label": t.label,
            "hold_out": t.hold_out,
            "chi2": t.fit.chi2,
            "odds": found.study.odds.get(t.keys),
            "size": t.size,
            "chosen": t.effects == best.effects,
        }
        for t in trials
    ]
