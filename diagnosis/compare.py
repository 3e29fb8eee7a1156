"""Simulating what a recording recorded, and the error per signal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis.columns import RecordingError, Vector
from diagnosis.frequency import SineModel, sine_model, sweep
from diagnosis.location import at_hand, location
from diagnosis.loop import check_loop
from diagnosis.match import from_file
from diagnosis.recording import Channel, FrequencyTable, Recording, from_scenario
from diagnosis.starts import starting_values
from engine.assemble import build
from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.files import is_file
from engine.quantity import compatible, factor
from engine.simulate import Drive, simulate
from engine.system import bypass

if TYPE_CHECKING:
    from engine.model import Model
    from scenarios.load import Scenario


@dataclass(frozen=True)
class SignalError:
    """How far a simulated signal is from the recorded one.

    Attributes:
        name, unit: of the signal.
        rmse: root mean square error, in ``unit``.
        nrmse: 100 (1 - |e| / |y - mean y|), per cent; 100 is perfect.
        rms_db, max_db: for frequency tables: 20 log10(simulated / measured) over the rows, root mean square and largest
            magnitude.
        axis: time (s) or frequency (rad/s), shape (n,).
        measured, simulated: shape (n,), in ``unit``.
    """

    name: str
    unit: str
    rmse: float
    nrmse: float
    axis: Vector
    measured: Vector
    simulated: Vector
    rms_db: float | None = None
    max_db: float | None = None

    def numbers(self) -> dict[str, Any]:
        """The errors alone, ready for JSON."""
        found: dict[str, Any] = {"unit": self.unit, "rmse": self.rmse, "nrmse": self.nrmse}
        if self.rms_db is not None:
            found |= {"rms_db": self.rms_db, "max_db": self.max_db, "rows": len(self.axis)}
        # JSON has no infinity: a simulated amplitude of zero, at which no decibel exists, becomes null.
        return {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in found.items()
        }


@dataclass(frozen=True)
class Comparison:
    """A scenario against one recording.

    Attributes:
        scenario, recording: names.
        kind: ``time_series`` or ``frequency_response``.
        signals: errors by signal.
        bypassed: blocks that the recorded input replaces.
        notes: what was matched, left out or assumed, in sentences.
    """

    scenario: str
    recording: str
    kind: str
    signals: dict[str, SignalError]
    bypassed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def numbers(self) -> dict[str, Any]:
        """Everything but the curves, ready for JSON."""
        return {
            "recording": self.recording,
            "kind": self.kind,
            "signals": {name: error.numbers() for name, error in self.signals.items()},
            "bypassed": list(self.bypassed),
            "notes": list(self.notes),
        }


def find_recording(scenario: Scenario, given: str | Path) -> Recording | FrequencyTable:
    """A recording by its name in the scenario, or by file.

    A file that the scenario describes is read as described; any other is matched by column names.

    Raises:
        RecordingError: neither a name nor a file.
    """
    text, path = str(given), Path(given)
    if text in scenario.recordings:
        return from_scenario(scenario, text)
    if is_file(path):
        for name in scenario.recordings:
            declared = location(scenario, name) if at_hand(scenario, name) else Path()
            if is_file(declared) and declared.samefile(path):
                return from_scenario(scenario, name)
        signals, inputs = names_of(scenario)
        return from_file(path, inputs, signals)
    raise RecordingError(
        f"'{text}' is neither a recording of the scenario nor a file",
        Where(scenario.document.file),
        nearest(text, scenario.recordings) if scenario.recordings else "the scenario describes no recordings",
    )


def names_of(scenario: Scenario) -> tuple[dict[str, str], dict[str, str]]:
    """What columns can be called: signals with their unit, and names that stand for an input.

    An input is meant by its own name, or by that of the source that alone feeds it.
    """
    system = scenario.system
    inputs = {end: end for end in system.inputs()}
    for connection in system.connections:
        fed = [end for end in connection.ends if system.is_input(end)]
        for end in connection.ends:
            if fed and end not in fed and system.observable(end) is None:
                block = system.blocks[system.split(end)[0]]
                if not any(port.role != "output" for port in block.ports.values()) and len(fed) == 1:
                    inputs[end] = fed[0]
    return {variable.name: variable.unit for variable in build(system).outputs}, inputs


def compare(
    scenario: Scenario,
    recording: Recording | FrequencyTable | str | Path,
    *,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Simulate a scenario with a recording's own input and measure the error.

    Args:
        scenario: the model.
        recording: a recording, its name in the scenario, or a file.
        progress: is told the share done, from 0 to 1.

    Raises:
        FlexarmError: the recording does not fit the model, or the simulation fails.
    """
    if isinstance(recording, str | Path):
        recording = find_recording(scenario, recording)
    if isinstance(recording, FrequencyTable):
        return _compare_table(scenario, recording, progress)
    return _compare_time(scenario, recording)


