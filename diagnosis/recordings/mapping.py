"""Recordings: what was measured, in SI units on a checked time axis, and frequency-response tables."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import Columns, RecordingError, Vector, read_columns
from diagnosis.recordings.paths import location
from diagnosis.recordings.time_axis import led_in, steadied, time_axis, window
from engine.errors import ParameterError, Where
from engine.quantity import coherent, convert, factor, split
from engine.simulate import SHORTEST

if TYPE_CHECKING:
    from scenarios.load import Scenario
    from scenarios.schema import FrequencyRecording, TimeRecording


LARGEST = 1e100
"""Values beyond it, whose squares no sum can hold, are refused; a range below its inverse counts as constant."""


@dataclass(frozen=True)
class Channel:
    """A recorded signal.

    Attributes:
        name: the signal or input of the model.
        unit: coherent SI unit of the values; empty if the file does not say.
        values: shape (samples,); NaN where a measurement holds no number.
        column: where it came from.
        hold: for a drive, ``zero_order`` or ``linear``.
        tap: for a drive, where it was logged.
        from_first: count from the first sample, here and, for a measurement, in the simulation.
        noise: standard deviation in ``unit``; None if it is to be estimated.
    """

    name: str
    unit: str
    values: Vector
    column: str = ""
    hold: str = "zero_order"
    tap: str = "after_limit"
    from_first: bool = False
    noise: float | None = None


@dataclass(frozen=True)
class Recording:
    """Signals over time.

    Attributes:
        name: of the recording.
        file: where it was read.
        time: seconds from the first sample, shape (samples,), rising.
        drive: inputs of the model.
        measurements: signals to compare.
        free: states that a fit may choose for this recording.
        loop, role: as the scenario states them.
        resample: interval (s) at which measurements are compared; None compares every sample.
        notes: what was done to the data, in sentences.
    """

    name: str
    file: str
    time: Vector
    drive: tuple[Channel, ...]
    measurements: tuple[Channel, ...]
    free: tuple[str, ...] = ()
    loop: str = "open"
    role: str = "train"
    notes: tuple[str, ...] = ()
    resample: float | None = None


@dataclass(frozen=True)
class FrequencyTable:
    """A frequency response: one row per sine.

    Attributes:
        name, file: as in `Recording`.
        drive: the input that the sine drives.
        frequency: rad/s, shape (rows,).
        amplitude: of the sine, in ``amplitude_unit``, shape (rows,).
        responses: measured amplitudes (half the peak to peak), each of shape (rows,).
        largest_step: bound on the integration step (s), or None.
    """

    name: str
    file: str
    drive: str
    frequency: Vector
    amplitude: Vector
    amplitude_unit: str
    responses: tuple[Channel, ...]
    largest_step: float | None = None
    role: str = "train"
    notes: tuple[str, ...] = ()


Recorded = Recording | FrequencyTable
"""What a fit or a comparison takes."""


@dataclass
class Reader:
    """One file and the place in the scenario that describes it."""

    columns: Columns
    scenario: Scenario | None = None
    path: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)

    def where(self, *keys: str) -> Where | None:
        """The place of a key of the recording's description."""
        return self.scenario.where(*self.path, *keys) if self.scenario is not None else None

    def column(self, name: str, *keys: str) -> Vector:
        """A column as numbers; ``keys`` lead to what asks for it."""
        return self.columns.number(name, self.where(*keys, "column"))

    def factor(self, unit: str, scale: Any, *keys: str) -> tuple[float, str]:
        """Factor to SI, and the SI unit, of a column in ``unit`` that is multiplied by ``scale``."""
        try:
            number, scale_unit = split(scale) if isinstance(scale, str) else (float(scale), "")
            combined = f"({scale_unit})*({unit})" if scale_unit else unit
            conversion, spelled = coherent(combined) if combined else (1.0, "")
        except ParameterError as error:
            raise error.at(self.where(*keys) or Where(self.columns.file)) from None
        return number * conversion, spelled

    def rows(self, bad: NDArray[np.bool_]) -> str:
        """The rows that are marked, as text."""
        numbers = self.columns.rows[bad]
        shown = ", ".join(str(number) for number in numbers[:8])
        more = f" and {len(numbers) - 8} more" if len(numbers) > 8 else ""
        return f"{self.columns.row}{'s' if len(numbers) > 1 else ''} {shown}{more}"

    def convert(self, value: object, unit: str, *keys: str) -> float:
        """A value of the description as a number in ``unit``."""
        try:
            return convert(value, unit)
        except ParameterError as error:
            raise error.at(self.where(*keys) or Where(self.columns.file)) from None

    def first(self, bad: NDArray[np.bool_]) -> Where:
        """The place of the first marked row."""
        return Where(self.columns.file, int(self.columns.rows[bad][0]))


