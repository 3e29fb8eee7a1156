"""A recording as the scenario describes it: columns become signals in SI units, with their sign, scale and noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.checks import LARGEST, checked
from diagnosis.recordings.columns import RecordingError, Vector, read_columns
from diagnosis.recordings.further_files import join_files
from diagnosis.recordings.paths import recording_path
from diagnosis.recordings.reader import Reader
from diagnosis.recordings.time_axis import time_axis, window, with_lead_in
from diagnosis.recordings.types import Channel, FrequencyTable, Recorded, Recording
from diagnosis.recordings.wrapped_numbers import SIGNED, Wrapped, find, outside, signed
from engine.errors import ParameterError, nearest
from engine.ports import MOTION
from engine.quantity import factor, split

if TYPE_CHECKING:
    from scenarios.load import Scenario
    from scenarios.schema import Drive, FrequencyRecording, Measurement, TimeRecording

MADE_UP = 1.5
"""A recording is not compared at instants so many times as close as its samples: a clock may be a little off."""
POSITIONS = frozenset(kind[0][0] for kind in MOTION.values())
"""Signals that a counter or an angle of whole turns may show."""


def from_scenario(scenario: Scenario, name: str) -> Recorded:
    """A recording that the scenario describes.

    Raises:
        FlexarmError: a missing file or column, a unit that does not fit, rows that cannot be used.
    """
    from scenarios.schema import FrequencyRecording

    described = scenario.recordings[name]
    path = ("recordings", name)
    like = (described.frequency if isinstance(described, FrequencyRecording) else described.time).column or ""
    columns = read_columns(recording_path(scenario, name), scenario.where(*path, "file"), like, described.format or "")
    reader = Reader(columns, scenario, path, list(columns.notes))
    if isinstance(described, FrequencyRecording):
        return _table(reader, name, described, scenario)
    return _recording(reader, name, described, scenario)


def _recording(reader: Reader, name: str, described: TimeRecording, scenario: Scenario) -> Recording:
    time, time_column = time_axis(reader, described.time)
    reader.axis = time
    join_files(reader, name, described, scenario, time)
    required: dict[str, Vector] = {time_column: time}
    shared = np.ones(len(time), dtype=bool)
    drive = []
    for end, column in described.drive.items():
        keys = ("drive", end)
        hold = column.hold or "zero_order"
        values = required[column.column] = _driven(reader, column.column, hold, shared, keys)
        scale, unit = reader.factor(column.unit, column.scale, *keys, "unit")
        values = _continuous(reader, column, values, scale, keys)
        values = values - reader.convert(column.offset, column.unit, *keys, "offset")
        if column.enable is not None:
            acts = required[column.enable] = _driven(reader, column.enable, "zero_order", shared, keys)
            values = np.where(acts != 0, values, 0.0)
        drive.append(
            Channel(
                scenario.resolve(end),
                unit,
                values * (scale * column.sign),
                column.column,
                hold,
                column.tap,
                column.zero == "first",
                hold_stated=column.hold is not None,
            )
        )
    told = {signal: _measurement(reader, signal, described, scenario) for signal in described.measurements}
    fitted = [signal for signal in told if described.measurements[signal].use == "fit"]
    if not fitted:
        raise RecordingError(
            f"recording '{name}' has spare columns only, and nothing to fit to",
            reader.where("measurements"),
            "leave 'use: evidence' out of one",
        )
    resample = reader.positive(described.resample, "s", "resample") if described.resample is not None else None
    apart = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if resample is not None and apart > MADE_UP * resample:
        raise RecordingError(
            f"resample is {resample:g} s, where samples are {apart:g} s apart: what lies between was not measured",
            reader.where("resample"),
            "give a longer time, or leave it out",
        )
    recording = Recording(
        name,
        reader.columns.file,
        time,
        tuple(drive),
        tuple(told[signal] for signal in fitted),
        tuple(scenario.resolve(signal) for signal in described.initial.free),
        {scenario.resolve(signal): value for signal, value in described.initial.values.items()},
        described.initial.state == "as_measured",
        dict(described.set),
        described.loop,
        described.role,
        resample=resample,
        clock=described.time.clock,
        sampled=described.sampled,
        spare=tuple(channel for signal, channel in told.items() if signal not in fitted),
    )
    within = window(reader, described, time)
    if not shared.all():
        reader.notes.append(f"{int((within & ~shared).sum())} rows lie before or after what the drive's file holds")
        within &= shared
        if not within.any():
            raise RecordingError(
                f"the files of recording '{name}' have no time in common", reader.where("files"), "check their offsets"
            )
    recording = checked(recording, reader, required, time_column, skip_gaps=described.gaps == "skip", within=within)
    return with_lead_in(recording, described.lead_in)


def _driven(reader: Reader, column: str, hold: str, shared: NDArray[np.bool_], keys: tuple[str, ...]) -> Vector:
    """A column that drives, in the rows of the recording; those that its file does not reach leave ``shared``."""
    values, clock = reader.column(column, *keys), reader.clock(column)
    if clock is None or reader.axis is None:
        return values
    if hold == "zero_order":
        made = clock.held(values, reader.axis)
    elif hold == "linear":
        made = clock.straight(values, reader.axis)
    else:
        raise RecordingError(
            f"column '{column}' is of another clock, and a band-limited drive cannot be joined",
            reader.where(*keys, "hold"),
            "let the file of the drive lead, or write 'hold: linear'",
        )
    there = np.flatnonzero(np.isfinite(made))
    shared[: there[0] if len(there) else None] = False
    shared[there[-1] + 1 if len(there) else 0 :] = False
    return made


def _measurement(reader: Reader, signal: str, described: TimeRecording, scenario: Scenario) -> Channel:
    """A measured column in SI units."""
    column, keys = described.measurements[signal], ("measurements", signal)
    values = reader.column(column.column, *keys)
    if column.counts_per_rev is not None:
        scale, unit = 2 * math.pi / reader.positive(column.counts_per_rev, "1", *keys, "counts_per_rev"), "rad"
    elif column.unit == "count" and not isinstance(column.scale, str):
        raise RecordingError(
            f"column '{column.column}' is in counts, and the counts per revolution are not given",
            reader.where(*keys, "unit"),
            "add for example 'counts_per_rev: 4096', or a scale with a unit, such as '0.1 mm'",
        )
    else:
        scale, unit = reader.factor(column.unit, column.scale, *keys, "unit")
    offset = reader.convert(column.offset, "" if column.unit == "count" else column.unit, *keys, "offset")
    values = (_continuous(reader, column, values, scale, keys) - offset) * (scale * column.sign)
    clock = reader.clock(column.column)
    if clock is not None and reader.axis is not None:
        values = clock.measured(values, reader.axis)
    noise = None
    if column.noise != "auto":
        noise = abs(scale) * reader.positive(column.noise, column.unit, *keys, "noise")
    return Channel(
        scenario.resolve(signal),
        unit,
        values,
        column.column,
        from_first=column.zero == "first",
        noise=noise,
        logged=abs(scale),
    )


def _continuous(
    reader: Reader, column: Drive | Measurement, values: Vector, scale: float, keys: tuple[str, ...]
) -> Vector:
    """The numbers of a column with their sign, or without the jumps of a counter, as ``wrap:`` says.

    Where it says nothing and they look like either, that is noted.
    """
    if column.wrap is False:
        moves = keys[0] == "measurements" and keys[1].rpartition(".")[2] in POSITIONS
        if (wrapped := find(values, turns=moves)) is not None:
            reader.wraps[_told(reader, column.column, wrapped)] = getattr(column, "use", "fit") == "fit"
        return values
    where = reader.where(*keys, "wrap")
    if isinstance(column.wrap, str) and column.wrap.lstrip("u").startswith("int"):
        if column.wrap not in SIGNED:
            raise RecordingError(f"'{column.wrap}' is no kind of signed number", where, nearest(column.wrap, SIGNED))
        wrong = outside(values, column.wrap)
        if wrong.any():
            raise RecordingError(
                f"column '{column.column}' is said to hold signed numbers of {SIGNED[column.wrap]} bits, and holds "
                f"{values[wrong][0]:g} in {reader.rows(wrong)}",
                where,
                f"give another of {', '.join(SIGNED)}, or the range of a counter, such as 65536",
            )
        return signed(values, column.wrap)
    period = 2 * math.pi / abs(scale)
    if column.wrap is not True:
        period = reader.convert(column.wrap, "" if column.unit == "count" else column.unit, *keys, "wrap")
    if not period > 0:
        raise RecordingError(f"a range of {column.wrap}", where, "give one above zero")
    finite = np.isfinite(values)
    made = values.copy()
    made[finite] = np.unwrap(values[finite], period=period)
    return made


def _told(reader: Reader, column: str, wrapped: Wrapped) -> str:
    """A sentence on a column that seems to have wrapped, with what to write."""
    count = int(wrapped.after.sum())
    times = f"column '{column}' jumps {count} time{'s' if count > 1 else ''}"
    if not wrapped.word:
        return (
            f"{times} by its range of {wrapped.name}, {reader.rows(wrapped.after)}: does a counter or an angle begin "
            f"anew there? Write 'wrap: {wrapped.size:.9g}'"
        )
    bits = SIGNED[wrapped.word]
    return (
        f"{times} between numbers near 0 and near {wrapped.size - 1:.0f}, {reader.rows(wrapped.after)}: are these "
        f"signed numbers of {bits} bits that were read without their sign? Write 'wrap: {wrapped.word}', or "
        f"'wrap: {wrapped.size:.0f}' if a counter turned over"
    )


def _table(reader: Reader, name: str, described: FrequencyRecording, scenario: Scenario) -> FrequencyTable:
    frequency = reader.column(described.frequency.column, "frequency")
    try:
        frequency = frequency * factor(described.frequency.unit, "rad/s")
    except ParameterError as error:
        raise error.at(scenario.where("recordings", name, "frequency", "unit")) from None
    required = {described.frequency.column: frequency}
    amplitude, amplitude_unit = _amplitude(reader, described, len(frequency), required)
    responses = []
    for signal, column in described.response.items():
        keys = ("response", signal)
        required[column.column] = values = reader.column(column.column, *keys)
        scale, unit = reader.factor(column.unit, column.scale, *keys)
        noise = None
        if column.noise != "auto":
            noise = abs(scale) * reader.positive(column.noise, column.unit, *keys, "noise")
        responses.append(Channel(scenario.resolve(signal), unit, values * scale, column.column, noise=noise))
    for name_of_column, values in required.items():
        wrong = ~((np.nan_to_num(values) > 1 / LARGEST) & (values < LARGEST))
        if wrong.any():
            raise RecordingError(
                f"column '{name_of_column}' holds no number between {1 / LARGEST:g} and {LARGEST:g} "
                f"in {reader.rows(wrong)}",
                reader.first(wrong),
                "repair or remove the rows",
            )
    step = None
    if described.internal_step is not None:
        step = reader.convert(described.internal_step, "s", "internal_step")
    return FrequencyTable(
        name,
        reader.columns.file,
        scenario.resolve(described.drive),
        frequency,
        amplitude,
        amplitude_unit,
        tuple(responses),
        step,
        described.role,
        tuple(reader.notes),
    )


def _amplitude(
    reader: Reader, described: FrequencyRecording, rows: int, required: dict[str, Vector]
) -> tuple[Vector, str]:
    """Amplitude of each row, shape (rows,), and its SI unit; its column, if there is one, joins ``required``."""
    given = described.amplitude
    if (given.column is None) == (given.value is None):
        raise RecordingError(
            "the amplitude needs either a column or a value", reader.where("amplitude"), "give one of them"
        )
    if given.column is not None:
        values = required[given.column] = reader.column(given.column, "amplitude")
        scale, unit = reader.factor(given.unit, 1.0, "amplitude")
        return values * scale, unit
    number, stated = split(given.value if isinstance(given.value, str) else f"{given.value} {given.unit}")
    scale, unit = reader.factor(stated, 1.0, "amplitude")
    return np.full(rows, number * scale), unit
