"""How a file is to be read where its description leaves it open; the model tells, which neither stamps nor samples do.

Stamps that stray about an even clock may be when samples were taken, or only when they were logged. An input may have
been held between its samples, or have run on, as one that was computed or measured does. A model that is driven
late by as much drifts away from what was recorded, and no effect of the catalogue is early.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import Fit, descend, fit
from diagnosis.estimation.problem import Problem
from diagnosis.problems import problem
from diagnosis.recordings.time_axis import even_instants
from diagnosis.recordings.types import Recorded, Recording
from diagnosis.search.evidence import left_by
from diagnosis.search.fitter import CandidateFitter, end_of
from diagnosis.search.study import Study
from diagnosis.thresholds import SEARCH
from engine.threads import Threads
from scenarios.load import Scenario


def evened(scenario: Scenario, recording: Recorded) -> Recorded:
    """The recording on the even clock about which its stamps stray, if they do and it is open which is right."""
    if not isinstance(recording, Recording) or recording.clock != "either":
        return recording
    even = even_instants(recording.time)
    if even is None:
        return recording
    return replace(
        recording, time=even, clock="even", assumed={**recording.assumed, (*_place(recording), "time", "clock"): "even"}
    )


def _place(recording: Recording) -> tuple[str, str]:
    """Where a scenario describes a recording; parts of one that is split keep what was found before."""
    return "recordings", recording.described or recording.name


def straightened(scenario: Scenario, recording: Recorded) -> Recorded:
    """The recording with inputs that are straight lines between samples, where nobody said what they are."""
    if not isinstance(recording, Recording) or all(c.hold_stated for c in recording.drive):
        return recording
    described = scenario.recordings.get(recording.described or recording.name)
    keys = {scenario.resolve(end): end for end in getattr(described, "drive", {})}
    open_ones = {c.name for c in recording.drive if not c.hold_stated}
    drive = tuple(replace(c, hold="linear") if c.name in open_ones else c for c in recording.drive)
    told: dict[tuple[str, ...], str] = {
        (*_place(recording), "drive", keys.get(name, name), "hold"): "linear" for name in sorted(open_ones)
    }
    return replace(recording, drive=drive, assumed={**recording.assumed, **told})


READINGS: tuple[Callable[[Scenario, Recorded], Recorded], ...] = (evened, straightened)


def as_they_were_taken(scenario: Scenario, recordings: Sequence[Recorded], workers: int) -> list[Recorded]:
    """The recordings as the user's fitted model follows them best, where their descriptions leave it open.

    Recordings of one study come from one logger: all are read alike. Another reading than the plain one counts where it
    is likelier by odds of twenty to one, the noise as strong in each band of frequency as the model leaves it: stamps
    and held inputs matter where signals are fast, missing physics mostly where they are slow.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.

    Raises:
        FlexarmError: recordings that do not fit the scenario.
    """
    best: Fit | None = None
    kept = list(recordings)
    for reading in READINGS:
        other = [reading(scenario, r) for r in kept]
        if not _differ(other, kept):
            continue
        if best is None:
            best = fit(problem(scenario, kept), workers=workers, relative_drop=SEARCH.slow)
        found = _fitted(_with_noise_of(best.problem, problem(scenario, other)), best, workers)
        if _likelier(found, best):
            kept, best = other, found
    return kept


def taken_otherwise(fitter: CandidateFitter, found: Study) -> list[Recorded] | None:
    """A study's recordings as its best model follows them better than the user's own did; None if it does not.

    Args:
        fitter: where its models were fitted.
        found: the study.
    """
    chosen = found.chosen
    for reading in READINGS:
        other = [reading(fitter.scenario, r) for r in found.recordings]
        if not chosen.effects or not _differ(other, found.recordings):
            continue
        began = end_of(chosen).built
        made = _with_noise_of(chosen.fit.problem, fitter.again(other).build(chosen.effects, began, whole=True))
        if _likelier(_fitted(made, chosen.fit, fitter.workers), chosen.fit):
            return other
    return None


def _differ(one: Sequence[Recorded], other: Sequence[Recorded]) -> bool:
    """Whether recordings to fit are read in another way."""
    return any(a is not b and a.role != "hold_out" for a, b in zip(one, other, strict=True))


def _likelier(found: Fit, than: Fit) -> bool:
    instants = found.problem.training  # the same for both, for what they leave to compare
    return _likelihood(found, instants) > _likelihood(than, instants) + SEARCH.effort


def _fitted(made: Problem, near: Fit, workers: int) -> Fit:
    """Another reading fitted from where the first one's fit ended."""
    with Threads(workers) as pool:
        x, cost, converged = descend(made, near.x, made.training, pool, relative_drop=SEARCH.slow)
    return replace(near, problem=made, x=x, cost=cost, converged=converged)


def _likelihood(made: Fit, instants: Sequence[Experiment]) -> float:
    """Logarithm of the likelihood of what a fit leaves, taken at the instants of experiments."""
    residuals = [made.problem.residual(made.x, e) for e in made.problem.training]
    return left_by(instants, residuals).log_likelihood - 0.5 * made.problem.prior_cost(made.x)


def _with_noise_of(one: Problem, other: Problem) -> Problem:
    """The other problem with the noise of the first, so that their costs compare."""
    pairs = zip(one.experiments, other.experiments, strict=True)
    return replace(other, experiments=tuple(replace(b, sigma=a.sigma) for a, b in pairs))
