"""What was recorded, in SI units: signals over time, or a frequency response."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.recordings.columns import Vector


@dataclass(frozen=True)
class Channel:
    """A recorded signal.

    Attributes:
        name: the signal or input of the model.
        unit: coherent SI unit of the values; empty if the file states none.
        values: shape (samples,); NaN where a measurement holds no number.
        column: the file's column.
        hold: for a drive, ``zero_order`` or ``linear``.
        tap: for a drive, where it was logged.
        from_first: subtract the first sample; for a measurement, from the simulated signal too.
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
        file: path of the file.
        time: seconds from the first sample, shape (samples,), strictly increasing.
        drive: inputs of the model.
        measurements: signals to compare with the simulation.
        free: states whose initial value a fit may estimate for this recording.
        loop, role: as the scenario states them.
        resample: interval (s) at which measurements are compared; None compares every sample.
        notes: sentences that say how the data were changed.
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


Recorded = Recording | FrequencyTable
"""Data for a fit or a comparison."""
