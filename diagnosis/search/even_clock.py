"""Stamps that stray about an even clock: whether the samples were taken at the stamps, or evenly and logged late.

A drive that holds its input between samples is late by as much as its stamps are, and a model that is driven at the
stamps then drifts away from what was recorded. Neither the stamps nor the samples tell which it was; the model does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from diagnosis.estimation.least_squares import descend, fit
from diagnosis.estimation.problem import Problem
from diagnosis.problems import problem
from diagnosis.recordings.time_axis import even_instants
from diagnosis.recordings.types import Recorded, Recording
from diagnosis.thresholds import SEARCH
from engine.threads import Threads
from scenarios.load import Scenario


def evened(recording: Recorded) -> Recorded:
    """The recording on the even clock about which its stamps stray, if they do and it is open which is right."""
    if not isinstance(recording, Recording) or recording.clock != "either":
        return recording
    even = even_instants(recording.time)
    return recording if even is None else replace(recording, time=even, clock="even")


def on_their_clocks(scenario: Scenario, recordings: Sequence[Recorded], workers: int) -> list[Recorded]:
    """The recordings at the instants, logged or even, that the user's fitted model follows better.

    Recordings of one study come from one logger: all that stray are taken alike.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.

    Raises:
        FlexarmError: recordings that do not fit the scenario.
    """
    even = [evened(r) for r in recordings]
    if not any(e is not r and r.role != "hold_out" for e, r in zip(even, recordings, strict=True)):
        return list(recordings)
    made = fit(problem(scenario, even), workers=workers, relative_drop=SEARCH.slow)
    logged = _with_noise_of(made.problem, problem(scenario, recordings))
    with Threads(workers) as pool:
        _, at_stamps, _ = descend(logged, made.x, logged.training, pool, relative_drop=SEARCH.slow)
    if made.cost <= at_stamps:
        return even
    return [
        replace(r, clock="as_logged") if e is not r and isinstance(r, Recording) else r
        for e, r in zip(even, recordings, strict=True)
    ]


def _with_noise_of(one: Problem, other: Problem) -> Problem:
    """The other problem with the noise of the first, so that their costs compare."""
    pairs = zip(one.experiments, other.experiments, strict=True)
    return replace(other, experiments=tuple(replace(b, sigma=a.sigma) for a, b in pairs))
