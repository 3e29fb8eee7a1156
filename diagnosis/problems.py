"""From recordings to a problem: noise floors, time axes, and which parameters may move."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from diagnosis.binding import Binding, bind, jumping, row_interval
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.initial_states import Statics, free_starts
from diagnosis.estimation.parameters import Array, FreeParameter, free_parameters
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.frequency_response.table_experiment import prepared
from diagnosis.recordings.columns import RecordingError
from diagnosis.recordings.feedback import plant_inputs
from diagnosis.recordings.noise import noise, spikes
from diagnosis.recordings.types import FrequencyTable, Recorded, Recording
from diagnosis.thresholds import FITTING
from engine.errors import FlexarmError, ParameterError, SimulationError, Where
from engine.model import Model
from engine.ports import MOTION
from engine.start import start_values
from engine.step import FOLLOWED, StepRule, eigenvalues, internal_step, step_for, stiffest
from scenarios.amend import Edit
from scenarios.load import Scenario
from scenarios.variant import edited, renamed


def experiment(made: Binding, recording: Recording, longest: float, statics: Statics) -> TimeExperiment:
    """A recording in the form a fit needs.

    An uneven time axis stays as it is: the model is simulated at the recorded instants.

    Raises:
        RecordingError: too many samples, an unknown starting value, or noise that cannot be estimated.
    """
    if len(recording.time) > FITTING.most_samples:
        raise RecordingError(
            f"recording '{recording.name}' has {len(recording.time)} samples, and a fit simulates all of them some "
            f"hundred times; at most {FITTING.most_samples} are taken",
            remedy="choose a part with 'window: [from, until]' in the recording, or store it at longer intervals",
        )
    step, every = row_interval(recording.time, longest)
    measured = np.column_stack([c.values * f for c, f in zip(recording.measurements, made.factors, strict=True)])
    if recording.sampled != "after_input":
        # What acted before the first row is not known. It counts in neither reading, so that the two compare.
        measured[0, jumping(made.model)] = np.nan
    sigma, outliers = [], []
    drives = [channel.values for channel in recording.drive]
    for k, channel in enumerate(recording.measurements):
        if channel.noise is not None:
            given = channel.noise * made.factors[k]
        else:
            given = noise(np.asarray(recording.time), measured[:, k], drives).sigma
        wrong = outlying(recording, made.model.outputs[k].unit, measured[:, k], given)
        measured[wrong, k] = np.nan
        outliers.append(int(wrong.sum()))
        if not given > 0:
            raise RecordingError(
                f"the noise of '{channel.name}' in '{recording.name}' cannot be estimated",
                remedy="the signal may be constant; give its standard deviation as 'noise:'",
            )
        sigma.append(given)
    time = np.asarray(recording.time)
    found = TimeExperiment(
        name=recording.name,
        role=recording.role,
        time=time,
        step=step,
        every=every or max(1, round(float(time[-1]) / (len(time) - 1) / step)),
        drive=made.drive,
        measured=measured,
        sigma=np.array(sigma),
        from_first=tuple(channel.from_first for channel in recording.measurements),
        free=recording.free,
        uneven=not every,
        outliers=tuple(outliers),
        logged=tuple(c.logged * f for c, f in zip(recording.measurements, made.factors, strict=True)),
        loop=recording.loop,
        assumed=recording.assumed,
        wraps=recording.wraps,
        noise_stated=tuple(channel.noise is not None for channel in recording.measurements),
        stated=made.starts,
        settings=made.settings,
    ).on_model(statics, as_measured=recording.as_measured)
    return found if recording.resample is None else resampled(found, recording.resample)


def outlying(recording: Recording, unit: str, values: Array, sigma: float) -> NDArray[np.bool_]:
    """Samples of a position or a speed that are spikes; none of other signals, such as an acceleration, which may jump.

    Args:
        recording: whose instants are those of the samples.
        unit: of the signal.
        values: shape (samples,).
        sigma: standard deviation of the noise.
    """
    moves = unit in {unit for kind in MOTION.values() for _, unit in kind[:2]}
    if not moves or not sigma > 0:
        return np.zeros(len(values), dtype=bool)
    return spikes(np.asarray(recording.time), values, sigma)


def resampled(given: TimeExperiment, interval: float) -> TimeExperiment:
    """The experiment compared at other instants: every n-th of its samples, or interpolated between them.

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


