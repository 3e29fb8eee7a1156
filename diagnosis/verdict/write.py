"""The files of a diagnosis: the verdict, the amended scenario, figures, and the next experiment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.effects.effect import Sizes, together
from diagnosis.estimation.least_squares import interval_in_words
from diagnosis.verdict.experiment_design import Proposal
from diagnosis.verdict.verdict import Diagnosis
from engine.files import folder_made, json_text, writing
from scenarios.amend import Edit, Feed, Set, amended, relocated, with_overrides, with_readings, with_values, without
from scenarios.load import Scenario

EXPERIMENT = "next_experiment"
"""Name of the block that plays the proposed input."""

NEARLY_NOTHING = 1e-9
"""Share of its given value at which a parameter is written that a fit has ended at zero."""

THINNED = 5
"""Every fifth row of the rivals' predictions is written."""


def given_text(scenario: Scenario) -> str:
    """The user's scenario with the values that were set for this run."""
    return with_overrides(scenario.path.read_text(encoding="utf-8"), scenario.overrides)


def amended_text(found: Diagnosis) -> str:
    """The user's scenario with what was missing put in and every parameter fitted; as given if nothing was found."""
    study = found.study
    original = with_readings(given_text(study.scenario), study.refit.fit.problem.assumed)
    if not study.chosen.effects:
        return original
    values = study.chosen.fit.parameters()
    intervals = {i.name: i for i in found.fit.intervals()}
    fitted: list[Sizes] = []
    notes: dict[str, str] = {}
    for finding, effect, start in zip(found.findings, study.chosen.effects, study.chosen.sizes, strict=True):
        sizes = {k.name: values.get(f"{effect.name}.{k.name}", start[k.name]) for k in effect.parameters}
        fitted.append(sizes)
        evidence = [f"{finding['status']}: {finding['sentence']}"]
        for parameter in effect.parameters:
            i = intervals.get(f"{effect.name}.{parameter.name}")
            if i is None:
                continue
            evidence.append(f"{parameter.name}: 95 % interval {interval_in_words(i.numbers())} {i.unit}")
        notes[effect.name] = "\n".join(evidence)
    edits: list[Edit] = together(study.chosen.effects, fitted)
    given = {p.name: p for p in study.chosen.fit.problem.model.parameters}
    written = {f"{effect.name}.{k.name}" for effect in study.chosen.effects for k in effect.parameters}
    common: dict[str, str | float] = {}
    for name, value in values.items():
        block, _, key = name.rpartition(".")
        if name not in given or name in written or "[" in key:
            continue
        unit = given[name].unit
        # Exactly nothing would take a law out of the model, and what is declared about it would have no meaning.
        value = value or NEARLY_NOTHING * given[name].value
        told = f"{value:.8g} {unit}" if unit not in ("1", "*") else float(f"{value:.8g}")
        if not block:
            common[name] = told  # a parameter of the scenario, which several blocks may share
        elif block in study.scenario.file.blocks or block in notes:
            edits.append(Set(block, key, told))
    return with_values(amended(original, edits, notes, study.scenario.resolve), common)


def write(found: Diagnosis, folder: Path) -> list[Path]:
    """Write ``diagnosis.json``, ``amended.yaml`` and the figures; each appears whole or not at all.

    Raises:
        FlexarmError: the folder cannot be written.
    """
    from diagnosis.verdict import figures

    folder_made(folder)
    made = [folder / "diagnosis.json", folder / "amended.yaml"]
    with writing(made[0], (".json",)) as temporary:
        temporary.write_text(json_text(found.numbers(), indent=2) + "\n", encoding="utf-8")
    text = relocated(amended_text(found), found.study.scenario.path.parent, folder)
    with writing(made[1], (".yaml",)) as temporary:
        temporary.write_text(text, encoding="utf-8")
    made.append(figures.held_out(found, folder / "held-out.png"))
    made.append(figures.odds(found, folder / "places.png"))
    made.append(figures.before_after(found, folder / "before-after.png"))
    made.append(figures.recovered(found, folder / "recovered-force.png")) if found.recovered else None
    if found.proposal is not None and found.proposal.separating:
        made += _next(found, found.proposal, folder)
    return made


def _next(found: Diagnosis, proposal: Proposal, folder: Path) -> list[Path]:
    """The proposed input and what each rival predicts; over time also a scenario that plays it."""
    made = [folder / "next-experiment.csv"]
    header = f"{proposal.axis},{proposal.input} [{proposal.unit}]"
    _table(made[0], header, [proposal.time, proposal.drive])
    if not proposal.axis.startswith("t "):
        return made
    outputs = found.study.refit.fit.problem.model.outputs
    names, columns = [proposal.axis], [proposal.time[::THINNED]]
    for label, values in proposal.predictions.items():
        for signal, column in zip(outputs, values.T, strict=True):
            names.append(f'"{signal.name} with {label} [{signal.unit}]"')
            columns.append(column[: len(proposal.time)][::THINNED])
    made.append(folder / "next-experiment-predictions.csv")
    _table(made[1], ",".join(names), columns)
    made.append(folder / "next-experiment.yaml")
    with writing(made[2], (".yaml",)) as temporary:
        temporary.write_text(experiment_text(found, proposal, folder), encoding="utf-8")
    return made


def experiment_text(found: Diagnosis, proposal: Proposal, folder: Path) -> str:
    """The user's scenario with the proposed input in place of its own source, for the rig and for the simulation."""
    path = found.study.scenario.path
    text = relocated(
        without(given_text(found.study.scenario), "recordings", "analyses", "simulate"), path.parent, folder
    )
    source = {
        "file": "next-experiment.csv",
        "time": proposal.axis,
        "column": f"{proposal.input} [{proposal.unit}]",
        "scale": f"1 {proposal.unit}" if proposal.unit not in ("", "1") else 1,
    }
    task = proposal.sentence[:1].upper() + proposal.sentence[1:]
    note = f"To tell apart: {'; '.join(proposal.separates)}.\n{task} ({proposal.kind})."
    fed = amended(
        text, [Feed(EXPERIMENT, "Table", proposal.input, source)], {EXPERIMENT: note}, found.study.scenario.resolve
    )
    return fed.rstrip() + f"\n\nsimulate: {{stop: {float(proposal.time[-1]):g} s, step: 1 ms}}\n"


def _table(path: Path, header: str, columns: list[Any]) -> None:
    with writing(path, (".csv",)) as temporary:
        np.savetxt(temporary, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
