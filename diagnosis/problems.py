"""From recordings to a problem: noise floors, time axes, and which parameters may move."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from diagnosis.compare import Plan, grid, plan
from diagnosis.estimation.initial_states import free_starts, starting_values
from diagnosis.estimation.problem import Array, Experiment, FreeParameter, Problem
from diagnosis.frequency_response.table_experiment import TableExperiment, prepared
from diagnosis.recordings.columns import RecordingError
from diagnosis.recordings.mapping import FrequencyTable, Recorded, Recording
from engine.errors import FlexarmError, ParameterError, nearest
from engine.model import Model
from engine.quantity import convert
from engine.start import start_values
from engine.step import fastest, internal_step
from scenarios.load import Scenario

MOST_SAMPLES = 1_000_000
"""Samples of one recording that a fit takes."""

FINEST = 8
"""At most so many internal steps per sample: what moves faster than they can follow, the data cannot show."""

STABLE = 2.0
"""A mode is integrated stably while its rate times the step stays below this."""


def noise(values: Array) -> float:
    """Standard deviation of a channel's noise: its quantum / sqrt(12), or the jitter of its second differences."""
    clean = values[np.isfinite(values)]
    steps = np.abs(np.diff(np.unique(clean)))
    steps = steps[steps > 1e-12 * max(np.abs(clean).max(initial=0.0), 1e-300)]
    quantum = float(steps.min()) if steps.size else 0.0
    if steps.size and np.median(np.abs(steps / quantum - np.round(steps / quantum))) > 1e-3:
        quantum = 0.0
    jitter = np.diff(clean, 2)
    if quantum == 0.0:
        jitter = jitter[jitter != 0.0]  # where a sensor is at the end of its range it shows no noise
    rough = 1.4826 * float(np.median(np.abs(jitter - np.median(jitter)))) / math.sqrt(6) if jitter.size else 0.0
    return math.sqrt(max(quantum**2 / 12, rough**2))


def experiment(made: Plan, recording: Recording, longest: float) -> Experiment:
    """A recording in the form a fit needs.

    An uneven time axis stays as it is: the model is simulated on a finer even grid and read at the recorded instants.

    Raises:
        RecordingError: too many samples, an unknown starting value, or noise that cannot be estimated.
    """
    if len(recording.time) > MOST_SAMPLES:
        raise RecordingError(
            f"recording '{recording.name}' has {len(recording.time)} samples, and a fit simulates all of them some "
            f"hundred times; at most {MOST_SAMPLES} are taken",
            remedy="choose a part with 'window: [from, until]' in the recording, or store it at longer intervals",
        )
    step, every = grid(recording.time, longest)
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
    time = np.asarray(recording.time)
    found = Experiment(
        recording.name,
        recording.role,
        time,
        step,
        every or max(1, round(float(time[-1]) / (len(time) - 1) / step)),
        made.drive,
        measured,
        np.array(sigma),
        tuple(channel.from_first for channel in recording.measurements),
        recording.free,
        starting_values(made.model, recording, measured),
        uneven=not every,
    )
    return found if recording.resample is None else resampled(found, recording.resample)


def resampled(given: Experiment, interval: float) -> Experiment:
    """The experiment compared at other instants: every so many of its samples, or interpolated between them.

    The drive keeps every sample.
    """
    sample = given.step * given.every
    skip = round(interval / sample)
    if not given.uneven and skip >= 1 and abs(skip * sample - interval) < 1e-6 * sample:
        return replace(given, time=given.time[::skip], measured=given.measured[::skip], every=given.every * skip)
    parts = max(1, math.ceil(interval / given.step - 1e-9))
    step = float(Fraction(interval / parts).limit_denominator(10**9))
    time = np.arange(int(given.time[-1] / (step * parts) + 1e-9) + 1, dtype=np.float64) * np.float64(step * parts)
    columns = [np.interp(time, given.time, column) for column in given.measured.T]
    return replace(given, time=time, measured=np.column_stack(columns), step=step, every=parts, uneven=False)


def free_parameters(model: Model, tolerances: Mapping[str, float]) -> list[FreeParameter]:
    """Every parameter with a tolerance, that of ``tolerances`` or the declared one, moved in units of it."""
    rows = []
    for parameter in model.parameters:
        tolerance, (low, high) = parameter.declared.tolerance, parameter.declared.bounds
        tolerance = tolerances.get(parameter.name, tolerance)
        if not tolerance or parameter.value == 0.0:
            continue
        logarithmic = low >= 0 and parameter.value > 0
        scale = tolerance if logarithmic else tolerance * abs(parameter.value)
        rows.append(FreeParameter(parameter.name, parameter.value, scale, logarithmic, low, high))
    return rows