def from_scenario(scenario: Scenario, name: str) -> Recording | FrequencyTable:
    """A recording that the scenario maps.

    Raises:
        FlexarmError: a missing file or column, a unit that does not fit, rows that cannot be used.
    """
    from scenarios.schema import FrequencyRecording

    made = scenario.recordings[name]
    path = ("recordings", name)
    like = (made.frequency if isinstance(made, FrequencyRecording) else made.time).column or ""
    columns = read_columns(location(scenario, name), scenario.where(*path, "file"), like)
    reader = Reader(columns, scenario, path)
    if isinstance(made, FrequencyRecording):
        return _frequency(reader, name, made, scenario)
    return _time(reader, name, made, scenario)


def _time(reader: Reader, name: str, made: TimeRecording, scenario: Scenario) -> Recording:
    time, time_column = time_axis(reader, made)
    raw: dict[str, Vector] = {time_column: time}
    drives, measured = [], []
    for end, given in made.drive.items():
        keys = ("drive", end)
        values = raw[given.column] = reader.column(given.column, *keys)
        scale, si_unit = reader.factor(given.unit, given.scale, *keys, "unit")
        values = values * (scale * given.sign)
        channel = Channel(scenario.resolve(end), si_unit, values, given.column, given.hold, given.tap)
        drives.append(replace(channel, from_first=given.zero == "first"))
    for signal, meant in made.measurements.items():
        keys = ("measurements", signal)
        values = reader.column(meant.column, *keys)
        if meant.counts_per_rev is not None:
            scale, si_unit = 2 * math.pi / reader.convert(meant.counts_per_rev, "1", *keys, "counts_per_rev"), "rad"
        elif meant.unit == "count" and not isinstance(meant.scale, str):
            raise RecordingError(
                f"column '{meant.column}' is in counts, and how many make a revolution is not said",
                reader.where(*keys, "unit"),
                "add for example 'counts_per_rev: 4096', or a scale with a unit, such as '0.1 mm'",
            )
        else:
            scale, si_unit = reader.factor(meant.unit, meant.scale, *keys, "unit")
        values = values * (scale * meant.sign)
        if meant.wrap:
            finite = np.isfinite(values)
            values = values.copy()
            values[finite] = np.unwrap(values[finite])
        noise = None
        if meant.noise != "auto":
            noise = abs(scale) * reader.convert(meant.noise, meant.unit, *keys, "noise")
        channel = Channel(scenario.resolve(signal), si_unit, values, meant.column)
        measured.append(replace(channel, from_first=meant.zero == "first", noise=noise))
    resample = reader.convert(made.resample, "s", "resample") if made.resample is not None else None
    if resample is not None and not resample > 0:
        raise RecordingError(f"resample is {resample:g} s", reader.where("resample"), "give a time above zero")
    recording = Recording(
        name,
        reader.columns.file,
        time,
        tuple(drives),
        tuple(measured),
        tuple(made.initial.free),
        made.loop,
        made.role,
        resample=resample,
    )
    keep = window(reader, made, time)
    return led_in(checked(recording, reader, made.gaps == "skip", raw, time_column, keep), made.lead_in)


def checked(
    recording: Recording,
    reader: Reader,
    skip: bool,
    raw: dict[str, Vector],
    time_column: str,
    within: NDArray[np.bool_] | None = None,
) -> Recording:
    """The recording with gaps refused or skipped, time rising and starting from zero, and no dead column.

    Args:
        recording: as read.
        reader: its file.
        skip: leave out rows with holes in ``raw``, which are refused otherwise.
        raw: columns that must hold a number in every row; holes in other measurements stay, as NaN.
        time_column: what the time is called.
        within: rows to use, all if None.
    """
    within = np.ones(len(reader.columns), dtype=bool) if within is None else within
    bad = np.zeros(len(reader.columns), dtype=bool)
    for column, values in raw.items():
        holes = ~np.isfinite(values) & within
        if holes.any() and not skip:
            raise RecordingError(
                f"column '{column}' holds no finite number in {reader.rows(holes)}",
                reader.first(holes),
                "repair the rows, or write 'gaps: skip' in the recording to leave them out",
            )
        bad |= holes
    if bad.any():
        reader.notes.append(f"{int(bad.sum())} of {len(bad)} rows hold no number and are left out: {reader.rows(bad)}")
    keep = ~bad & within
    time, rows = recording.time[keep], reader.columns.rows[keep]
    if len(time) < 2:
        raise RecordingError(
            f"{len(time)} usable row{'s' if len(time) != 1 else ''}; a recording needs at least two",
            Where(reader.columns.file),
            "is it cut off, or are all other rows gaps?",
        )
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if len(wrong):
        i = int(wrong[0]) + 1
        what = "runs backwards" if time[i] < time[i - 1] else "stands still"
        raise RecordingError(
            f"time {what} in column '{time_column}', {reader.columns.row} {rows[i]}: "
            f"{time[i]:g} s after {time[i - 1]:g} s",
            Where(reader.columns.file, int(rows[i])),
            "sort the rows, or give each sample its own time",
        )
    interval = (time[-1] - time[0]) / (len(time) - 1)
    if not SHORTEST <= interval < math.inf:
        raise RecordingError(
            f"samples are {interval:.3g} s apart in column '{time_column}'",
            Where(reader.columns.file),
            f"intervals of at least {SHORTEST:g} s can be simulated; is the unit of the time right?",
        )
    for channel in (*recording.drive, *recording.measurements):
        large = (np.abs(channel.values) > LARGEST) & np.isfinite(channel.values) & keep
        if large.any():
            raise RecordingError(
                f"column '{channel.column}' holds more than {LARGEST:g} {channel.unit} in {reader.rows(large)}",
                reader.first(large),
                "is the unit right?",
            )
    measured = []
    for channel in recording.measurements:
        values = _measured(channel, channel.values[keep], reader, keep)
        if channel.from_first:
            values = values - values[0]
        measured.append(replace(channel, values=values))
    if time[0] != 0:
        reader.notes.append(f"time begins at {time[0]:g} s in the file and is counted from there")
    time, said = steadied(time - time[0])
    drives = [(channel, channel.values[keep]) for channel in recording.drive]
    return replace(
        recording,
        time=time,
        drive=tuple(replace(c, values=values - values[0] if c.from_first else values) for c, values in drives),
        measurements=tuple(measured),
        notes=(*recording.notes, *reader.notes, *said),
    )


