"""From recordings to a problem: noise floors, time axes, and which parameters may move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.columns import RecordingError
from diagnosis.compare import Plan, grid, plan
from diagnosis.problem import Array, Experiment, Free, Problem
from diagnosis.recording import Recording
from engine.errors import FlexarmError
from engine.model import Model
from engine.start import start_values
from engine.step import internal_step
from scenarios.load import Scenario

FINEST = 20
"""At most so many internal steps per sample: stiffer models than the data can show are left to diverge."""


def noise(values: Array) -> float:
    """Standard deviation of a channel's noise: its quantum / sqrt(12), or the jitter of its second differences."""
    clean = values[np.isfinite(values)]
    steps = np.abs(np.diff(np.unique(clean)))
    steps = steps[steps > 1e-12 * max(np.abs(clean).max(initial=0.0), 1e-300)]
    quantum = float(steps.min()) if steps.size else 0.0
    if steps.size and np.median(np.abs(steps / quantum - np.round(steps / quantum))) > 1e-3:
        quantum = 0.0
    jitter = np.diff(clean, 2)
    rough = 1.4826 * float(np.median(np.abs(jitter - np.median(jitter)))) / math.sqrt(6) if jitter.size else 0.0
    return math.sqrt(max(quantum**2 / 12, rough**2))


def experiment(made: Plan, recording: Recording, longest: float) -> Experiment:
    """A recording in the form a fit needs.

    Raises:
        RecordingError: its time axis is not uniform.
    """
    step, every = grid(recording.time, longest)
    if not every:
        raise RecordingError(
            f"recording '{recording.name}' has no uniform time axis",
            remedy="resample it, or leave out the irregular part",
        )
    measured = np.column_stack([c.values * f for c, f in zip(recording.measurements, made.factors, strict=True)])
    sigma = []
    for k, channel in enumerate(recording.measurements):
        given = channel.noise * made.factors[k] if channel.noise is not None else noise(measured[:, k])
        if not given > 0:
            raise RecordingError(
                f"the noise of '{channel.name}' in '{recording.name}' cannot be estimated",
                remedy="the signal may be constant; give its standard deviation as 'noise:'",
            )
        sigma.append(given)
    return Experiment(
        recording.name,
        recording.role,
        np.asarray(recording.time),
        step,
        every,
        made.drive,
        measured,
        np.array(sigma),
        tuple(channel.from_first for channel in recording.measurements),
        recording.free,
    )


def free_parameters(model: Model) -> list[Free]:
    """Every parameter with a declared tolerance, moved in units of it."""
    rows = []
    for parameter in model.parameters:
        tolerance, (low, high) = parameter.declared.tolerance, parameter.declared.bounds
        if tolerance is None or parameter.value == 0.0:
            continue
        logarithmic = low >= 0 and parameter.value > 0
        scale = tolerance if logarithmic else tolerance * abs(parameter.value)
        rows.append(Free(parameter.name, parameter.value, scale, logarithmic, low, high))
    return rows


def problem(
    scenario: Scenario, recordings: Sequence[Recording], extra: Sequence[Free] = (), sigma: Array | None = None
) -> Problem:
    """The problem of fitting a scenario to recordings.

    Args:
        scenario: the model.
        recordings: all with the same drives and measurements.
        extra: parameters to free besides those with a tolerance, or in their place where a name is the same.
        sigma: noise of each signal, in place of what the recordings say.

    Raises:
        FlexarmError: recordings that do not fit the scenario, or each other.
    """
    plans = [plan(scenario, recording) for recording in recordings]
    first = plans[0]
    for made, recording in zip(plans, recordings, strict=True):
        if [v.name for v in made.model.outputs] != [v.name for v in first.model.outputs]:
            raise FlexarmError(
                f"recording '{recording.name}' measures other signals than '{recordings[0].name}'",
                remedy="give recordings with the same drive and measurements",
            )
    longest = scenario.simulation.step if scenario.simulation else 1e-3
    experiments = [experiment(m, r, max(longest, 1e-3)) for m, r in zip(plans, recordings, strict=True)]
    if sigma is not None:
        experiments = [replace(e, sigma=sigma) for e in experiments]
    named = {f.name: f for f in free_parameters(first.model)} | {f.name: f for f in extra}
    bounds = {p.name: _within(p.declared.bounds) for p in first.model.parameters}
    free = [
        replace(f, low=max(f.low, bounds[f.name][0]), high=min(f.high, bounds[f.name][1]))
        for f in named.values()
        if f.name in bounds
    ]
    starts = [Free(name, 0.0, 0.05, False, recording=e.name) for e in experiments for name in e.free]
    internal = scenario.simulation.internal_step if scenario.simulation else None
    if internal is None:
        p = first.model.parameter_values
        step = min(e.step for e in experiments)
        internal = max(internal_step(first.model, p, start_values(first.model, p), step), step / FINEST)
    return Problem(scenario, first.model, tuple(experiments), (*free, *starts), internal)


def _within(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds a little inside the declared ones, which may be open."""
    low, high = bounds
    return low + 1e-12 * abs(low), high - 1e-12 * abs(high)