def problem(
    scenario: Scenario,
    recordings: Sequence[Recorded],
    extra: Sequence[FreeParameter] = (),
    sigma: Array | None = None,
    held: Collection[str] = (),
) -> Problem:
    """The problem of fitting a scenario to recordings.

    Args:
        scenario: the model.
        recordings: all over time, or all tables, with the same drives and measurements.
        extra: parameters to free besides those with a tolerance, or in their place where a name is the same.
        sigma: noise of each signal, in place of what the recordings say.
        held: parameters that stay as they are, whatever tolerance is declared.

    Raises:
        FlexarmError: recordings that do not fit the scenario, or each other.
    """
    tables = [r for r in recordings if isinstance(r, FrequencyTable)]
    if len(tables) == len(recordings):
        model, experiments = prepared(scenario, tables)
    elif tables:
        raise FlexarmError(
            f"'{tables[0].name}' is a frequency-response table and others are recordings over time",
            remedy="fit tables and recordings over time one after the other",
        )
    else:
        model, experiments = _over_time(scenario, [r for r in recordings if isinstance(r, Recording)])
    if sigma is not None:
        experiments = [replace(e, sigma=sigma) for e in experiments]
    tolerances = _tolerances(scenario, None if extra else model)
    named = {f.name: f for f in free_parameters(model, tolerances)} | {f.name: f for f in extra}
    bounds = {p.name: _within(p.declared.bounds) for p in model.parameters}
    free = [
        replace(f, low=max(f.low, bounds[f.name][0]), high=min(f.high, bounds[f.name][1]))
        for f in named.values()
        if f.name in bounds and f.name not in held
    ]
    starts = [start for e in experiments for start in free_starts(e)]
    whole = Problem(scenario, model, tuple(experiments), (*free, *starts))
    return resolved(whole, np.zeros(len(whole.free))) or whole


def _tolerances(scenario: Scenario, model: Model | None) -> dict[str, float]:
    """Tolerances that the scenario states, by parameter; the names are checked where a model is given."""
    found = {}
    for name, given in scenario.file.tolerances.items():
        where = scenario.where("tolerances", name)
        known = [p.name for p in model.parameters] if model else [name]
        if name not in known:
            raise ParameterError(f"the model has no parameter '{name}'", where, nearest(name, known))
        try:
            found[name] = convert(given, "1")
        except ParameterError as error:
            raise error.at(where) from None
        if not 0 <= found[name] < math.inf:
            raise ParameterError(f"a tolerance of {given}", where, "give a share such as 0.1, or 0 for a known value")
    return found


def _over_time(scenario: Scenario, recordings: Sequence[Recording]) -> tuple[Model, list[Experiment]]:
    """The model, and recordings over time as experiments."""
    first = plan(scenario, recordings[0])
    plans = [first, *(plan(scenario, recording, first) for recording in recordings[1:])]
    for made, recording in zip(plans, recordings, strict=True):
        if [v.name for v in made.model.outputs] != [v.name for v in first.model.outputs]:
            raise FlexarmError(
                f"recording '{recording.name}' measures other signals than '{recordings[0].name}'",
                remedy="give recordings with the same drive and measurements",
            )
    longest = scenario.simulation.step if scenario.simulation else 1e-3
    return first.model, [experiment(m, r, max(longest, 1e-3)) for m, r in zip(plans, recordings, strict=True)]


def resolved(made: Problem, x: Array) -> Problem | None:
    """The problem with an integration step that suits its parameters at ``x``; None if none can follow them."""
    asked = made.scenario.simulation.internal_step if made.scenario.simulation else None
    if asked is not None:
        return replace(made, internal_step=asked)
    if any(isinstance(e, TableExperiment) for e in made.experiments):
        return made
    model, step = made.model, min(e.step for e in made.experiments)
    p = model.parameter_vector(made.values(x)[0])
    start = start_values(model, p)
    if fastest(model, p, start).rate * step / FINEST > STABLE:
        return None
    return replace(made, internal_step=max(internal_step(model, p, start, step), step / FINEST))


def _within(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds a little inside the declared ones, which may be open."""
    low, high = bounds
    return low + 1e-12 * abs(low), high - 1e-12 * abs(high)
