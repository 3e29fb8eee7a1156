"""Damping ratios of several modes from evolving spectra (the waterfall method).

The record is cut into windows of length Tw at hops dt. Each is tapered, padded with zeros and transformed; the largest
magnitude within +-15 % of a mode's frequency f_j is its amplitude X_jk in window k. A mode decays as exp(-xi w t) from
window to window whatever the taper, so

    xi_j = -slope of ln X_jk over t_k (least squares over k) / (2 pi f_j)

and from the first and the last window alone, eq (9c): xi_j = ln(X_j1 / X_jk) / (2 pi f_j (t_k - t_1)).

f_j is in Hz: dividing the slope by the frequency in Hz, without 2 pi, gives ratios 6.28 times too large. Here f_j is
the natural frequency that the record itself shows: the damped one f_d from the advance of phase between windows, and
f_j^2 = f_d^2 + (slope / 2 pi)^2.

Limits: Tw f_1 >= 1.5, and modes further apart than 2 / Tw; otherwise a window does not separate the mode from rest or
from its neighbour. A filter in the measuring chain changes amplitudes but not their decay.
Source: A. Mohan, S. P. Singh, S. K. Saha, section 3.2.1.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.decay.decay_laws import Envelopes, envelopes
from diagnosis.decay.record import SMALLEST_FALL, DampingWarning, DecayRecord, decay_record
from diagnosis.decay.spectrum import VISIBLE, find_lines
from diagnosis.decay.straight_line import Line, fit_line
from diagnosis.decay.windows import BAND, Windows, cut_windows, require_line
from diagnosis.recordings.columns import RecordingError, Vector
from engine.errors import ParameterError

LEAST_CYCLES = 1.5
"""Smallest number of periods of the slowest mode in a window."""

MOST_WINDOWS = 400
"""Largest number of windows by default."""

FADED = 0.01
"""A mode is followed until it has fallen to this fraction of its amplitude in the first window."""

DIES = 3.0
"""Fall of the logarithm of the amplitude within one window, above which noise decides the scatter."""


@dataclass(frozen=True)
class ModeDecay:
    """One mode of a waterfall.

    Attributes:
        given: frequency about which the mode was sought (Hz).
        frequency: natural frequency that the record shows (Hz); ``given`` if the window cannot resolve the mode.
        ratio: damping ratio xi, least squares over the windows.
        standard_error, interval: of the ratio; the interval covers 95 %. From the scatter about the line, or from the
            noise of the record (which windows that overlap share) where that is larger.
        two_point: ratio from the first and the last window used alone.
        slope: of ln X over time (1/s).
        intercept: of the line at time 0, X in the signal's unit.
        amplitudes: of the mode in each window, in the signal's unit (2 |FFT| / sum of the taper), shape (windows,).
        used: number of windows, from the first, in which the mode is above the noise and 1 % of its first amplitude.
        envelopes: laws of decay fitted to the amplitudes; None if fewer than five windows are used.
        reliable: False if a warning says that the window cannot resolve this mode.
    """

    given: float
    frequency: float
    ratio: float
    standard_error: float
    interval: tuple[float, float]
    two_point: float
    slope: float
    intercept: float
    amplitudes: Vector
    used: int
    envelopes: Envelopes | None
    reliable: bool


@dataclass(frozen=True)
class Waterfall:
    """Evolving spectra of a decay and the damping they show.

    Attributes:
        modes: in the order of the frequencies asked for.
        times: begin of each window (s), shape (windows,).
        window, hop: s.
        taper: ``hann`` or ``rectangular``.
        axis: frequencies (Hz), up to four times that of the highest mode, shape (bins,).
        spectra: 2 |FFT| / sum of the taper, in the signal's unit, shape (windows, bins).
        rest: value removed from the signal.
        noise: standard deviation of the record's noise.
        unit: of the signal.
        warnings: sentences that say why the estimates are doubtful.
    """

    modes: tuple[ModeDecay, ...]
    times: Vector
    window: float
    hop: float
    taper: str
    axis: Vector
    spectra: Vector
    rest: float
    noise: float
    unit: str = ""
    warnings: tuple[str, ...] = ()


def evolving_spectra(
    time: Vector | DecayRecord,
    values: Vector | None = None,
    frequencies: Sequence[float] | None = None,
    *,
    window: float | None = None,
    hop: float | None = None,
    windows: int | None = None,
    taper: str = "hann",
    start: float = 0.0,
    rest: float | None = None,
) -> Waterfall:
    """Estimate the damping ratio of each mode from windows that move along the record.

    Args:
        time: s, shape (samples,), or a `DecayRecord`.
        values: the signal, shape (samples,); not with a record.
        frequencies: of the modes (Hz), to within 15 %; the lines of the spectrum if None.
        window: length Tw (s); by default three periods of the slowest mode or 2.2 / distance of the closest modes,
            whichever is longer, and less in a short record.
        hop: from one window to the next (s); by default an eighth of the window, and more in a long record.
        windows: number of windows; by default as many as the record holds.
        taper: ``hann`` or ``rectangular``.
        start: begin of the first window (s).
        rest: value about which the signal swings; found if None.

    Raises:
        RecordingError: a mode that is not in the record or does not decay, or a record too short for the windows.
        ParameterError: a setting out of range.

    Warns:
        DampingWarning: the window is too short to hold the slowest mode or to separate two modes, or a mode dies
            within it.
    """
    record = time if isinstance(time, DecayRecord) else decay_record(time, np.asarray(values))
    modes = tuple(frequencies) if frequencies else find_lines(record, start=start)
    _check_frequencies(record, modes)
    window = _default_window(record, modes, start) if window is None else window
    if hop is None:
        hop = max(window / 8, (record.length - start - window) / MOST_WINDOWS) if windows is None else window / 8
    cut = cut_windows(record, modes, window, hop, windows, start, taper, rest)
    found = _window_warnings(modes, cut.length)
    decays = []
    for frequency in modes:
        mode, sentences = _mode(cut, frequency, modes)
        decays.append(mode)
        found += sentences
    for sentence in found:
        warnings.warn(sentence, DampingWarning, stacklevel=2)
    return Waterfall(
        tuple(decays),
        cut.times,
        cut.length,
        float(cut.times[1] - cut.times[0]),
        taper,
        cut.axis,
        np.abs(cut.transforms) * cut.scale,
        cut.rest,
        cut.noise,
        record.unit,
        tuple(found),
    )


def _default_window(record: DecayRecord, modes: Sequence[float], start: float) -> float:
    """Three periods of the slowest mode or 2.2 / distance of the closest; the least possible in a short record."""
    ordered = sorted(modes)
    closest = min((high - low for low, high in itertools.pairwise(ordered)), default=math.inf)
    needed = max(LEAST_CYCLES / ordered[0], 2 / closest) + record.step
    return max(min(max(3 / ordered[0], 2.2 / closest), (record.length - start) / 2), needed)


def _check_frequencies(record: DecayRecord, modes: Sequence[float]) -> None:
    limit = 0.5 / record.step / (1 + BAND)
    for frequency in modes:
        if not 0 < frequency <= limit:
            raise RecordingError(
                f"{frequency:g} Hz is not in the record: samples {record.step:g} s apart hold 0 to {limit:.4g} Hz",
                remedy="frequencies are in Hz",
            )
    if len(set(modes)) != len(modes):
        raise ParameterError("the same frequency is given twice", remedy="give each mode once")


def _window_warnings(modes: Sequence[float], length: float) -> list[str]:
    found = []
    slowest = min(modes)
    if not _long_enough(length, modes):
        found.append(
            f"window too short: {length:.4g} s holds {length * slowest:.2f} periods of the mode at {slowest:.4g} Hz, "
            f"and {LEAST_CYCLES:g} are needed; take {LEAST_CYCLES / slowest:.3g} s or more"
        )
    for low, high in itertools.pairwise(sorted(modes)):
        if high - low < 2 / length:
            found.append(
                f"the modes at {low:.4g} and {high:.4g} Hz are {high - low:.3g} Hz apart, closer than 2 / window = "
                f"{2 / length:.3g} Hz: they are not separated; take {2 / (high - low):.3g} s or more"
            )
    return found


def _long_enough(length: float, modes: Sequence[float]) -> bool:
    return length * min(modes) >= LEAST_CYCLES - 1e-9


def _mode(windows: Windows, frequency: float, modes: Sequence[float]) -> tuple[ModeDecay, list[str]]:
    length = windows.length
    closest = min((abs(frequency - other) for other in modes if other != frequency), default=math.inf)
    reliable = _long_enough(length, modes) and closest >= 2 / length
    if reliable:
        require_line(windows, frequency)
    peak = np.abs(windows.transforms[:, windows.band(frequency)]).max(axis=1)
    dead = np.flatnonzero(peak <= VISIBLE * windows.level)
    faded = np.flatnonzero(peak < FADED * peak[0])
    alive = int(dead[0]) if len(dead) else len(peak)
    used = min(alive, int(faded[0]) if len(faded) else len(peak))
    found = []
    if used == alive < len(peak):
        found.append(
            f"the mode at {frequency:.4g} Hz is lost in the noise after window {used} of {len(peak)}; "
            "the windows that follow are not used"
        )
    if used < 2:
        raise RecordingError(
            f"the mode at {frequency:.4g} Hz is above the noise in {used} of {len(peak)} windows; two are needed",
            remedy="take shorter windows or hops, or begin earlier",
        )
    times = windows.times[:used]
    fitted = fit_line(times, np.log(peak[:used]), windows.covariance(used) / np.outer(peak[:used], peak[:used]))
    span = float(times[-1] - times[0])
    if reliable:
        _require_decay(fitted, span, frequency)
    if -fitted.slope * length > DIES:
        found.append(
            f"the mode at {frequency:.4g} Hz dies within the window (it falls to "
            f"{100 * math.exp(fitted.slope * length):.2g} % in {length:.3g} s): noise decides the scatter; "
            f"windows down to {max(LEAST_CYCLES / min(modes), 2 / closest):.3g} s are allowed"
        )
    natural = _natural_frequency(windows, frequency, used, fitted.slope) if reliable else frequency
    divisor = 2 * math.pi * natural
    half = fitted.half_width / divisor
    ratio = -fitted.slope / divisor
    mode = ModeDecay(
        frequency,
        natural,
        ratio,
        fitted.standard_error / divisor,
        (ratio - half, ratio + half),
        math.log(peak[0] / peak[used - 1]) / (divisor * span),
        fitted.slope,
        fitted.intercept + math.log(windows.scale),
        peak * windows.scale,
        used,
        envelopes(times, peak[:used] * windows.scale, natural, 1 + 2 * span / length),
        reliable,
    )
    return mode, found


def _require_decay(fitted: Line, span: float, frequency: float) -> None:
    fall = -fitted.slope * span
    if fall >= SMALLEST_FALL and -fitted.slope > fitted.half_width:
        return
    what = "grows" if fitted.slope > fitted.half_width and fall < -SMALLEST_FALL else "does not decay"
    raise RecordingError(
        f"the mode at {frequency:.4g} Hz {what}: its amplitude changes by {100 * math.expm1(-fall):+.2g} % "
        f"(uncertain by {100 * fitted.half_width * span:.2g} %) over the {span:.3g} s "
        "between the first and the last window",
        remedy="damping is estimated from free vibration after a release; is the arm still driven, "
        "or are the windows too close together to see the decay?",
    )


def _natural_frequency(windows: Windows, frequency: float, used: int, slope: float) -> float:
    """Natural frequency (Hz) from the advance of phase between windows: X(f) of a decaying sine turns by 2 pi f_d t."""
    band, times = windows.band(frequency), windows.times[:used]
    place = int(band[int(np.argmax(np.abs(windows.transforms[0, band])))])
    nearest = float(windows.axis[place])
    turned = np.unwrap(np.angle(windows.transforms[:used, place] * np.exp(-2j * np.pi * nearest * times)))
    damped = nearest + float(np.polyfit(times, turned, 1)[0]) / (2 * math.pi)
    return math.hypot(damped, slope / (2 * math.pi))
