"""Long recordings made coarse, to look at many models in little time.

A logger is often much faster than the machine. A coarse recording has one sample of several, smoothed, and the mean
input in between. What a model answers to it differs a little from what it answers to the whole; the samples are
corrected by that difference, as one fitted model shows it. So the residual of that model is the true one, and models
near it are compared rightly: the defect correction of multigrid methods [Brandt 1977]. Those that promise most
are then fitted to the recordings as they are.

Where the machine allows it, longer integration steps are taken as well, and corrected for in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import resolved
from diagnosis.thresholds import COARSE, EVIDENCE, FITTING
from engine.errors import SimulationError
from engine.step import StepRule


def coarse(problem: Problem, x: Array) -> Problem:
    """The problem on coarse recordings, or as it is where that would hide what is missing or change its answer.

    Args:
        problem: of a model.
        x: its search vector as fitted.
    """
    given = [e for e in problem.experiments if isinstance(e, TimeExperiment)]
    if len(given) < len(problem.experiments):
        return problem
    try:
        return _with_long_steps(_with_few_samples(problem, x, given), x)
    except SimulationError:
        return problem


def as_coarse(base: Problem, made: Problem) -> Problem:
    """A problem on the recordings of another one, coarse as these are; as it is where they are not.

    Args:
        base: of the user's model.
        made: of an amended model, from `coarse`.
    """
    experiments = [
        replace(
            e,
            time=there.time,
            measured=there.measured,
            sigma=there.sigma,
            drive=there.drive,
            step=there.step,
            every=there.every,
            merged=there.merged,
            thinned=there.thinned,
            coarse=True,
        )
        for e, there in zip(base.experiments, made.experiments, strict=True)
        if isinstance(e, TimeExperiment) and isinstance(there, TimeExperiment) and there.coarse
    ]
    if len(experiments) < len(base.experiments):
        return base
    found = replace(base, experiments=tuple(experiments), steps=made.steps)
    return resolved(found, np.zeros(len(found.free))) or found


def _with_few_samples(problem: Problem, x: Array, given: Sequence[TimeExperiment]) -> Problem:
    """The problem on as few samples as hide nothing.

    Raises:
        SimulationError: a run diverges.
    """
    count = sum(len(e.time) for e in given if e.role != "hold_out") // COARSE.samples
    if count > 1:
        rows = [problem.simulate(x, e) for e in given]
        while count > 1:
            made = _made(problem, x, given, rows, count)
            if made is not None:
                return made
            count = count * 2 // 3
    return problem


def _with_long_steps(problem: Problem, x: Array) -> Problem:
    """The problem with the longest integration steps whose error stays well below the sensors' noise.

    Where none does, the steps between coarse samples are those between the samples that were recorded, for the models
    that are compared too.

    Raises:
        SimulationError: a run diverges.
    """
    given = [e for e in problem.experiments if isinstance(e, TimeExperiment)]
    fine = [e.residual(problem.simulate(x, e)) for e in given]
    swinging = (COARSE.per_rate, problem.steps.swinging)
    rules = [StepRule(rate, FITTING.stable) for rate in swinging]
    tried = {problem.internal_step}
    for rule in (*rules, StepRule(COARSE.per_rate, COARSE.per_rate), problem.steps):
        parts = 1
        while parts == 1 or any(e.stepped(parts) is not e for e in given):
            experiments = tuple(replace(e.stepped(parts), coarse=True) for e in given)
            made = resolved(replace(problem, experiments=experiments, steps=rule), x)
            parts *= 2
            if made is None or made.internal_step in tried:
                continue
            tried.add(made.internal_step)
            apart = [_apart(made, x, e, r) for e, r in zip(experiments, fine, strict=True)]
            if all(math.sqrt(float(np.mean(d**2, axis=0).max())) < COARSE.solver for d in apart):
                pairs = zip(experiments, apart, strict=True)
                return replace(made, experiments=tuple(replace(e, measured=e.measured + d * e.sigma) for e, d in pairs))
    finest = tuple(e.stepped(e.every * e.thinned) for e in given)
    changed = any(a is not b for a, b in zip(finest, given, strict=True))
    return replace(problem, experiments=finest) if changed else problem


def _apart(made: Problem, x: Array, e: TimeExperiment, r: Array) -> Array:
    """By how much residuals with fine steps are more than a problem's; infinite where its run diverges."""
    try:
        return np.asarray(r - e.residual(made.simulate(x, e)))
    except SimulationError:
        return np.full_like(r, np.inf)


def _made(
    problem: Problem, x: Array, given: Sequence[TimeExperiment], rows: Sequence[Array], count: int
) -> Problem | None:
    """The problem on every ``count``-th sample; None where that hides too much.

    Args:
        problem: as of `coarse`.
        x: as of `coarse`.
        given: its experiments.
        rows: what the model answers to each.
        count: number of samples.

    Raises:
        SimulationError: a coarse run diverges.
    """
    experiments = []
    for e, answer in zip(given, rows, strict=True):
        r = e.residual(answer)
        there = e.averaged(count)
        if _varies(e, there) > COARSE.varies or _hides(e, r, count):
            return None
        whole = replace(problem, experiments=(there,))
        left = e.smoothed(np.where(np.isfinite(e.measured), r, np.nan), count) * e.sigma
        # The residual of zero samples is what the model answers, as far as it counts.
        known = replace(there, measured=np.zeros_like(there.measured))
        ours = -known.residual(whole.simulate(x, there)) * there.sigma
        size = np.nanmean((there.measured - ours - left) ** 2, axis=0)
        if (size > COARSE.error * np.nanvar(there.measured, axis=0)).any():
            return None
        experiments.append(replace(there, measured=ours + left))
    return replace(problem, experiments=tuple(experiments))


def _varies(e: TimeExperiment, there: TimeExperiment) -> float:
    """The largest share of an input's variance that the mean input does not have."""
    if e.drive is None or there.drive is None:
        return 0.0
    time = np.asarray(e.drive.time, dtype=float)
    given = np.asarray(e.drive.values, dtype=float).reshape(len(time), -1)
    held = np.asarray(there.drive.values, dtype=float)
    place = np.clip((time / there.step + 1e-6).astype(int), 0, len(held) - 1)
    spread = given.var(axis=0)
    return float(np.max(((given - held[place]) ** 2).mean(axis=0) / np.where(spread > 0, spread, 1.0), initial=0.0))


def _hides(e: TimeExperiment, r: Array, count: int) -> bool:
    """Whether much of what a model leaves over, beyond the sensors' noise, is faster than the coarse samples."""
    power = e.components(r) ** 2
    for column in power.T:
        excess, hidden = 0.0, 0.0
        for _, part in e.bands(EVIDENCE.fewest):
            size = part.stop - part.start
            chance = 1 + EVIDENCE.chance * np.sqrt(2 / size)
            left = max(float(column[part].sum()) - chance * size, 0.0)
            excess += left
            hidden += left * (part.stop > len(r) // count)
        if hidden > COARSE.hidden * max(excess, float(len(r))):
            return True
    return False
