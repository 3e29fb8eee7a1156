"""Damping of a decay by both estimators in one report."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnosis.decay.decay_laws import Envelopes
from diagnosis.decay.evolving_spectra import ModeDecay, Waterfall, evolving_spectra
from diagnosis.decay.log_decrement import Decrement, logarithmic_decrement
from diagnosis.decay.record import DampingWarning, DecayRecord
from diagnosis.decay.spectrum import find_lines
from diagnosis.decay.windows import RecordTooShort
from diagnosis.recordings.columns import RecordingError


@dataclass(frozen=True)
class DampingReport:
    """The damping that a decay shows.

    Attributes:
        record: the decay.
        waterfall: evolving spectra; None if the record is too short for them.
        decrement: peaks; None if the record holds several modes, or too few peaks.
        notes: sentences that say how the data were changed and what was left out.
        warnings: sentences that say why the estimates are doubtful.
    """

    record: DecayRecord
    waterfall: Waterfall | None
    decrement: Decrement | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def numbers(self) -> dict[str, Any]:
        """The report ready for JSON; frequencies in Hz, times in s, amplitudes in the signal's unit."""
        return {
            "signal": self.record.name,
            "unit": self.record.unit,
            "samples": len(self.record.values),
            "step": self.record.step,
            "waterfall": _waterfall(self.waterfall),
            "decrement": _decrement(self.decrement),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
        }


def analyse_decay(
    record: DecayRecord,
    frequencies: Sequence[float] | None = None,
    *,
    window: float | None = None,
    hop: float | None = None,
    windows: int | None = None,
    taper: str = "hann",
    start: float = 0.0,
    rest: float | None = None,
) -> DampingReport:
    """Evolving spectra of every mode, and the logarithmic decrement if there is one mode.

    Args:
        record: the decay.
        frequencies: of the modes (Hz); the lines of the spectrum if None.
        window: length of a window (s).
        hop: from one window to the next (s).
        windows: number of windows.
        taper: ``hann`` or ``rectangular``.
        start: time (s) at which the decay begins.
        rest: value about which the signal swings.

    Raises:
        RecordingError: a mode that is not there or does not decay, or nothing that could be estimated.
        ParameterError: a setting out of range.

    Warns:
        DampingWarning: as the two estimators do.
    """
    modes = tuple(frequencies) if frequencies else find_lines(record, start=start)
    notes = list(record.notes)
    if not frequencies:
        notes.append(f"modes found in the spectrum: {', '.join(f'{f:.4g}' for f in modes)} Hz")
    waterfall: Waterfall | None = None
    decrement: Decrement | None = None
    short: RecordTooShort | None = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DampingWarning)
        try:
            waterfall = evolving_spectra(
                record, None, modes, window=window, hop=hop, windows=windows, taper=taper, start=start, rest=rest
            )
        except RecordTooShort as error:
            if len(modes) > 1 or window is not None or windows is not None:
                raise
            short = error
            notes.append(f"no evolving spectra: {error.message}")
        if len(modes) == 1:
            try:
                decrement = logarithmic_decrement(record, frequency=modes[0], rest=rest, start=start)
            except RecordingError as error:
                if short is not None:
                    raise
                notes.append(f"no logarithmic decrement: {error.message}")
        else:
            notes.append(f"no logarithmic decrement: the record holds {len(modes)} modes, whose peaks mix")
    sentences = []
    for warning in caught:
        if issubclass(warning.category, DampingWarning):
            sentences.append(str(warning.message))
            warnings.warn(str(warning.message), DampingWarning, stacklevel=2)
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return DampingReport(record, waterfall, decrement, tuple(notes), tuple(sentences))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _envelopes(laws: Envelopes | None) -> dict[str, Any] | None:
    if laws is None:
        return None
    fits = {fit.law: {"start": fit.start, "rate": fit.rate, "loss": fit.loss, "rms": fit.rms} for fit in laws.fits}
    return {"verdict": laws.verdict, "loss_per_cycle": list(laws.loss_per_cycle), "fits": fits}


def _mode(mode: ModeDecay) -> dict[str, Any]:
    return {
        "given": mode.given,
        "frequency": mode.frequency,
        "ratio": mode.ratio,
        "standard_error": _finite(mode.standard_error),
        "interval_95": [_finite(end) for end in mode.interval],
        "two_point": mode.two_point,
        "slope": mode.slope,
        "windows_used": mode.used,
        "amplitudes": mode.amplitudes.tolist(),
        "envelope": _envelopes(mode.envelopes),
        "reliable": mode.reliable,
    }


def _waterfall(waterfall: Waterfall | None) -> dict[str, Any] | None:
    if waterfall is None:
        return None
    return {
        "window": waterfall.window,
        "hop": waterfall.hop,
        "taper": waterfall.taper,
        "times": waterfall.times.tolist(),
        "rest": waterfall.rest,
        "noise": waterfall.noise,
        "modes": [_mode(mode) for mode in waterfall.modes],
    }


def _decrement(found: Decrement | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "ratio": found.ratio,
        "standard_error": _finite(found.standard_error),
        "interval_95": [_finite(end) for end in found.interval],
        "delta": found.delta,
        "two_point": found.two_point,
        "delta_over_2_pi": found.approximate,
        "frequency": found.frequency,
        "natural_frequency": found.natural_frequency,
        "rest": found.rest,
        "noise": found.noise,
        "peak_times": found.peak_times.tolist(),
        "peaks": found.peaks.tolist(),
        "envelope": _envelopes(found.envelopes),
    }
