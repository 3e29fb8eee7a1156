"""Damping ratio from the peaks of a free decay (logarithmic decrement).

Peaks x_1 ... x_k of one sign, one period apart, of x(t) = X exp(-xi w t) cos(w sqrt(1 - xi^2) t + phase):

    delta = ln(x_1 / x_k) / (k - 1)            xi = delta / sqrt(4 pi^2 + delta^2)

Here delta is the least-squares slope of ln x over the peaks, so that every peak counts; the two-point form is reported
beside it. The form xi ~ delta / (2 pi) of Mohan, Singh and Saha, eq (7b), is high by xi^2 / 2.

Limits: one mode must dominate. With several, take the evolving spectra (`diagnosis.decay.evolving_spectra`).
Source: A. Mohan, S. P. Singh, S. K. Saha, eqs (7a)-(7c).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.decay.decay_laws import Envelopes, envelopes
from diagnosis.decay.record import SMALLEST_FALL, DampingWarning, DecayRecord, decay_record
from diagnosis.decay.spectrum import dominant_frequency, noise_between_lines
from diagnosis.decay.straight_line import fit_line
from diagnosis.recordings.columns import RecordingError, Vector
from engine.errors import ParameterError

NOISE_FLOOR = 5.0
"""Peaks lower than this many standard deviations of the noise are not used."""

SMALLEST_SWING = 1e-3
"""Nor are peaks lower than this fraction of the largest, where the error of the rest value dominates."""


@dataclass(frozen=True)
class Decrement:
    """The damping that the peaks of a decay show.

    Attributes:
        ratio: damping ratio xi, exact form.
        delta: logarithmic decrement per period.
        standard_error, interval: of the ratio; the interval covers 95 %. From the scatter of the peaks about the
            exponential or from the noise of the record, the larger of the two; NaN for two peaks in a record without
            noise.
        two_point: ratio from the first and the last peak alone.
        approximate: delta / (2 pi), the form of Mohan, Singh and Saha.
        frequency: of the oscillation (Hz), damped.
        natural_frequency: frequency / sqrt(1 - xi^2) (Hz).
        rest: value about which the signal swings.
        peak_times, peaks: the peaks used, counted from ``rest``, shape (k,).
        extreme_times, extremes: amplitudes at the extremes of both signs, shape (m,).
        envelopes: laws of decay fitted to the extremes; None if there are too few.
        noise: standard deviation of the record's noise.
        unit: of the signal.
        warnings: sentences that say why the estimate is doubtful.
    """

    ratio: float
    delta: float
    standard_error: float
    interval: tuple[float, float]
    two_point: float
    approximate: float
    frequency: float
    natural_frequency: float
    rest: float
    peak_times: Vector
    peaks: Vector
    extreme_times: Vector
    extremes: Vector
    envelopes: Envelopes | None
    noise: float
    unit: str = ""
    warnings: tuple[str, ...] = ()


def ratio_of(delta: float) -> float:
    """Damping ratio of a logarithmic decrement: xi = delta / sqrt(4 pi^2 + delta^2)."""
    return delta / math.hypot(2 * math.pi, delta)


def decrement_of(ratio: float) -> float:
    """Logarithmic decrement of a damping ratio below 1: delta = 2 pi xi / sqrt(1 - xi^2)."""
    return 2 * math.pi * ratio / math.sqrt(1 - ratio**2)


def logarithmic_decrement(
    time: Vector | DecayRecord,
    values: Vector | None = None,
    *,
    frequency: float | None = None,
    rest: float | None = None,
    sign: int = 1,
    start: float = 0.0,
) -> Decrement:
    """Estimate damping from the peaks of a free decay.

    Args:
        time: s, shape (samples,), or a `DecayRecord`.
        values: the signal, shape (samples,); not with a record.
        frequency: of the oscillation (Hz), roughly; found if None.
        rest: value about which the signal swings; found from the extremes if None.
        sign: 1 for the peaks above rest, -1 for those below.
        start: time (s) at which the decay begins.

    Raises:
        RecordingError: fewer than two peaks above the noise, or no decay.
        ParameterError: a setting out of range.

    Warns:
        DampingWarning: two peaks only, or a decay that is not exponential.
    """
    record = time if isinstance(time, DecayRecord) else decay_record(time, np.asarray(values))
    if frequency is not None and not 0 < frequency < 0.5 / record.step:
        raise ParameterError(
            f"frequency {frequency:g} Hz is not between 0 and {0.5 / record.step:g} Hz, half the sampling rate"
        )
    if rest is not None and not math.isfinite(rest):
        raise ParameterError(f"rest {rest:g} is not a finite number")
    begin = record.first(start)
    y = record.values[begin:]
    guess = dominant_frequency(y, record.step) if frequency is None else frequency
    half = max(1, int(1 / (24 * guess * record.step)))
    times, values_at, kinds = _extremes(y, record.step, guess, half)
    if rest is None:
        rest = _rest(values_at, y)
    noise = noise_between_lines(y - rest, record.step, (guess,))
    swing = kinds * (values_at - rest)
    # The decay ends at the first extreme that noise could have made.
    low = np.flatnonzero(swing <= max(NOISE_FLOOR * noise, SMALLEST_SWING * float(np.abs(y - rest).max())))
    end = int(low[0]) if len(low) else len(swing)
    times, swing, kinds = times[:end] + begin * record.step, swing[:end], kinds[:end]
    chosen = kinds == sign
    peak_times, peaks = times[chosen], swing[chosen]
    if len(peaks) < 2:
        raise RecordingError(
            f"'{record.name}' has {len(peaks)} peak{'s' if len(peaks) != 1 else ''} more than {NOISE_FLOOR:g} standard "
            f"deviations of the noise ({noise:.3g}) {'above' if sign > 0 else 'below'} rest ({rest:g}); "
            "two are needed",
            remedy=_cause(record, y - rest, guess),
        )
    return _estimate(record, rest, noise, _averaging(half), peak_times, peaks, times, swing)


def _averaging(half: int) -> float:
    """Standard deviation at the middle of a least-squares parabola through 2 half + 1 samples, per that of a sample."""
    n = 2 * half + 1
    return math.sqrt(3 * (3 * n**2 - 7) / (4 * n * (n**2 - 4)))


def _estimate(
    record: DecayRecord,
    rest: float,
    noise: float,
    averaging: float,
    peak_times: Vector,
    peaks: Vector,
    times: Vector,
    swing: Vector,
) -> Decrement:
    found: list[str] = []
    cycle = np.arange(len(peaks), dtype=float)
    fitted = fit_line(cycle, np.log(peaks), np.diag((averaging * noise / peaks) ** 2))
    delta = -fitted.slope
    fall = float(delta * (len(peaks) - 1))
    if delta <= 0 or fall < SMALLEST_FALL or (len(peaks) > 2 and delta <= fitted.half_width):
        what = "grows" if -fall > SMALLEST_FALL and -delta > fitted.half_width else "does not decay"
        raise RecordingError(
            f"'{record.name}' {what}: its {len(peaks)} peaks go from {peaks[0]:.4g} to {peaks[-1]:.4g} "
            f"(logarithm {-fall:+.2g}, uncertain by {fitted.half_width * (len(peaks) - 1):.2g})",
            remedy="damping is estimated from free vibration after a release; is the arm still driven, "
            "or the record too short to see the decay?",
        )
    ratio, two = ratio_of(delta), ratio_of(math.log(peaks[0] / peaks[-1]) / (len(peaks) - 1))
    period = float(peak_times[-1] - peak_times[0]) / (len(peaks) - 1)
    slope = 4 * math.pi**2 / math.hypot(2 * math.pi, delta) ** 3  # d xi / d delta
    error, half = slope * fitted.standard_error, slope * fitted.half_width
    if len(peaks) == 2:
        found.append("two peaks only: the decay law cannot be checked, and the scatter is that of the noise alone")
        error, half = (error, half) if noise > 1e-12 * peaks[0] else (math.nan, math.nan)
    laws = envelopes(times, swing, 1 / period)
    if laws is not None and laws.verdict not in ("viscous", "undecided"):
        found.append(laws.sentence)
    for sentence in found:
        warnings.warn(sentence, DampingWarning, stacklevel=3)
    return Decrement(
        ratio,
        delta,
        error,
        (ratio - half, ratio + half),
        two,
        delta / (2 * math.pi),
        1 / period,
        1 / period / math.sqrt(1 - ratio**2),
        rest,
        peak_times,
        peaks,
        times,
        swing,
        laws,
        noise,
        record.unit,
        tuple(found),
    )


def _extremes(y: Vector, step: float, frequency: float, half: int) -> tuple[Vector, Vector, NDArray[np.int64]]:
    """Times, values and kinds (1 or -1, in turn) of the extremes that lie about half a period apart.

    Each is the vertex of the least-squares parabola through the 2 half + 1 samples about it.
    """
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    period = 1 / (frequency * step)
    smooth = uniform_filter1d(y, 2 * half + 1, mode="nearest") if half > 1 else y
    marks = [
        (int(i), kind) for kind in (1, -1) for i in find_peaks(kind * smooth, distance=max(1, int(0.6 * period)))[0]
    ]
    in_turn: list[tuple[int, int]] = []
    for mark, kind in sorted(marks):
        if not half <= mark < len(y) - half:
            continue
        if in_turn and in_turn[-1][1] == kind:
            if kind * smooth[mark] > kind * smooth[in_turn[-1][0]]:
                in_turn[-1] = (mark, kind)
            continue
        in_turn.append((mark, kind))
    offsets = np.arange(-half, half + 1, dtype=float)
    times, values = np.empty(len(in_turn)), np.empty(len(in_turn))
    for k, (mark, _) in enumerate(in_turn):
        a, b, c = np.polyfit(offsets, y[mark - half : mark + half + 1], 2)
        vertex = float(np.clip(-b / (2 * a), -half, half)) if a != 0 else 0.0
        times[k], values[k] = (mark + vertex) * step, a * vertex**2 + b * vertex + c
    return times, values, np.array([kind for _, kind in in_turn], dtype=np.int64)


def _rest(extremes: Vector, y: Vector) -> float:
    """The value about which the signal swings.

    Three extremes e, f, g of c + A (-r)^n give c = (f^2 - e g) / (2 f - e - g) exactly, for any r; the median over
    the larger half of the swings is taken, where noise counts least.
    """
    if len(extremes) < 3:
        return float(np.mean(y[-max(4, len(y) // 4) :]))
    e, f, g = extremes[:-2], extremes[1:-1], extremes[2:]
    swing = np.abs(2 * f - e - g)
    if swing.max() == 0:
        return float(np.mean(y))
    large = swing >= np.median(swing)
    offset = f[large]
    return float(np.median(offset - (offset - e[large]) * (offset - g[large]) / (2 * offset - e[large] - g[large])))


def _cause(record: DecayRecord, y: Vector, frequency: float) -> str:
    if record.length * frequency < 2:
        return f"the record lasts {record.length:g} s, which is less than two periods at {frequency:.3g} Hz"
    third = len(y) // 3
    if np.std(y[-third:]) > 0.9 * np.std(y[:third]):
        return "the record does not decay: it looks the same at its beginning and its end"
    return "it is damped so strongly that it hardly swings; fit a model to it instead (flexarm fit)"