def _conversion(channel: Channel, unit: str, where: Where) -> float:
    if channel.unit and unit != "*" and not compatible(channel.unit, unit):
        raise ParameterError(
            f"column '{channel.column}' is in {channel.unit} but '{channel.name}' is in {unit}",
            where,
            "correct the unit, or give a scale with a unit, such as '25.4 mm/V'",
        )
    return factor(channel.unit, unit) if channel.unit and unit != "*" else 1.0


def _place(scenario: Scenario, recording: str, *keys: str) -> Where:
    if recording in scenario.recordings:
        return scenario.where("recordings", recording, *keys)
    return Where(scenario.document.file)


@dataclass(frozen=True)
class Plan:
    """A model that fits a recording: its drive, and what each measurement is multiplied by."""

    model: Model
    drive: Drive | None
    factors: tuple[float, ...]
    dropped: tuple[str, ...]


def plan(scenario: Scenario, recording: Recording, like: Plan | None = None) -> Plan:
    """A model driven and read as a recording was.

    Args:
        scenario: the model.
        recording: what was driven and measured.
        like: the plan of another recording, whose model is taken if the same is driven and measured.

    Raises:
        FlexarmError: names or units that do not fit the scenario.
    """
    driven = [channel.name for channel in recording.drive]
    for end in driven:
        if end not in scenario.system.inputs():
            place = _place(scenario, recording.name, "drive", end)
            raise RecordingError(f"'{end}' is not an input", place, nearest(end, scenario.system.inputs()))
    dropped = bypass(scenario.system, driven)[1] if driven else []
    check_loop(scenario, recording, _place(scenario, recording.name, "loop"))
    names = [*driven, *(channel.name for channel in recording.measurements)]
    if like is not None and names == [v.name for v in (*like.model.inputs, *like.model.outputs)]:
        model = like.model
    else:
        model = _build(scenario, recording.name, driven, recording.measurements, "measurements")
    drive = None
    if driven:
        columns = []
        for channel, variable in zip(recording.drive, model.inputs, strict=True):
            place = _place(scenario, recording.name, "drive", channel.name)
            columns.append(channel.values * _conversion(channel, variable.unit, place))
        drive = Drive(recording.time, np.column_stack(columns), tuple(channel.hold for channel in recording.drive))
    factors = []
    for channel, variable in zip(recording.measurements, model.outputs, strict=True):
        place = _place(scenario, recording.name, "measurements", channel.name)
        factors.append(_conversion(channel, variable.unit, place))
    return Plan(model, drive, tuple(factors), tuple(dropped))


def verify(scenario: Scenario, recording: Recording | FrequencyTable) -> None:
    """Check that a recording's names and units fit the model, without simulating.

    Raises:
        FlexarmError: they do not.
    """
    if isinstance(recording, Recording):
        plan(scenario, recording)
        return
    model = _table_model(scenario, recording).model
    for channel, variable in zip(recording.responses, model.outputs, strict=True):
        _conversion(channel, variable.unit, _place(scenario, recording.name, "response", channel.name))


