"""`fit` and `diagnose` from scenario and recording names, and the files they leave."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from diagnosis.compare import find_recording
from diagnosis.fit import Fit
from diagnosis.fit import fit as fit_problem
from diagnosis.prepare import problem
from diagnosis.recording import Recorded
from diagnosis.select import Progress, study
from diagnosis.verdict import Diagnosis, judge
from engine.errors import FlexarmError
from engine.files import writing
from scenarios.amend import Edit, Set, amended, relocated
from scenarios.load import Scenario, load

BLAS_THREADS = 1
"""The matrices are small: threads of the linear algebra would wait for one another, and change the rounding."""


def gather(
    scenario: Scenario, names: Sequence[str | Path | Recorded], hold_out: Sequence[str | Path | Recorded]
) -> list[Recorded]:
    """Recordings by name or file with their roles; all that the scenario describes if none are named.

    Raises:
        FlexarmError: none at all, or no training data.
    """
    chosen = list(names) or [n for n in scenario.recordings if n not in hold_out]
    rows: list[Recorded] = []
    for given, role in [*((n, "") for n in chosen), *((n, "hold_out") for n in hold_out)]:
        found = given if isinstance(given, Recorded) else find_recording(scenario, given)
        rows.append(replace(found, role=role) if role else found)
    if not any(r.role in ("train", "repeat") for r in rows):
        raise FlexarmError("no recording to fit to", remedy="name one, or give one the role 'train'")
    return rows


def fit(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    *,
    hold_out: Sequence[str | Path | Recorded] = (),
    overrides: Sequence[str] = (),
    workers: int = 2,
    seed: int = 0,
) -> tuple[Fit, dict[str, float]]:
    """Fit a scenario's parameters, within their tolerances, to recordings.

    Args:
        source: the scenario.
        recordings: to fit to; all that the scenario describes by default.
        hold_out: to judge on.
        overrides: ``key=value`` texts.
        workers: threads.
        seed: of the random starts.

    Returns:
        The fit, and the mean squared residual over the noise variance by role.

    Raises:
        FlexarmError: scenario or recordings that do not fit.
    """
    scenario = source if isinstance(source, Scenario) else load(source, overrides)
    recorded = gather(scenario, recordings, hold_out)
    with threadpool_limits(BLAS_THREADS):
        made = fit_problem(problem(scenario, recorded), random_starts=2, seed=seed, workers=workers)
    scores = {"fitted": made.chi2}
    held = made.problem.chosen("hold_out")
    if held:
        scores["held out"] = made.score(held)
    return made, scores


def diagnose(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    *,
    hold_out: Sequence[str | Path | Recorded] = (),
    overrides: Sequence[str] = (),
    workers: int = 2,
    seed: int = 0,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Say what a model leaves out of what was recorded; see `diagnosis.verdict.Diagnosis`.

    Args:
        source: the scenario.
        recordings: to fit to, and to judge on where their role says so; all that the scenario describes by default.
        hold_out: further recordings to judge on.
        overrides: ``key=value`` texts.
        workers: threads.
        seed: of everything random.
        without: effects of the catalogue that are not to be tried.
        progress: told what is done.

    Raises:
        FlexarmError: scenario or recordings that do not fit.
    """
    scenario = source if isinstance(source, Scenario) else load(source, overrides)
    recorded = gather(scenario, recordings, hold_out)
    with threadpool_limits(BLAS_THREADS):
        return judge(study(scenario, recorded, workers=workers, seed=seed, without=without, progress=progress), seed)


def amended_text(found: Diagnosis) -> str:
    """The user's scenario with what was missing put in and every parameter fitted; unchanged if nothing was found."""
    study = found.study
    original = study.scenario.path.read_text(encoding="utf-8")
    if not study.chosen.effects:
        return original
    values = study.chosen.fit.parameters()
    intervals = {i.name: i for i in found.fit.intervals()}
    edits: list[Edit] = []
    notes: dict[str, str] = {}
    for finding, effect, start in zip(found.findings, study.chosen.effects, study.chosen.sizes, strict=True):
        sizes = {k.parameter: values.get(f"{effect.name}.{k.parameter}", start[k.parameter]) for k in effect.knobs}
        edits += effect.edits(sizes)
        evidence = [f"{finding['status']}: {finding['sentence']}"]
        for knob in effect.knobs:
            i = intervals.get(f"{effect.name}.{knob.parameter}")
            if i is None:
                continue
            low, high = sorted((i.low, i.high))
            evidence.append(f"{knob.parameter}: 95 % interval {low:.4g} to {high:.4g} {i.unit}")
        notes[effect.name] = "\n".join(evidence)
    given = {p.name: p for p in study.refit.fit.problem.model.parameters}
    for name, value in values.items():
        block, _, key = name.rpartition(".")
        if name in given and block in study.scenario.file.blocks and "[" not in key:
            unit = given[name].unit
            edits.append(Set(block, key, f"{value:.8g} {unit}" if unit not in ("1", "*") else float(f"{value:.8g}")))
    return amended(original, edits, notes)


def write(found: Diagnosis, folder: Path) -> list[Path]:
    """Write ``diagnosis.json``, ``amended.yaml`` and the figures; each appears whole or not at all.

    Raises:
        FlexarmError: the folder cannot be written.
    """
    from diagnosis import figures

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FlexarmError(f"cannot make the folder '{folder}': {error.strerror}") from error
    made = [folder / "diagnosis.json", folder / "amended.yaml"]
    with writing(made[0], (".json",)) as temporary:
        temporary.write_text(json.dumps(_plain(found.numbers()), indent=2) + "\n", encoding="utf-8")
    text = relocated(amended_text(found), found.study.scenario.path.parent, folder)
    with writing(made[1], (".yaml",)) as temporary:
        temporary.write_text(text, encoding="utf-8")
    made.append(figures.held_out(found, folder / "held-out.png"))
    made.append(figures.odds(found, folder / "places.png"))
    made.append(figures.before_after(found, folder / "before-after.png"))
    if found.proposal is not None:
        target = folder / "next-experiment.csv"
        table = np.column_stack([found.proposal.time, found.proposal.drive])
        header = f"{found.proposal.axis},{found.proposal.input} [{found.proposal.unit}]"
        with writing(target, (".csv",)) as temporary:
            np.savetxt(temporary, table, delimiter=",", header=header, comments="", fmt="%.9g")
        made.append(target)
    return made


def _plain(value: Any) -> Any:
    """The value with numbers that JSON cannot hold as null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
