"""A scenario simulated with a recording's drive, and the error of each signal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis.binding import bind, bind_table, find_recording, row_interval, starting_unit
from diagnosis.estimation.held_out_starts import with_held_out_starts
from diagnosis.estimation.time_experiment import over_time
from diagnosis.frequency_response.periodic_solver import PeriodicSolver
from diagnosis.problems import problem
from diagnosis.recordings.checks import check_moving
from diagnosis.recordings.columns import Vector
from diagnosis.recordings.types import FrequencyTable, Recorded, Recording
from engine.simulate import simulate

if TYPE_CHECKING:
    from scenarios.load import Scenario


@dataclass(frozen=True)
class SignalError:
    """The error of a simulated signal against the recorded one.

    Attributes:
        name, unit: of the signal.
        rmse: root mean square error, in ``unit``.
        nrmse: 100 (1 - |e| / |y - mean y|), per cent; 100 is perfect.
        rms_db, max_db: for frequency tables: 20 log10(simulated / measured) over the rows, root mean square and largest
            magnitude.
        axis: time (s) or frequency (rad/s), shape (n,).
        measured, simulated: shape (n,), in ``unit``.
        amplitude: for frequency tables: of the input's sine at each row, in the comparison's ``amplitude_unit``.
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
    amplitude: Vector = field(default_factory=lambda: np.zeros(0))

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
        amplitude_unit: for frequency tables: that of the sine at the input.
    """

    scenario: str
    recording: str
    kind: str
    signals: dict[str, SignalError]
    bypassed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    amplitude_unit: str = ""

    def numbers(self) -> dict[str, Any]:
        """Everything but the curves, ready for JSON."""
        return {
            "recording": self.recording,
            "kind": self.kind,
            "signals": {name: error.numbers() for name, error in self.signals.items()},
            "bypassed": list(self.bypassed),
            "notes": list(self.notes),
        }


def compare(
    scenario: Scenario,
    recording: Recorded | str | Path,
    *,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Simulate a scenario with a recording's own drive and measure the error.

    Args:
        scenario: the model.
        recording: a recording, its name in the scenario, or a file.
        progress: called with the fraction done, from 0 to 1.

    Raises:
        FlexarmError: the recording does not fit the model, a measurement of one that is given by name or file never
            changes, or the simulation fails.
    """
    found = recording
    if isinstance(found, str | Path):
        found = find_recording(scenario, found)
        check_moving([found])
    if isinstance(found, FrequencyTable):
        return _compare_table(scenario, found, progress)
    return _compare_time(scenario, found)


def _compare_time(scenario: Scenario, recording: Recording) -> Comparison:
    binding = bind(scenario, recording)
    model, notes = binding.model, list(recording.notes)
    if binding.drive is None:
        notes.append("no input was recorded; the scenario's own sources drive the simulation")
    step, exact = row_interval(recording.time, scenario.simulation.step if scenario.simulation else 1e-3)
    internal = scenario.simulation.internal_step if scenario.simulation else None
    if internal is None and model.stiffens:
        internal = problem(scenario, [recording]).internal_step  # as a fit takes it
    stop = step * exact * (len(recording.time) - 1) if exact else float(recording.time[-1])
    data = np.column_stack([c.values * f for c, f in zip(recording.measurements, binding.factors, strict=True)])
    initial, note = fitted_start(scenario, recording)
    notes += [note] if note else []
    result = simulate(
        model,
        stop,
        step,
        parameters=binding.settings,
        drive=binding.drive,
        initial=initial,
        internal_step=internal,
        rows=None if exact else recording.time,
    )
    signals = {}
    for channel, variable, measured in zip(recording.measurements, model.outputs, data.T, strict=True):
        curve = result[variable.name]
        simulated = curve[:: exact or 1]
        if channel.from_first:
            simulated = simulated - simulated[0]
        there = np.isfinite(measured)
        signals[variable.name] = _error(
            variable.name, variable.unit, recording.time[there], measured[there], simulated[there]
        )
    return Comparison(scenario.name, recording.name, "time_series", signals, binding.bypassed, tuple(notes))


def fitted_start(scenario: Scenario, recording: Recording) -> tuple[dict[str, float], str]:
    """Starting values of a recording, the free ones fitted to it with the parameters as given; and a note.

    Raises:
        FlexarmError: the recording does not fit the model.
    """
    if not (recording.free or recording.starts or recording.as_measured):
        return {}, ""
    posed = problem(scenario, [replace(recording, role="hold_out")])
    posed = replace(posed, free=tuple(f for f in posed.free if f.recording))
    x = with_held_out_starts(posed, np.zeros(len(posed.free)))
    (e,) = over_time(posed.experiments)
    starts = posed.values(x, e)[1]
    fitted = ", ".join(
        f"{name} = {starts[name]:.5g} {starting_unit(scenario, posed.model, name)}".rstrip() for name in e.free
    )
    note = f"starting values fitted to it, the parameters as given: {fitted}" if fitted else ""
    return e.begin.complete(starts), note


def _compare_table(scenario: Scenario, table: FrequencyTable, progress: Callable[[float], None] | None) -> Comparison:
    driven, factors = bind_table(scenario, table)
    plain = scenario.build([table.drive], [channel.name for channel in table.responses])
    solver = PeriodicSolver(plain, driven, table.largest_step)
    solutions = solver.solve({}, table.frequency, table.amplitude, {}, progress)
    amplitudes = np.array([solution.amplitudes for solution in solutions])
    signals = {}
    for k, (channel, variable) in enumerate(zip(table.responses, plain.outputs, strict=True)):
        measured, simulated = channel.values * factors[k], amplitudes[:, k]
        with np.errstate(divide="ignore"):
            decibel = 20 * np.log10(simulated / measured)
        signals[channel.name] = replace(
            _error(channel.name, variable.unit, table.frequency, measured, simulated),
            rms_db=float(np.sqrt(np.mean(decibel**2))),
            max_db=float(np.abs(decibel).max()),
            amplitude=table.amplitude,
        )
    unsettled = (
        f"at {frequency:g} rad/s the simulated response did not become periodic; its last period is compared"
        for frequency, solution in zip(table.frequency, solutions, strict=True)
        if not solution.settled
    )
    notes = (*table.notes, *unsettled)
    return Comparison(
        scenario.name, table.name, "frequency_response", signals, driven.bypassed, notes, table.amplitude_unit
    )


def _error(name: str, unit: str, axis: Vector, measured: Vector, simulated: Vector) -> SignalError:
    error = simulated - measured
    spread = float(np.linalg.norm(measured - measured.mean()))
    return SignalError(
        name,
        unit,
        float(np.sqrt(np.mean(error**2))),
        100 * (1 - float(np.linalg.norm(error)) / spread) if spread > 0 else -math.inf,
        axis,
        measured,
        simulated,
    )
