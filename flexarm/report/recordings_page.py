"""The page of recordings: what was logged, beside the model as given, with its noise, clock and warnings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm.report.origin import origin
from flexarm.report.page import render, view_of, write_page
from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from diagnosis.verdict.examination import Examination, Examined, SignalRow
    from scenarios.load import Scenario

FEWEST = 32
"""Samples of a signal whose spectrum is drawn."""


def write_recordings(scenario: Scenario, found: Examination, path: Path, *, command: str = "") -> Path:
    """Write the page of examined recordings.

    Args:
        scenario: they were held against.
        found: what came of it.
        path: the .html file to write; it appears whole or not at all.
        command: the command line.

    Raises:
        FlexarmError: the file cannot be written.
    """
    charts = _charts(found)
    text = render(
        "recordings.html.j2",
        charts,
        title=f"{scenario.name}: recordings",
        scenario=scenario,
        found=found,
        remarks=[(remark, *_picture(remark.text, charts)) for remark in found.remarks],
        drawn=[chart.key for chart in charts],
        origin=origin(scenario, recordings=[one.recording.file for one in found.recordings], command=command),
    )
    return write_page(path, text)


CLOCKS = ("clock", "interval", "times ", "samples jitter", "missing")
SPECTRA = ("lines at", "folds back", "hum")
"""Words of warnings whose picture is that of the clock, or of the spectrum; all others show in the signals."""


def _picture(text: str, charts: list[Chart]) -> tuple[str, str]:
    """Key of the chart that shows what a warning says, and the view of it; empty if there is none."""
    key = "clocks" if any(word in text for word in CLOCKS) else "signals"
    key = "spectra" if any(word in text for word in SPECTRA) else key
    chart = next((c for c in charts if c.key == key), None)
    return key, view_of(text, chart) if chart else ""


def _charts(found: Examination) -> list[Chart]:
    shown = found.recordings
    if not shown:
        return []
    views = tuple((one.recording.name, _over_time(one)) for one in shown)
    spectra = tuple((one.recording.name, panels) for one in shown if (panels := _spectra(one)))
    clocks = tuple((one.recording.name, (_clock(one),)) for one in shown if len(one.recording.time) > 3)
    made = [Chart("signals", "Recorded signals and the model as given", "time", "s", views, "Recording")]
    if spectra:
        made.append(Chart("spectra", "Spectra and noise", "frequency", "Hz", spectra, "Recording", log=True))
    if clocks:
        made.append(Chart("clocks", "The clock of the samples", "time", "s", clocks, "Recording"))
    return made


def _over_time(one: Examined) -> tuple[Panel, ...]:
    time = np.asarray(one.recording.time)
    panels = [Panel(f"drive {c.name}", c.unit, (Trace("drive", time, c.values, "s3"),)) for c in one.recording.drive]
    for row in one.signals:
        traces = [Trace("recording", row.time, row.measured, "recording")]
        if np.isfinite(row.simulated).any():
            traces.append(Trace("model as given", row.time, row.simulated, "nominal"))
        resting = np.full(len(row.time), np.nan)
        for begin, end in row.rests:
            inside = (row.time >= begin) & (row.time <= end)
            resting[inside] = row.measured[inside]
        if row.rests:
            traces.append(Trace("at rest", row.time, resting, "s2"))
        if row.spikes:
            at = list(row.spikes)
            traces.append(Trace("spikes, left out", row.time[at], row.measured[at], "s4", points=True))
        panels.append(Panel(row.name, row.unit, tuple(traces)))
    return tuple(panels)


def _spectra(one: Examined) -> tuple[Panel, ...]:
    """Amplitude spectra of signals, and the level of the noise in them."""
    return tuple(_spectrum(row) for row in one.signals if np.isfinite(row.measured).sum() >= FEWEST)


def _spectrum(row: SignalRow) -> Panel:
    there = np.isfinite(row.measured)
    there[list(row.spikes)] = False
    count = len(row.time)
    even = np.linspace(row.time[0], row.time[-1], count)
    window = np.hanning(count) + 1e-12
    scale = 2 / float(window.sum())

    def amplitude(values: np.ndarray) -> np.ndarray:
        centred = values - values.mean()
        return np.asarray(np.abs(np.fft.rfft(centred * window))[1:] * scale)

    frequency = np.fft.rfftfreq(count, float(even[1] - even[0]))[1:]
    logarithm = 20 * np.log10(np.maximum(amplitude(np.interp(even, row.time[there], row.measured[there])), 1e-300))
    traces = [Trace("recording", frequency, logarithm, "recording")]
    if np.isfinite(row.simulated).all() and np.ptp(row.simulated) > 0:
        simulated = 20 * np.log10(np.maximum(amplitude(np.interp(even, row.time, row.simulated)), 1e-300))
        floor = float(logarithm.min()) - 40
        traces.append(Trace("model as given", frequency, np.maximum(simulated, floor), "nominal"))
    level = (row.stated if row.stated is not None else row.noise.sigma) * scale * float(np.sqrt(np.sum(window**2)))
    if level > 0:
        height = 20 * np.log10(level)
        traces.append(Trace("noise", frequency[[0, -1]], np.full(2, height), "s4"))
    return Panel(row.name, f"dB re 1 {row.unit}", tuple(traces))


def _clock(one: Examined) -> Panel:
    """How far each sample is from an even clock."""
    stamps = np.asarray(one.recording.stamps if one.recording.stamps is not None else one.recording.time)
    steps = np.diff(stamps)
    return Panel("interval before each sample", "ms", (Trace("interval", stamps[1:], 1e3 * steps, "recording"),))