def problem(scenario: Scenario, recordings: Sequence[Recorded]) -> Problem:
    """The problem of fitting a scenario to recordings, each prepared once.

    Args:
        scenario: the model.
        recordings: all over time, or all tables, with the same drives and measurements.

    Raises:
        FlexarmError: recordings that do not fit the scenario, or each other.
    """
    tables = [r for r in recordings if isinstance(r, FrequencyTable)]
    experiments: Sequence[Experiment]
    if len(tables) == len(recordings):
        model, experiments = prepared(scenario, tables)
    elif tables:
        raise FlexarmError(
            f"'{tables[0].name}' is a frequency-response table and others are recordings over time",
            remedy="fit tables and recordings over time one after the other",
        )
    else:
        model, experiments = _over_time(scenario, [r for r in recordings if isinstance(r, Recording)])
    reference = bool(plant_inputs(scenario.system, [v.name for v in model.inputs]))
    posed = replace(_pose(scenario, model, experiments, scenario.tolerances_of(model)), reference=reference)
    return counted_as_noise(followed(posed, np.zeros(len(posed.free))))


def counted_as_noise(made: Problem) -> Problem:
    """The problem with what the steps of encoders do in their loops counted as noise of the other sensors.

    A controller that reads an encoder passes its steps on to the machine. The model reads the line through them, since
    when they come hangs on a hair: how far they move the outputs, with the parameters given, nobody can foretell. What
    a recorded reading is rounded by is in its own noise already.
    """
    model, scenario = made.model, made.scenario
    if not model.readings:
        return made
    names = [v.name for v in model.outputs]
    stepping = scenario.build([v.name for v in model.inputs], names)
    read = np.array([scenario.resolve(name).rpartition(".")[0] in model.readings for name in names])
    rows: list[Experiment] = []
    for e in over_time(made.experiments):
        values, starts = made.values(np.zeros(len(made.free)), e)
        try:
            steps, line = (e.outputs(m, values, starts, made.internal_step) for m in (stepping, model))
        except (ParameterError, SimulationError):
            rows.append(e)  # with the parameters given it runs away
            continue
        moved = np.nan_to_num(np.std(e.sampled(steps) - e.sampled(line), axis=0))
        rows.append(replace(e, sigma=np.where(read, np.maximum(e.sigma, moved), np.hypot(e.sigma, moved))))
    return replace(made, experiments=tuple(rows))


def variant(
    base: Problem, edits: Sequence[Edit], extra: Sequence[FreeParameter] = (), held: Collection[str] = ()
) -> Problem:
    """A problem with edits applied to its scenario, in memory; its recordings are used as they are prepared.

    Args:
        base: of the user's scenario.
        edits: to the scenario.
        extra: parameters to free besides those with a tolerance, or in their place where a name is the same.
        held: parameters that stay as they are, whatever tolerance is declared.

    Raises:
        FlexarmError: the amended model has no meaning.
    """
    scenario = edited(base.scenario, edits)
    inputs = renamed([v.name for v in base.model.inputs], edits)
    outputs = renamed([v.name for v in base.model.outputs], edits)
    model, experiments = base.experiments[0].on_variant(scenario, inputs, outputs, base.experiments)
    made = _pose(scenario, model, experiments, scenario.tolerances, extra, held, base.steps)
    return replace(made, reference=base.reference)


