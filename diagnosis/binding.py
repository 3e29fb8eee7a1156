"""A recording bound to a scenario: the input that it drives, the signals that it is compared with, and their units."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from diagnosis.frequency_response.sine_model import SineModel, sine_model
from diagnosis.recordings.between_samples import BAND_LIMITED, between_samples
from diagnosis.recordings.by_header import from_file
from diagnosis.recordings.columns import RecordingError, Vector
from diagnosis.recordings.feedback import check_loop
from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.paths import is_available, recording_path
from diagnosis.recordings.types import Channel, FrequencyTable, Recorded, Recording
from engine.assemble import build
from engine.casadi_lock import one_at_a_time
from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.files import is_file
from engine.ports import MOTION
from engine.quantity import compatible, convert, factor
from engine.simulate import Drive
from engine.start import starting_names
from engine.system import bypass

if TYPE_CHECKING:
    from engine.model import Model
    from scenarios.load import Scenario


LATER = 1e-9
"""Time (s) after a row at which its input acts where the row was measured before it: the finest that instants have."""


@one_at_a_time
def jumping(model: Model) -> list[int]:
    """Numbers of the outputs that jump with an input, such as an acceleration with a force."""
    e = model.equations
    return sorted(set(ca.jacobian_sparsity(e.outputs, e.u).row()))


@dataclass(frozen=True)
class Binding:
    """A recording over time, bound to a model.

    Attributes:
        model: its inputs are the recorded drives, its outputs the recorded measurements, in the same order.
        drive: the recorded drives in the model's units; None if the scenario's own sources drive the model.
        factors: from each measurement's unit to that of the model's output.
        bypassed: blocks that the recorded drives replace.
        settings: parameters of the model that have another value in this recording (SI).
        starts: starting values that the recording states (SI).
    """

    model: Model
    drive: Drive | None
    factors: tuple[float, ...]
    bypassed: tuple[str, ...]
    settings: dict[str, float] = field(default_factory=dict)
    starts: dict[str, float] = field(default_factory=dict)


def find_recording(scenario: Scenario, given: str | Path) -> Recorded:
    """A recording by its name in the scenario, or by file.

    A file that the scenario describes is read as described; any other is matched by column names.

    Raises:
        RecordingError: neither a name nor a file, or one that cannot be used.
    """
    text, path = str(given), Path(given)
    if text in scenario.recordings:
        return from_scenario(scenario, text)
    if not is_file(path):
        raise RecordingError(
            f"'{text}' is neither a recording of the scenario nor a file",
            Where(scenario.document.file),
            nearest(text, scenario.recordings) if scenario.recordings else "the scenario describes no recordings",
        )
    for name in scenario.recordings:
        described = recording_path(scenario, name) if is_available(scenario, name) else Path()
        if is_file(described) and described.samefile(path):
            return from_scenario(scenario, name)
    signals, inputs = names_of(scenario)
    return from_file(path, inputs, signals)


def names_of(scenario: Scenario) -> tuple[dict[str, str], dict[str, str]]:
    """Names that a column may have: each signal with its unit, and each name that stands for an input.

    An input is called by its own name, or by that of a source that feeds it alone.
    """
    system = scenario.system
    inputs = {end: end for end in system.inputs()}
    for connection in system.connections:
        fed = [end for end in connection.ends if system.is_input(end)]
        for end in connection.ends:
            if len(fed) == 1 and end not in fed and system.observable(end) is None:
                block = system.blocks[system.split(end)[0]]
                if all(port.role == "output" for port in block.ports.values()):
                    inputs[end] = fed[0]
    return {variable.name: variable.unit for variable in build(system).outputs}, inputs


def bind(scenario: Scenario, recording: Recording, like: Binding | None = None) -> Binding:
    """A model that is driven and read as a recording was.

    Args:
        scenario: the model.
        recording: what was driven and measured.
        like: the binding of another recording, whose model is taken if the same signals are driven and measured.

    Raises:
        FlexarmError: names or units that do not fit the scenario.
    """
    driven = [channel.name for channel in recording.drive]
    for end in driven:
        _check_input(scenario, end, _place(scenario, recording.name, "drive", end))
    bypassed = bypass(scenario.system, driven)[1] if driven else []
    check_loop(scenario, recording, _place(scenario, recording.name, "loop"))
    names = [*driven, *(channel.name for channel in recording.measurements)]
    if like is not None and names == [v.name for v in (*like.model.inputs, *like.model.outputs)]:
        model = like.model
    else:
        with _placed(scenario, recording.name, "measurements", recording.measurements):
            model = scenario.build(driven, [channel.name for channel in recording.measurements], smooth_readings=True)
    drive = None
    if driven:
        columns = []
        for channel, variable in zip(recording.drive, model.inputs, strict=True):
            place = _place(scenario, recording.name, "drive", channel.name)
            columns.append(channel.values * conversion(channel, variable.unit, place))
        holds = tuple(channel.hold for channel in recording.drive)
        try:
            time, values = between_samples(np.asarray(recording.time), np.column_stack(columns), holds)
        except RecordingError as error:
            raise error.at(_place(scenario, recording.name, "drive")) from None
        if recording.sampled == "before_input":
            time = time + LATER
        drive = Drive(time, values, tuple("linear" if hold == BAND_LIMITED else hold for hold in holds))
    factors = []
    for channel, variable in zip(recording.measurements, model.outputs, strict=True):
        place = _place(scenario, recording.name, "measurements", channel.name)
        factors.append(conversion(channel, variable.unit, place))
    settings, starts = _settings(scenario, model, recording), _starts(scenario, model, recording)
    return Binding(model, drive, tuple(factors), tuple(bypassed), settings, starts)


def bind_table(scenario: Scenario, table: FrequencyTable) -> tuple[SineModel, tuple[float, ...]]:
    """The model with a sine on the table's input, and the factor of each response to the unit of the model's output.

    Raises:
        FlexarmError: names or units that do not fit the scenario.
    """
    _check_input(scenario, table.drive, _place(scenario, table.name, "drive"))
    with _placed(scenario, table.name, "response", table.responses):
        driven = sine_model(scenario, table, _place(scenario, table.name, "amplitude"))
    factors = (
        conversion(channel, variable.unit, _place(scenario, table.name, "response", channel.name))
        for channel, variable in zip(table.responses, driven.model.outputs, strict=True)
    )
    return driven, tuple(factors)


def verify(scenario: Scenario, recording: Recorded) -> None:
    """Check that a recording's names and units fit the model, without simulating.

    Raises:
        FlexarmError: they do not.
    """
    if isinstance(recording, Recording):
        bind(scenario, recording.with_spare())
    else:
        bind_table(scenario, recording)


def conversion(channel: Channel, unit: str, where: Where) -> float:
    """Factor from a channel's unit to that of a signal; 1 if one of them is not known or any (``*``).

    Raises:
        ParameterError: the units measure different quantities.
    """
    if not channel.unit or unit == "*":
        return 1.0
    if not compatible(channel.unit, unit):
        raise ParameterError(
            f"column '{channel.column}' is in {channel.unit} but '{channel.name}' is in {unit}",
            where,
            "correct the unit, or give a scale with a unit, such as '25.4 mm/V'",
        )
    return factor(channel.unit, unit)


def row_interval(time: Vector, longest: float) -> tuple[float, int]:
    """Interval of the simulated rows (s), and their number per recorded interval (0 if the time axis is uneven).

    Intervals are fractions with small denominators or whole nanoseconds, so that rows and samples share instants. On an
    uneven axis the rows are simulated where the samples are, and no integration step exceeds the interval given here.

    Args:
        time: of the samples (s), shape (samples,).
        longest: upper bound of the interval (s).
    """
    intervals = len(time) - 1
    mean = float(time[-1]) / intervals
    for candidate in (float(Fraction(mean).limit_denominator(1_000_000)), round(mean, 9)):
        if candidate > 0 and np.abs(time - candidate * np.arange(intervals + 1)).max() < 1e-6 * mean:
            parts = max(1, math.ceil(candidate / longest - 1e-9))
            return candidate / parts, parts
    usual = float(np.median(np.diff(time)))
    return max(1e-9, round(usual / max(1, math.ceil(usual / longest - 1e-9)), 9)), 0


def starting_unit(scenario: Scenario, model: Model, name: str) -> str:
    """Unit of a starting value: of a state, or of the motion of a flange; empty for anything else."""
    units = {state.name: state.unit for state in model.states}
    motion = scenario.system_observable(name) if name not in units else None
    if motion is None:
        return units.get(name, "")
    block, flange, order = motion
    return MOTION[scenario.system.blocks[block].ports[flange].kind][order][1]


def _starts(scenario: Scenario, model: Model, recording: Recording) -> dict[str, float]:
    """Starting values that a recording states, in SI units.

    Raises:
        ParameterError: no such starting value, or one of another unit.
    """
    made, known = {}, starting_names(model)
    for name, value in recording.starts.items():
        where = _place(scenario, recording.name, "initial", "values")
        if name not in known:
            raise ParameterError(f"'{name}' has no starting value", where, nearest(name, known))
        try:
            made[name] = convert(value, starting_unit(scenario, model, name))
        except ParameterError as error:
            raise error.at(where) from None
    return made


def _settings(scenario: Scenario, model: Model, recording: Recording) -> dict[str, float]:
    """Parameters that a recording sets, by the model's own names.

    Raises:
        ParameterError: the model has no such parameter, or it does not take the value.
    """
    made = {}
    known = {parameter.name: parameter for parameter in model.parameters}
    for given, value in recording.settings.items():
        where = _place(scenario, recording.name, "set", given)
        block, _, parameter = given.rpartition(".")
        law = scenario.system.shared.get(block, {}).get(parameter, given)
        if not isinstance(law, str):
            shown = " and ".join(f"'{name}'" for name in law.arguments)
            raise ParameterError(f"'{given}' is {law.text}", where, f"set what it follows: {shown}")
        name = law
        if name not in known:
            raise ParameterError(f"'{given}' is no number that the model depends on", where, nearest(given, known))
        try:
            made[name] = known[name].declared.check(convert(value, known[name].unit))
        except ParameterError as error:
            raise error.at(where) from None
    return made


def _check_input(scenario: Scenario, name: str, where: Where) -> None:
    inputs = scenario.system.inputs()
    if name not in inputs:
        raise RecordingError(f"'{name}' is not an input", where, nearest(name, inputs))


def _place(scenario: Scenario, recording: str, *keys: str) -> Where:
    """The place of a key of a recording's description; the scenario if it does not describe the recording."""
    if recording in scenario.recordings:
        return scenario.where("recordings", recording, *keys)
    return Where(scenario.document.file)


@contextlib.contextmanager
def _placed(scenario: Scenario, recording: str, section: str, channels: Sequence[Channel]) -> Iterator[None]:
    """Give an error about a channel's signal the place where the recording names it."""
    try:
        yield
    except FlexarmError as error:
        if error.signal in [channel.name for channel in channels]:
            error.where = _place(scenario, recording, section, error.signal)
        raise
