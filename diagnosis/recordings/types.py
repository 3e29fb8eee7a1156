"""What was recorded, in SI units: signals over time, or a frequency response."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.recordings.columns import Vector
from diagnosis.thresholds import FITTING

Assumed = str | tuple[str, ...]
"""A value that a scenario leaves open: a word, or a list of names."""


@dataclass(frozen=True)
class Channel:
    """A recorded signal.

    Attributes:
        name: the signal or input of the model.
        unit: coherent SI unit of the values; empty if the file states none.
        values: shape (samples,); NaN where a measurement holds no number.
        column: the file's column.
        hold: for a drive, ``zero_order``, ``linear`` or ``band_limited``.
        hold_stated: whether somebody said so.
        tap: for a drive, where it was logged.
        from_first: subtract the first sample; for a measurement, from the simulated signal too.
        noise: standard deviation in ``unit``; None if it is to be estimated.
        logged: ``unit`` over a number as it was logged.
    """

    name: str
    unit: str
    values: Vector
    column: str = ""
    hold: str = "zero_order"
    tap: str = "after_limit"
    from_first: bool = False
    noise: float | None = None
    logged: float = 1.0
    hold_stated: bool = False


@dataclass(frozen=True)
class Recording:
    """Signals over time.

    Attributes:
        name: of the recording.
        file: path of the file.
        time: seconds from the first sample, shape (samples,), strictly increasing.
        drive: inputs of the model.
        measurements: signals to compare with the simulation.
        free: states whose initial value a fit may estimate for this recording.
        starts: starting values by name, as the scenario states them.
        as_measured: begins where its first samples say, and a fit may move that within their noise.
        settings: values of parameters that hold for this recording alone, as the scenario states them.
        loop, role: as the scenario states them.
        stamps: instants as they were logged (s), before they were made even, shape (samples,); None for ``time``.
        clock: what the time column is believed: ``as_logged``, ``even``, or ``either`` while that is open.
        sampled: whether measurements of a row were taken ``before_input`` acts or ``after_input``; ``either`` while
            that is open, which is read as the latter.
        assumed: what was found of the file that the scenario leaves open: keys from the scenario's top -> value.
        described: name under which the scenario describes it, where that is another one.
        spare: further signals, which nothing is fitted to: they tell rivals apart.
        resample: interval (s) at which measurements are compared; None compares every sample.
        notes: sentences that say how the data were changed.
        wraps: sentences on columns that seem to begin anew at the end of a range -> whether anything is fitted to them.
    """

    name: str
    file: str
    time: Vector
    drive: tuple[Channel, ...]
    measurements: tuple[Channel, ...]
    free: tuple[str, ...] = ()
    starts: Mapping[str, Any] = field(default_factory=dict)
    as_measured: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    loop: str = "open"
    role: str = "train"
    notes: tuple[str, ...] = ()
    resample: float | None = None
    stamps: Vector | None = None
    clock: str = "either"
    sampled: str = "either"
    assumed: Mapping[tuple[str, ...], Assumed] = field(default_factory=dict)
    described: str = ""
    spare: tuple[Channel, ...] = ()
    wraps: Mapping[str, bool] = field(default_factory=dict)

    @property
    def noise_stated(self) -> bool:
        """Whether the noise of every signal is stated rather than estimated."""
        return all(channel.noise is not None for channel in self.measurements)

    @property
    def extent(self) -> tuple[int, float]:
        """Number of samples, and duration (s)."""
        return len(self.time), float(self.time[-1])

    def with_spare(self) -> Recording:
        """The recording with its spare signals measured as well, after all others."""
        return replace(self, measurements=(*self.measurements, *self.spare), spare=())

    def split(self, length: float) -> tuple[Recording, Recording] | None:
        """The recording with the measurements of every second stretch of ``length`` seconds, to fit, and with the rest.

        The rest is held out. Both have the samples that tell in which state the recording begins.
        """
        fitted = np.floor(np.asarray(self.time) / length).astype(int) % 2 == 0
        first = np.arange(len(self.time)) < FITTING.first_samples

        def part(name: str, role: str, keep: NDArray[np.bool_]) -> Recording:
            def only(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
                return tuple(replace(c, values=np.where(keep, c.values, np.nan)) for c in channels)

            return replace(
                self,
                name=f"{self.name} ({name} part)",
                role=role,
                measurements=only(self.measurements),
                spare=only(self.spare),
                described=self.described or self.name,
            )

        return part("fitted", "train", fitted), part("held-out", "hold_out", ~fitted | first)


@dataclass(frozen=True)
class FrequencyTable:
    """A frequency response: one row per sine.

    Attributes:
        name, file: as in `Recording`.
        drive: the input that the sine drives.
        frequency: rad/s, shape (rows,).
        amplitude: of the sine, in ``amplitude_unit``, shape (rows,).
        responses: measured amplitudes (half the peak to peak), each of shape (rows,).
        largest_step: upper bound of the integration step (s), or None.
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

    @property
    def noise_stated(self) -> bool:
        """False: the digits of a reading tell its noise better than a statement."""
        return False

    @property
    def extent(self) -> tuple[int, float]:
        """Number of rows, and no duration (NaN)."""
        return len(self.frequency), math.nan

    def split(self, length: float) -> None:
        """None: rows of a table belong to no time."""


Recorded = Recording | FrequencyTable
"""Data for a fit or a comparison."""