def _pose(
    scenario: Scenario,
    model: Model,
    experiments: Sequence[Experiment],
    tolerances: Mapping[str, float],
    extra: Sequence[FreeParameter] = (),
    held: Collection[str] = (),
    steps: StepRule = FOLLOWED,
) -> Problem:
    named = {f.name: f for f in free_parameters(model, tolerances)} | {f.name: f for f in extra}
    bounds = {p.name: _within(p.declared.bounds) for p in model.parameters}
    free = [
        replace(f, low=max(f.low, bounds[f.name][0]), high=min(f.high, bounds[f.name][1]))
        for f in named.values()
        if f.name in bounds and f.name not in held
    ]
    for f in free:
        try:
            model.parameters[model.parameter_index(f.name)].check_free(
                "a fit", f"hold it: 'tolerances: {{{f.name}: 0}}', or declare a parameter for each"
            )
        except ParameterError as error:
            raise error.at(Where(scenario.document.file)) from None
    starts = [start for e in experiments for start in free_starts(e)]
    whole = Problem(scenario, model, tuple(experiments), (*free, *starts), steps=steps)
    return resolved(whole, np.zeros(len(whole.free))) or whole


def _over_time(scenario: Scenario, recordings: Sequence[Recording]) -> tuple[Model, list[TimeExperiment]]:
    """The model, and recordings over time as experiments."""
    first = bind(scenario, recordings[0])
    bindings = [first, *(bind(scenario, recording, first) for recording in recordings[1:])]
    for made, recording in zip(bindings, recordings, strict=True):
        if [v.name for v in made.model.outputs] != [v.name for v in first.model.outputs]:
            raise FlexarmError(
                f"recording '{recording.name}' measures other signals than '{recordings[0].name}'",
                remedy="give recordings with the same drive and measurements",
            )
    longest = scenario.simulation.step if scenario.simulation else 1e-3
    # Models of one build serve several recordings; so do their statics.
    statics = {id(made.model): Statics(made.model) for made in bindings}
    return first.model, [
        experiment(made, recording, max(longest, 1e-3), statics[id(made.model)])
        for made, recording in zip(bindings, recordings, strict=True)
    ]


def resolved(made: Problem, x: Array) -> Problem | None:
    """The problem with an integration step that suits its parameters at ``x``; None if none can follow them."""
    asked = made.scenario.simulation.internal_step if made.scenario.simulation else None
    if asked is not None:
        return replace(made, internal_step=asked)
    steps = [(e.longest_step, e.finest_step) for e in made.experiments if e.longest_step and e.finest_step]
    if not steps:
        return made
    model, values = made.model, made.values(x)[0]
    step, least = (min(column) for column in zip(*steps, strict=True))
    settings = {tuple(sorted(e.settings.items())) for e in made.experiments}
    finest = step
    for changed in sorted(settings):
        p = model.parameter_vector({**values, **dict(changed)})
        spectra = eigenvalues(model, p, start_values(model, p))
        if any(float(np.abs(rates).max()) * least > FITTING.stable for rates in spectra):
            return None
        finest = min(finest, step_for(spectra, step, rule=made.steps))
    return replace(made, internal_step=max(finest, least))


def followed(made: Problem, x: Array) -> Problem:
    """The problem with an integration step that suits its parameters at ``x`` wherever they take it.

    A spring that hardens is soft where a run begins, and many times as stiff where it is twisted most: the step of its
    soft beginning would leave an error that looks like physics.
    """
    model = made.model
    asked = made.scenario.simulation.internal_step if made.scenario.simulation else None
    if asked is not None or made.internal_step is None or not model.stiffens:
        return made
    step, values = made.internal_step, made.values(x)[0]
    for e in over_time(made.training or made.experiments):
        p = model.parameter_vector({**values, **e.settings})
        tried, states = step, None
        while states is None:
            try:
                states = e.visited(model, *made.values(x, e), tried)
            except (ParameterError, SimulationError):
                if tried / 2 < e.finest_step:
                    break  # it runs away whatever the step
                tried /= 2  # as stiff as it becomes, this step was too long
        else:
            stiff = internal_step(model, p, stiffest(model, p, states), tried, rule=made.steps)
            step = max(stiff, min(tried, e.finest_step))
    return replace(made, internal_step=step)


def _within(bounds: tuple[float, float]) -> tuple[float, float]:
    """Bounds a little inside the declared ones, which may be open."""
    low, high = bounds
    return low + 1e-12 * abs(low), high - 1e-12 * abs(high)
