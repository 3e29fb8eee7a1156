"""Held-out responses with the bounds predicted for them, and the Bode plot of the family."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from engine.figures import save
from engine.files import writing
from flexarm.plotting.axes import FLOOR, clean, phase
from flexarm.plotting.results import COLOURS, FIGURES

if TYPE_CHECKING:
    from flexarm.design.uncertainty.results import UncertainModel

MOST_BANDS = 4


def plot_uncertain(found: UncertainModel, path: str | Path, title: str = "") -> Path:
    """Draw the family and the first held-out responses.

    Raises:
        FlexarmError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    from flexarm.plotting.family import span

    bands = found.bands[:MOST_BANDS]
    figure = Figure(figsize=(6.2 * (1 + max(1, (len(bands) + 1) // 2)), 8), layout="constrained")
    grid = figure.subplots(2, 1 + max(1, (len(bands) + 1) // 2), squeeze=False)
    members = [found.family.kept(k) for k in range(min(len(found.family), 100))]
    omega = span(members)
    for j, axis in ((0, grid[0, 0]), (1, grid[1, 0])):
        for k, member in enumerate(reversed(members)):
            if not (member.inputs and member.outputs):
                continue
            gain = np.array([member.gain(w)[0, 0] for w in omega])
            if np.abs(gain).max() <= FLOOR:
                continue
            fitted = k == len(members) - 1
            looks = {"color": COLOURS[1] if fitted else COLOURS[0], "lw": 1.6 if fitted else 0.6}
            shown = 20 * np.log10(np.maximum(np.abs(gain), FLOOR)) if j == 0 else phase(gain, omega)
            axis.semilogx(omega, shown, alpha=1 if fitted else 0.4, **looks)
        axis.set_ylabel("gain [dB]" if j == 0 else "phase [deg]")
        clean(axis)
    if found.family.inputs and found.family.outputs:
        grid[0, 0].set_title(
            f"{found.family.outputs[0]} / {found.family.inputs[0]}: fitted (red) and draws", fontsize=9
        )
    else:
        grid[0, 0].set_title("no input: the family has poles alone", fontsize=9)
        poles = np.concatenate([member.poles() for member in members])
        grid[0, 0].set_xscale("linear")
        grid[0, 0].plot(poles.real, poles.imag, "x", color=COLOURS[0], ms=5, alpha=0.5)
        grid[0, 0].set_ylabel("imaginary part [1/s]")
        grid[0, 0].set_xlabel("real part [1/s]")
        grid[1, 0].axis("off")
    grid[1, 0].set_xlabel("angular frequency [rad/s]")
    places = [grid[r, c] for c in range(1, grid.shape[1]) for r in range(2)]
    for axis, band in zip(places, bands, strict=False):
        axis.loglog(band.frequency, band.measured, color="#999999", lw=0.8, label="measured")
        axis.loglog(band.frequency, band.predicted, color="#333333", lw=0.8, label="predicted")
        axis.fill_between(band.frequency, band.bound, band.bound.min() * 1e-3, color=COLOURS[0], alpha=0.2, lw=0)
        axis.loglog(band.frequency, band.bound, color=COLOURS[0], lw=1.2, label="bound on the difference, 95 %")
        axis.loglog(band.frequency, band.parametric, color=COLOURS[2], lw=1, ls="--", label="parameters alone")
        axis.loglog(band.frequency, band.left, ".", color=COLOURS[1], ms=2.5, label="measured - predicted")
        part = "" if band.part == (0.0, 1.0) else f", {band.part[0]:.0%} to {band.part[1]:.0%}"
        axis.set_title(f"{band.recording}{part}: {band.signal}\n{band.coverage:.1%} of the bins within", fontsize=9)
        axis.set_ylim(bottom=max(float(np.quantile(band.left, 0.01)) / 3, 1e-12))
        axis.set_xlabel("angular frequency [rad/s]")
        axis.set_ylabel(f"spectrum [{band.unit}]")
        clean(axis)
    for axis in places[len(bands) :]:
        axis.axis("off")
    if bands:
        figure.legend(
            *places[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8, frameon=False
        )
    figure.suptitle(f"{title}, {len(found.family) - 1} draws from the fit", fontsize=11)
    with writing(Path(path), FIGURES) as temporary:
        save(figure, temporary)
    return Path(path)
