"""How a file is to be read where its description leaves it open; the model tells, which neither stamps nor samples do.

Stamps that stray about an even clock may be when samples were taken, or only when they were logged. An input may have
been held between its samples, or have run on, as one that was computed or measured does. A model that is driven
late by as much drifts away from what was recorded, and no effect of the catalogue is early. And where a recording
begins is known of what is measured: the rest may be at rest with it, or be let go of twisted. An acceleration jumps
with the input, and a controller that reads first has logged it before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.binding import jumping
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import beside
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.held_out_starts import with_held_out_starts
from diagnosis.estimation.least_squares import Fit, descend, fit
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import over_time
from diagnosis.problems import problem
from diagnosis.recordings.time_axis import even_instants
from diagnosis.recordings.types import Assumed, Recorded, Recording
from diagnosis.search.evidence import evidence
from diagnosis.search.fitter import CandidateFitter, end_of
from diagnosis.search.partial_fit import ended, place_of, standing
from diagnosis.search.posterior import prices, value
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.study import Study
from diagnosis.search.tried_models import TriedModels
from diagnosis.thresholds import SEARCH
from engine.threads import Threads
from scenarios.load import Scenario


def slackened(posed: Problem, recording: Recorded) -> Recorded:
    """The recording with every coordinate free at its start, where the user leaves some free and states no others."""
    if not isinstance(recording, Recording) or not recording.free:
        return recording
    begin = next(e for e in over_time(posed.experiments) if e.name == recording.name).begin
    others = [name for name in begin.values if name not in begin.free and name not in recording.starts]
    if not others:
        return recording
    free = (*recording.free, *others)
    return replace(recording, free=free, assumed={**recording.assumed, (*_place(recording), "initial", "free"): free})


def evened(_: Problem, recording: Recorded) -> Recorded:
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


def straightened(posed: Problem, recording: Recorded) -> Recorded:
    """The recording with inputs that are straight lines between samples, where nobody said what they are."""
    if not isinstance(recording, Recording) or all(c.hold_stated for c in recording.drive):
        return recording
    scenario = posed.scenario
    described = scenario.recordings.get(recording.described or recording.name)
    keys = {scenario.resolve(end): end for end in getattr(described, "drive", {})}
    open_ones = {c.name for c in recording.drive if not c.hold_stated}
    drive = tuple(replace(c, hold="linear") if c.name in open_ones else c for c in recording.drive)
    told: dict[tuple[str, ...], Assumed] = {
        (*_place(recording), "drive", keys.get(name, name), "hold"): "linear" for name in sorted(open_ones)
    }
    return replace(recording, drive=drive, assumed={**recording.assumed, **told})


def read_first(posed: Problem, recording: Recorded) -> Recorded:
    """The recording as measured in each row before its input acts, where that is open and a signal jumps with it."""
    if not isinstance(recording, Recording) or recording.sampled != "either" or not jumping(posed.model):
        return recording
    said = "before_input"
    return replace(recording, sampled=said, assumed={**recording.assumed, (*_place(recording), "sampled"): said})


READINGS: tuple[Callable[[Problem, Recorded], Recorded], ...] = (slackened, evened, straightened, read_first)


def as_they_were_taken(scenario: Scenario, recordings: Sequence[Recorded], workers: int) -> list[Recorded]:
    """The recordings as the user's fitted model follows them best, where their descriptions leave it open.

    Recordings of one study come from one logger: all are read alike. Another reading than the plain one counts where
    its evidence is greater by odds of twenty to one, the noise as strong in each band of frequency as the model leaves
    it: stamps and held inputs matter where signals are fast, missing physics mostly where they are slow.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.

    Raises:
        FlexarmError: recordings that do not fit the scenario.
    """
    posed = problem(scenario, recordings)
    best: Fit | None = None
    kept = list(recordings)
    for reading in READINGS:
        other = [reading(posed, r) for r in kept]
        if not _differ(other, kept):
            continue
        if best is None:
            best = _judged(fit(problem(scenario, kept), workers=workers, least_gain=SEARCH.slow, noise="coloured"))
        found = _fitted(_with_noise_of(best.problem, problem(scenario, other)), best, workers)
        if _likelier(found, best):
            kept, best = other, found
    return kept


def taken_otherwise(fitter: CandidateFitter, model: ScoredModel) -> list[Recorded] | None:
    """Recordings as a model with effects follows them better than the user's own did; None if it does not.

    Args:
        fitter: where it was fitted.
        model: which.
    """
    for reading in READINGS:
        other = [reading(fitter.base, r) for r in fitter.recordings]
        if not model.effects or not _differ(other, fitter.recordings):
            continue
        began = end_of(model).built
        made = _with_noise_of(model.fit.problem, fitter.again(other).build(model.effects, began, whole=True))
        if _likelier(_fitted(made, model.fit, fitter.workers), model.fit):
            return other
    return None


def as_described(given: Sequence[Recorded], taken: Sequence[Recorded]) -> list[Recorded] | None:
    """Recordings with inputs as they were described, where another reading was taken; None where none was.

    Args:
        given: as they were described.
        taken: the same as `as_they_were_taken` gave them.
    """
    rows = [_described(a, b) for a, b in zip(given, taken, strict=True)]
    return rows if _differ(rows, taken) else None


def _described(given: Recorded, taken: Recorded) -> Recorded:
    if not isinstance(given, Recording) or not isinstance(taken, Recording):
        return taken
    moved = {place for place in taken.assumed if place[-1] in ("hold", "sampled")}
    if not moved:
        return taken
    kept = {place: said for place, said in taken.assumed.items() if place not in moved}
    return replace(taken, drive=given.drive, sampled=given.sampled, assumed=kept)


def near_as_described(
    described: CandidateFitter, taken: Study, without: Sequence[str] = ()
) -> list[ScoredModel] | None:
    """Models that follow recordings as they were described as well as with another reading of their inputs, or nearly.

    The readings of an input are less than a sample apart, and a delay makes up for that, whatever else is missing; what
    was found may have made up for it, too. So that is fitted to the recordings as described: as it is, with a delay,
    and with a delay in the place of each effect. A search of these recordings begins there. Where none comes near, it
    would be in vain.

    Args:
        described: of the recordings as they were described.
        taken: a study of the same with the other reading.
        without: effects that are not to be tried, such as a delay.

    Returns:
        The models, empty if none can be fitted, so that a search alone can tell; None if none comes near.
    """
    chosen = taken.chosen
    kept = tuple(ended(chosen, c) for c in chosen.effects)
    others = tuple(c for c in kept if c.effect != "delay")
    delays = [c for c in candidates(taken.scales, without) if c.effect == "delay"]
    late = [able for c in delays if (able := beside(others, c)) is not None]
    known = TriedModels(described, described.refit, taken.tried)
    fewer = [others, *(tuple(c for c in others if c is not left) for left in others)]
    alike = [kept, *((*some, c) for some in fewer for c in late)]
    made = known.fit([(effects, [standing(chosen.fit)]) for effects in alike], len(alike), whole=True)
    near = [m for m in made if known.worth(m) > known.worth(chosen) - known.price - SEARCH.effort]
    return near if near or not made else None


def likelier(described: Study, taken: Study) -> bool:
    """Whether a study of recordings as they were described does as well as one with another reading of their inputs.

    Without what is missing, a delay is an input that was logged late: either is searched, and the better one counts,
    the other reading where its evidence is greater by odds of twenty to one. Where they differ by no more than luck,
    that with fewer effects does.
    """
    one, other = (max((value(m, s.tried), m.left.luck) for m in (s.refit, *s.trials)) for s in (described, taken))
    if abs(one[0] - other[0]) < max(one[1], other[1]):
        return prices(described.chosen.effects) <= prices(taken.chosen.effects)
    return one[0] + SEARCH.effort >= other[0]


def _differ(one: Sequence[Recorded], other: Sequence[Recorded]) -> bool:
    """Whether recordings are read in another way."""
    return any(a is not b for a, b in zip(one, other, strict=True))


def _likelier(found: Fit, than: Fit) -> bool:
    instants = found.problem.experiments  # the same for both, for what they leave to compare
    return _evidence(found, instants) > _evidence(than, instants) + SEARCH.effort


def _fitted(made: Problem, near: Fit, workers: int) -> Fit:
    """Another reading fitted from where the first one's fit ended."""
    ended = standing(near)
    begin = np.array([f.position(ended.get(place_of(f), f.start)) for f in made.free])
    with Threads(workers) as pool:
        x, cost, converged = descend(made, begin, made.training, pool, least_gain=SEARCH.slow)
    return _judged(replace(near, problem=made, x=x, cost=cost, converged=converged))


def _judged(made: Fit) -> Fit:
    """A fit with the starting values of held-out recordings fitted too."""
    return replace(made, x=with_held_out_starts(made.problem, made.x, noise="coloured"))


def _evidence(made: Fit, instants: Sequence[Experiment]) -> float:
    """The evidence of a fit, taken at the instants of experiments."""
    return evidence(made.problem, made.x, instants=instants).log


def _with_noise_of(one: Problem, other: Problem) -> Problem:
    """The other problem with the noise of the first, so that their costs compare."""
    pairs = zip(one.experiments, other.experiments, strict=True)
    return replace(other, experiments=tuple(replace(b, sigma=a.sigma) for a, b in pairs))