def _compare_time(scenario: Scenario, recording: Recording) -> Comparison:
    made = plan(scenario, recording)
    notes = list(recording.notes)
    if made.drive is None:
        notes.append("no input was recorded; the scenario's own sources drive the simulation")
    step, exact = grid(recording.time, scenario.simulation.step if scenario.simulation else 1e-3)
    internal = scenario.simulation.internal_step if scenario.simulation else None
    stop = step * exact * (len(recording.time) - 1) if exact else float(recording.time[-1]) + step
    factors = zip(recording.measurements, made.factors, strict=True)
    initial = starting_values(made.model, recording, np.column_stack([c.values * scale for c, scale in factors]))
    if initial:
        notes.append(f"starts at the first sample and its slope, where they are measured: {', '.join(initial)}")
    result = simulate(made.model, stop, step, drive=made.drive, initial=initial, internal_step=internal)
    signals = {}
    for channel, variable, scale in zip(recording.measurements, made.model.outputs, made.factors, strict=True):
        measured = channel.values * scale
        curve = result[variable.name]
        simulated = curve[::exact] if exact else np.interp(recording.time, result.time, curve)
        if channel.from_first:
            simulated = simulated - simulated[0]
        there = np.isfinite(measured)
        signals[variable.name] = _time_error(
            variable.name, variable.unit, recording.time[there], measured[there], simulated[there]
        )
    return Comparison(scenario.name, recording.name, "time_series", signals, made.dropped, tuple(notes))


def _build(scenario: Scenario, recording: str, driven: list[str], channels: tuple[Channel, ...], section: str) -> Model:
    try:
        return scenario.build(driven, [channel.name for channel in channels])
    except FlexarmError as error:
        for channel in channels:
            if f"'{channel.name}' names no" in error.message:
                error.where = _place(scenario, recording, section, channel.name)
        raise


def grid(time: Vector, longest: float) -> tuple[float, int]:
    """Interval of the simulation's rows, and how many make one interval of the recording (0 if it is not uniform).

    Intervals are short fractions or whole nanoseconds, so that rows and samples have a common tick. Instants that are
    missing from an even axis leave rows that meet the others exactly.
    """
    intervals = len(time) - 1
    mean, least = float(time[-1]) / intervals, float(np.diff(time).min())
    for candidate in (float(Fraction(mean).limit_denominator(1_000_000)), round(mean, 9)):
        if candidate > 0 and np.abs(time - candidate * np.arange(intervals + 1)).max() < 1e-6 * mean:
            parts = max(1, math.ceil(candidate / longest - 1e-9))
            return candidate / parts, parts
    for candidate in (float(Fraction(least).limit_denominator(1_000_000)), round(least, 9)):
        if candidate > mean / 20 and np.abs(time - candidate * np.round(time / candidate)).max() < 1e-6 * candidate:
            return candidate / max(1, math.ceil(candidate / longest - 1e-9)), 0
    finest = max(least, mean / 20)
    return max(1e-9, round(min(longest, finest), 9)), 0


def _time_error(name: str, unit: str, time: Vector, measured: Vector, simulated: Vector) -> SignalError:
    error = simulated - measured
    spread = float(np.linalg.norm(measured - measured.mean()))
    return SignalError(
        name,
        unit,
        float(np.sqrt(np.mean(error**2))),
        100 * (1 - float(np.linalg.norm(error)) / spread) if spread > 0 else -math.inf,
        time,
        measured,
        simulated,
    )


def _table_model(scenario: Scenario, table: FrequencyTable) -> SineModel:
    if table.drive not in scenario.system.inputs():
        place = _place(scenario, table.name, "drive")
        raise RecordingError(f"'{table.drive}' is not an input", place, nearest(table.drive, scenario.system.inputs()))
    return sine_model(scenario, table, _place(scenario, table.name, "amplitude"))


def _compare_table(scenario: Scenario, table: FrequencyTable, progress: Callable[[float], None] | None) -> Comparison:
    model = _table_model(scenario, table)
    found = sweep(model, table, progress)
    signals = {}
    for k, channel in enumerate(table.responses):
        unit = model.model.outputs[k].unit
        measured = channel.values * _conversion(channel, unit, _place(scenario, table.name, "response", channel.name))
        simulated = found.amplitudes[:, k]
        with np.errstate(divide="ignore"):
            decibel = 20 * np.log10(simulated / measured)
        plain = _time_error(channel.name, unit, table.frequency, measured, simulated)
        signals[channel.name] = SignalError(
            plain.name,
            plain.unit,
            plain.rmse,
            plain.nrmse,
            table.frequency,
            measured,
            simulated,
            float(np.sqrt(np.mean(decibel**2))),
            float(np.abs(decibel).max()),
        )
    notes = (*table.notes, *found.notes)
    return Comparison(scenario.name, table.name, "frequency_response", signals, model.bypassed, notes)