def _measured(channel: Channel, values: Vector, reader: Reader, keep: NDArray[np.bool_]) -> Vector:
    """The values of a measurement with NaN where it holds no number, reported."""
    holes = ~np.isfinite(values)
    finite = values[~holes]
    if not finite.size:
        raise RecordingError(
            f"column '{channel.column}' holds no number",
            Where(reader.columns.file),
            f"leave '{channel.name}' out of the measurements",
        )
    if np.ptp(finite) <= 1 / LARGEST:
        raise RecordingError(
            f"column '{channel.column}' is constant ({finite[0]:g} {channel.unit} in all {len(finite)} rows), "
            "so there is nothing to compare",
            Where(reader.columns.file),
            f"leave '{channel.name}' out of the measurements",
        )
    if holes.any():
        marked = np.zeros(len(keep), dtype=bool)
        marked[np.flatnonzero(keep)[holes]] = True
        reader.notes.append(
            f"column '{channel.column}' holds no number in {int(holes.sum())} of {len(holes)} rows, "
            f"where it is not compared: {reader.rows(marked)}"
        )
        values = np.where(holes, np.nan, values)
        if channel.from_first and holes[0]:
            raise RecordingError(
                f"column '{channel.column}' counts from its first sample, which holds no number",
                reader.first(marked),
                "leave the first rows out with 'window:', or write 'zero: none'",
            )
    return values


def _frequency(reader: Reader, name: str, made: FrequencyRecording, scenario: Scenario) -> FrequencyTable:
    where = scenario.where
    frequency = reader.column(made.frequency.column, "frequency")
    try:
        frequency = frequency * factor(made.frequency.unit, "rad/s")
    except ParameterError as error:
        raise error.at(where("recordings", name, "frequency", "unit")) from None
    raw = {made.frequency.column: frequency}
    given = made.amplitude
    if (given.column is None) == (given.value is None):
        raise RecordingError(
            "the amplitude needs either a column or a value", where("recordings", name, "amplitude"), "give one of them"
        )
    if given.column is not None:
        raw[given.column] = amplitude = reader.column(given.column, "amplitude")
        scale, amplitude_unit = reader.factor(given.unit, 1.0, "amplitude")
        amplitude = amplitude * scale
    else:
        text = given.value if isinstance(given.value, str) else f"{given.value} {given.unit}"
        number, unit = split(text)
        scale, amplitude_unit = reader.factor(unit, 1.0, "amplitude")
        amplitude = np.full(len(frequency), number * scale)
    responses = []
    for signal, meant in made.response.items():
        raw[meant.column] = values = reader.column(meant.column, "response", signal)
        scale, unit = reader.factor(meant.unit, meant.scale, "response", signal)
        noise = None
        if meant.noise != "auto":
            noise = abs(scale) * reader.convert(meant.noise, meant.unit, "response", signal, "noise")
        responses.append(Channel(scenario.resolve(signal), unit, values * scale, meant.column, noise=noise))
    for column, values in raw.items():
        wrong = ~((np.nan_to_num(values) > 1 / LARGEST) & (values < LARGEST))
        if wrong.any():
            raise RecordingError(
                f"column '{column}' holds no positive number, or one out of all proportion, in {reader.rows(wrong)}",
                reader.first(wrong),
                "repair or remove the rows",
            )
    step = None
    if made.internal_step is not None:
        step = reader.convert(made.internal_step, "s", "internal_step")
    return FrequencyTable(
        name,
        reader.columns.file,
        scenario.resolve(made.drive),
        frequency,
        amplitude,
        amplitude_unit,
        tuple(responses),
        step,
        made.role,
        tuple(reader.notes),
    )
