"""`fit` and `diagnose` from scenario and recording names."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from diagnosis.binding import find_recording, verify
from diagnosis.effects.catalogue import candidates, check_names
from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.held_out_starts import with_held_out_starts
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.least_squares import fit as fit_problem
from diagnosis.planning.experiment import own_run, recorded
from diagnosis.planning.plan import MULTIPLES, Plan
from diagnosis.planning.plan import plan as judge_plan
from diagnosis.problems import problem
from diagnosis.recordings.checks import check_moving
from diagnosis.recordings.types import Recorded, Recording
from diagnosis.search.allowance import Spent
from diagnosis.search.dask_fitter import DaskFitter
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.readings import as_described, as_they_were_taken, likelier, near_as_described, taken_otherwise
from diagnosis.search.reported import as_reported
from diagnosis.search.search import study
from diagnosis.search.spare_channels import settled_by_spare_channels
from diagnosis.search.tried_models import Progress
from diagnosis.thresholds import SEARCH
from diagnosis.verdict.recording_checks import screen
from diagnosis.verdict.verdict import Diagnosis, judge
from engine.compile import version as compiler_version
from engine.errors import FlexarmError
from engine.spread import JsonStore, Spread, cores
from scenarios.load import Scenario, load

BLAS_THREADS = 1
"""The matrices are small: threads of the linear algebra would wait for one another, and change the rounding."""

RANDOM_STARTS = 2
"""Of a fit, beside the values given."""


def gather(
    scenario: Scenario, names: Sequence[str | Path | Recorded], hold_out: Sequence[str | Path | Recorded]
) -> list[Recorded]:
    """Recordings by name or file with their roles; all that the scenario describes if none are named.

    Raises:
        FlexarmError: none at all, no training data, or a measurement that never changes.
    """
    chosen = list(names) or [n for n in scenario.recordings if n not in hold_out]
    rows: list[Recorded] = []
    for given, role in [*((n, "") for n in chosen), *((n, "hold_out") for n in hold_out)]:
        found = given if isinstance(given, Recorded) else find_recording(scenario, given)
        rows.append(replace(found, role=role) if role else found)
    if not any(r.role in ("train", "repeat") for r in rows):
        raise FlexarmError("no recording to fit to", remedy="name one, or give one the role 'train'")
    check_moving(rows)
    return rows


def _check_held_out(rows: Sequence[Recorded]) -> None:
    """Refuse rows that are fitted and held out as well: they would be foretold without fail."""
    over_time = [r for r in rows if isinstance(r, Recording)]
    for one, other in itertools.product(over_time, over_time):
        if one.role != "hold_out" and other.role == "hold_out" and np.array_equal(one.time, other.time):
            mine, others = ({m.name: m.values for m in r.measurements} for r in (one, other))
            if mine.keys() == others.keys() and all(np.array_equal(mine[k], others[k], equal_nan=True) for k in mine):
                raise FlexarmError(
                    f"recordings '{one.name}', which is fitted, and '{other.name}', which is held out, "
                    "hold the same rows",
                    remedy="hold out another recording, or another window of the file",
                )


def _to_fit(
    scenario: Scenario, names: Sequence[str | Path | Recorded], hold_out: Sequence[str | Path | Recorded]
) -> list[Recorded]:
    """The same as `gather`; spare signals are in the model, and a compiler runs.

    Runs fall back on Python where there is none, but tangents do not: without this a fit would simulate for minutes
    before it asks for a compiler.
    """
    rows = gather(scenario, names, hold_out)
    _check_held_out(rows)
    over_time = [r for r in rows if isinstance(r, Recording)]
    if over_time:
        compiler_version()
    for recording in over_time:
        _check_spare(scenario, recording, over_time[0])
    return rows


def _check_spare(scenario: Scenario, recording: Recording, first: Recording) -> None:
    """Refuse, before a long search, spare signals that cannot be held against a model at its end."""
    for one, other in ((first, recording), (recording, first)):
        missing = {c.name for c in one.spare} - {c.name for c in other.spare}
        if missing:
            raise FlexarmError(
                f"recording '{other.name}' has no spare column of '{min(missing)}', which '{one.name}' has",
                remedy="map it with 'use: evidence' in all recordings, or in none",
            )
    if recording.spare:
        verify(scenario, recording)


def fit(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    *,
    hold_out: Sequence[str | Path | Recorded] = (),
    overrides: Sequence[str] = (),
    workers: int | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[Fit, dict[str, float]]:
    """Fit a scenario's parameters, within their tolerances, to recordings.

    Args:
        source: the scenario.
        recordings: to fit to; all that the scenario describes by default.
        hold_out: to judge on.
        overrides: ``key=value`` texts.
        workers: threads; as many as cores if None. The result does not depend on them.
        seed: of the random starts.
        progress: called with the fraction done, from 0 to 1.

    Returns:
        The fit, and the mean squared residual over the noise variance by role.

    Raises:
        FlexarmError: scenario or recordings that do not fit, or no compiler.
    """
    scenario = source if isinstance(source, Scenario) else load(source, overrides)
    workers = workers or cores()
    begun = itertools.count()

    def said(_: str) -> None:
        # Told at each start, the first of which is where the fit stands.
        if progress is not None:
            progress(next(begun) / (RANDOM_STARTS + 1))

    with threadpool_limits(BLAS_THREADS):
        posed = problem(scenario, as_they_were_taken(scenario, _to_fit(scenario, recordings, hold_out), workers))
        made = fit_problem(posed, random_starts=RANDOM_STARTS, seed=seed, workers=workers, progress=said)
    scores = {"fitted": made.chi2}
    if made.problem.held_out:
        # Nothing that was fitted tells the state in which a held-out recording begins.
        made = replace(made, x=with_held_out_starts(made.problem, made.x))
        scores["held out"] = made.problem.chi2(made.x, made.problem.held_out)
    return made, scores


def possible_effects(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    *,
    overrides: Sequence[str] = (),
    without: Sequence[str] = (),
) -> list[Candidate]:
    """What `diagnose` would try, without fitting anything: every effect at every place, with sizes to start from.

    Args:
        source: the scenario.
        recordings: that say how large things are; all that the scenario describes by default.
        overrides: ``key=value`` texts.
        without: effects that are left out.

    Raises:
        FlexarmError: scenario or recordings that do not fit, or an effect that is unknown or cannot be used.
    """
    check_names(without)
    scenario = source if isinstance(source, Scenario) else load(source, overrides)
    with threadpool_limits(BLAS_THREADS):
        return candidates(operating_scales(problem(scenario, gather(scenario, recordings, ()))), without)


class DiagnosisKeywords(TypedDict, total=False):
    """The fields of `DiagnosisOptions` as keywords; why there are both: `engine.simulate.SimulationKeywords`."""

    hold_out: Sequence[str | Path | Recorded]
    overrides: Sequence[str]
    workers: int | None
    seed: int
    without: Sequence[str]
    progress: Progress | None
    warn: Callable[[Sequence[str]], None] | None
    keep: Path | None
    scheduler: str | None
    longest: float | None


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions:
    """How a diagnosis is done.

    Attributes:
        hold_out: further recordings to judge on.
        overrides: ``key=value`` texts.
        workers: threads; as many as cores if None. The result does not depend on them.
        seed: of everything random.
        without: effects, of the catalogue or registered, that are not to be tried.
        progress: told what is done.
        warn: told before the search what looks wrong with the recordings, in sentences.
        keep: folder where every fit is kept, so that a call that was interrupted goes on where it was.
        scheduler: address of a dask scheduler whose workers do the fits.
        longest: processor time (s), about, after which the search ends and what was found is told; as long as it takes
            if None. It is counted in operations, so that the result does not depend on the machine.
    """

    hold_out: Sequence[str | Path | Recorded] = ()
    overrides: Sequence[str] = ()
    workers: int | None = None
    seed: int = 0
    without: Sequence[str] = ()
    progress: Progress | None = None
    warn: Callable[[Sequence[str]], None] | None = None
    keep: Path | None = None
    scheduler: str | None = None
    longest: float | None = None


def diagnose(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    options: DiagnosisOptions | None = None,
    **given: Unpack[DiagnosisKeywords],
) -> Diagnosis:
    """Say what a model leaves out of what was recorded; see `diagnosis.verdict.verdict.Diagnosis`.

    Args:
        source: the scenario.
        recordings: to fit to, and to judge on where their role says so; all that the scenario describes by default.
        options: how it is done.
        **given: fields of `DiagnosisOptions` as keywords, over those of ``options``, such as ``workers=4``.

    Raises:
        FlexarmError: scenario or recordings that do not fit, an effect that is unknown or cannot be used, no compiler,
            no worker, or no cluster at that address.
    """
    how = replace(options or DiagnosisOptions(), **given)
    check_names(how.without)
    if how.workers is not None and how.workers < 1:
        raise FlexarmError(f"{how.workers} workers cannot do anything", remedy="give 1 or more")
    if how.longest is not None and not how.longest > 0:
        raise FlexarmError(f"a search of {how.longest:g} s finds nothing", remedy="give a positive time")
    scenario = source if isinstance(source, Scenario) else load(source, how.overrides)
    workers = how.workers or cores()
    spent = Spent() if how.longest is None else Spent(how.longest * SEARCH.second)
    with threadpool_limits(BLAS_THREADS), contextlib.ExitStack() as stack:
        as_given = _to_fit(scenario, recordings, how.hold_out)
        store = JsonStore(how.keep) if how.keep is not None else None  # what is refused leaves no folder
        recorded = as_they_were_taken(scenario, as_given, workers)
        if how.scheduler:
            spread = stack.enter_context(Spread(how.workers, how.scheduler))
            fitter: CandidateFitter = DaskFitter(scenario, recorded, spread, how.seed, store, spent)
        else:
            fitter = CandidateFitter(scenario, recorded, workers, how.seed, store, spent)
        if how.warn is not None:
            how.warn([remark.text for remark in screen(fitter.base)])
        found = study(fitter, without=how.without, progress=how.progress)
        described = as_described(as_given, recorded) if found.chosen.effects else None
        if described is not None and not found.ended_early:
            again = fitter.again(described)
            near = near_as_described(again, found, how.without)
            if near is not None:
                began = [*near, *found.trials[: SEARCH.finished]]
                other = study(again, without=how.without, progress=how.progress, known=began, looked=found.looked)
                if likelier(other, found):
                    fitter, found = again, other
        fitter = fitter.again(found.recordings)  # the search may have read them anew, or fitted a held-out one
        if (anew := taken_otherwise(fitter, found.chosen)) is not None:
            again = fitter.again(anew)
            known, looked, told = found.trials[: SEARCH.finished], found.looked, found.notes
            other = study(again, without=how.without, progress=how.progress, told=told, known=known, looked=looked)
            if not other.ended_early or likelier(other, found):  # what had no time tells less than what was found
                fitter, found = again, other
        fitter = fitter.again(found.recordings)
        return judge(as_reported(fitter, settled_by_spare_channels(fitter, found)))


def plan(
    source: Scenario | str | Path,
    recordings: Sequence[str | Path | Recorded] = (),
    *,
    measure: Mapping[str, str] | None = None,
    overrides: Sequence[str] = (),
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    multiples: Sequence[float] = MULTIPLES,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Say before an experiment which missing effects it could find, and tell apart; see `diagnosis.planning.plan.Plan`.

    Args:
        source: the scenario.
        recordings: whose inputs, sensors and noise are those of the experiment; all that the scenario describes by
            default. Their samples do not matter.
        measure: signals and the standard deviation of their noise, such as ``{"motor.shaft.angle": "0.1 deg"}``; an
            empty text for a usual one. The experiment is then the scenario's own run, as it is where no recordings are
            described.
        overrides: ``key=value`` texts.
        only: effects that are looked at; all if none are named.
        without: effects that are left out.
        multiples: sizes at which effects are told apart, in smallest sizes that show, ascending.
        workers: threads; as many as cores if None. The result does not depend on them.
        progress: told what is done, how many of how many.

    Raises:
        FlexarmError: scenario or recordings that do not fit, an unknown signal or effect, or a size that is none.
    """
    check_names([*only, *without])
    if workers is not None and workers < 1:
        raise FlexarmError(f"{workers} workers cannot do anything", remedy="give 1 or more")
    if not multiples or min(multiples) < 1:
        raise FlexarmError(
            f"effects at {', '.join(f'{m:g}' for m in multiples) or 'no'} times the smallest size that shows",
            remedy="give multiples of 1 or more, such as 3 and 10",
        )
    scenario = source if isinstance(source, Scenario) else load(source, overrides)
    if measure is not None and recordings:
        raise FlexarmError(
            "both recordings and signals to measure are given", remedy="give one: signals are those of the own run"
        )
    with threadpool_limits(BLAS_THREADS):
        if measure is not None or not (recordings or scenario.recordings):
            planned = own_run(scenario, measure)
        else:
            planned = recorded(scenario, gather(scenario, recordings, ()))
        return judge_plan(
            scenario,
            planned,
            multiples=multiples,
            only=only,
            without=without,
            workers=workers or cores(),
            progress=progress,
        )
