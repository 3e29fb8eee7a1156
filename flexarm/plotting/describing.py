"""Describing functions by amplitude in one picture, the linear models and a measured table beside them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.figures import save
from engine.files import writing
from flexarm.plotting.axes import FLOOR, clean, degrees, per
from flexarm.plotting.axes import phase as phase_of
from flexarm.plotting.results import FIGURES

if TYPE_CHECKING:
    from flexarm.design.describing import Description

DASHES = ((4, 2), (1, 1.5), (6, 2, 1, 2), (8, 2))


def plot_description(
    found: Description, path: str | Path, title: str = "", measured: dict[str, Any] | None = None
) -> Path:
    """Draw gain, phase and share of harmonics against frequency, a curve for each amplitude.

    Args:
        found: the answers.
        path: the file to write.
        title: of the figure.
        measured: output -> (frequencies, gains in dB) of a table, drawn as points. Tables hold half the range of a
            response, so that of the model is drawn too: where harmonics are large it is not the first one.

    Raises:
        FlexarmError: the file cannot be written.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    count = len(found.outputs)
    figure = Figure(figsize=(max(5.2 * count, 6.5), 8.2), layout="constrained")
    grid = figure.subplots(3, count, squeeze=False, sharex=True, height_ratios=(2, 1.3, 1))
    shades = colormaps["viridis"]
    unit_in = found.units.get(found.input, "").replace("*", "")
    few = "o-" if len(found.frequency) < 3 else "-"
    omega = np.geomspace(found.frequency.min(), found.frequency.max(), 300)
    linear = _different(found, omega)
    for m, name in enumerate(found.outputs):
        gain, phase, share = grid[:, m]
        phases = []
        for i, amplitude in enumerate(found.amplitude):
            colour = shades(0.9 * i / max(len(found.amplitude) - 1, 1))
            answer = found.gain[i, :, m]
            label = f"{amplitude:.4g} {unit_in}".strip()
            gain.semilogx(found.frequency, _decibel(answer), few, color=colour, lw=1.5, ms=4, label=label)
            if measured and name in measured:
                half = _decibel(found.half_range[i, :, m] / amplitude)
                gain.semilogx(found.frequency, half, "--", color=colour, lw=1.2, label=f"{label}, half the range")
            phases.append(phase_of(answer, found.frequency))
            phase.semilogx(found.frequency, phases[-1], few, color=colour, lw=1.5, ms=4)
            share.semilogx(found.frequency, 100 * found.distortion[i, :, m], few, color=colour, lw=1.5, ms=4)
        low, high = gain.get_ylim()
        for dash, (label, answers) in zip(DASHES, linear.items(), strict=False):
            answer = answers[:, m]
            if np.abs(answer).max() > FLOOR:
                looks = {
                    "color": "#666666",
                    "lw": 1.1,
                    "dashes": dash,
                    "label": "linear" if label == "linear" else f"linear: {label}",
                }
                gain.semilogx(omega, _decibel(answer), **looks)
                phase.semilogx(omega, phase_of(answer, omega), color="#666666", lw=1.1, dashes=dash)
        lowest, highest = gain.get_ylim()
        gain.set_ylim(max(lowest, low - 25), min(highest, high + 25))
        if measured and name in measured:
            gain.semilogx(*measured[name], "k.", ms=6, label="measured, half the range", zorder=5)
        gain.set_title(f"{name} / {found.input}", fontsize=9)
        gain.set_ylabel(f"gain [dB re 1 {per(found.units.get(name, ''), found.units.get(found.input, ''))}]")
        phase.set_ylabel("phase [deg]")
        share.set_ylabel("higher harmonics [%]")
        share.set_xlabel("angular frequency [rad/s]")
        degrees(phase.yaxis, min(p.min() for p in phases), max(p.max() for p in phases))
        for axis in (gain, phase, share):
            axis.margins(x=0.01)
            clean(axis)
        share.set_ylim(bottom=0)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    room = 15 * figure.get_figwidth()  # letters of a row, the handles taken off
    ncols = max(1, min(4, int(room / (6 + max(map(len, labels))))))
    figure.legend(handles, labels, loc="outside lower center", ncols=ncols, fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11)
    with writing(Path(path), FIGURES) as temporary:
        save(figure, temporary)
    return Path(path)


def _different(found: Description, omega: Any) -> dict[str, Any]:
    """Frequency responses of the linear models, shape (frequencies, outputs), of equal ones the first alone."""
    rows: dict[str, Any] = {}
    for label, linear in found.linear.items():
        answer = np.array([linear.gain(w)[:, 0] for w in omega])
        if not any(np.allclose(answer, other, rtol=1e-6, atol=1e-12) for other in rows.values()):
            rows[label] = answer
    return rows


def _decibel(values: Any) -> Any:
    return 20 * np.log10(np.maximum(np.abs(values), FLOOR))
