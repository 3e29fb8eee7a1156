"""Figures of damping estimates: waterfall, decay on a logarithmic axis, and the swing with its envelopes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.figures import save
from engine.files import writing
from flexarm.plotting.results import COLOURS, FIGURES

if TYPE_CHECKING:
    from diagnosis.decay.evolving_spectra import Waterfall
    from diagnosis.decay.log_decrement import Decrement
    from diagnosis.decay.record import DecayRecord

MOST_TRACES = 12
GREY = "#444444"


def plot_waterfall(waterfall: Waterfall, path: str | Path, title: str = "") -> Path:
    """Draw the spectra one behind the other, the first in front, with the modes' maxima marked.

    Args:
        waterfall: the spectra.
        path: a .png, .pdf or .svg file.
        title: of the figure.

    Returns:
        The path written.

    Raises:
        FlexarmError: it cannot be written.
    """
    return _write(
        path,
        title,
        (8, 4.8),
        lambda figure: draw_waterfall(figure.add_subplot(projection="3d", computed_zorder=False), waterfall),
    )


def draw_waterfall(axis: Any, waterfall: Waterfall) -> None:
    """Draw a waterfall on an axis made with ``projection="3d", computed_zorder=False``."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from diagnosis.decay.windows import BAND

    highest = max(mode.given for mode in waterfall.modes)
    shown = waterfall.axis <= max(1.6 * highest, highest + 6 / waterfall.window)
    frequency = waterfall.axis[shown]
    used = max(mode.used for mode in waterfall.modes)
    chosen = np.unique(np.linspace(0, used - 1, min(used, MOST_TRACES)).round().astype(int))
    for place, k in reversed(list(enumerate(chosen))):
        line, at = waterfall.spectra[k, shown], float(waterfall.times[k])
        face = [[*zip(frequency, [at] * len(line), line, strict=True), (frequency[-1], at, 0.0), (0.0, at, 0.0)]]
        axis.add_collection3d(Poly3DCollection(face, facecolor="white", edgecolor="none", zorder=-2 * place))
        axis.plot(frequency, [at] * len(line), line, color=GREY, linewidth=0.9, zorder=1 - 2 * place)
        for i, mode in enumerate(waterfall.modes):
            near = np.flatnonzero(np.abs(frequency - mode.given) <= BAND * mode.given)
            if k < mode.used and len(near):
                top = int(near[int(np.argmax(line[near]))])
                colour = COLOURS[i % len(COLOURS)]
                axis.plot([frequency[top]], [at], [line[top]], "o", color=colour, markersize=4, zorder=2)
    axis.set_xlim(0, frequency[-1])
    axis.set_ylim(waterfall.times[chosen[0]], waterfall.times[chosen[-1]])
    axis.set_zlim(0, 1.05 * float(waterfall.spectra[:, shown].max()))
    axis.set_xlabel("frequency [Hz]", labelpad=8)
    axis.set_ylabel("begin of the window [s]", labelpad=14)
    axis.set_zlabel(f"amplitude{_in(waterfall.unit)}", labelpad=2)
    axis.tick_params(labelsize=8)
    for pane in (axis.xaxis, axis.yaxis, axis.zaxis):
        pane.set_pane_color((1.0, 1.0, 1.0))
    axis.view_init(elev=26, azim=-68)
    axis.set_box_aspect((1.7, 1.3, 0.8), zoom=1.05)


def plot_decay(waterfall: Waterfall, path: str | Path, title: str = "") -> Path:
    """Draw each mode's amplitude over time on a logarithmic axis with its line; arguments as `plot_waterfall`."""
    return _write(path, title, (7, 4), lambda figure: draw_decay(figure.subplots(), waterfall))


def draw_decay(axis: Any, waterfall: Waterfall) -> None:
    """Draw amplitudes and lines on an axis."""
    from matplotlib.ticker import FuncFormatter

    for i, mode in enumerate(waterfall.modes):
        colour = COLOURS[i % len(COLOURS)]
        used, rest = waterfall.times[: mode.used], waterfall.times[mode.used :]
        label = f"{mode.frequency:.4g} Hz: ξ = {mode.ratio:.4g} ± {mode.standard_error:.1g}"
        axis.plot(used, mode.amplitudes[: mode.used], "o", color=colour, markersize=5, label=label)
        axis.plot(rest, mode.amplitudes[mode.used :], "o", color=colour, markersize=4, markerfacecolor="white")
        axis.plot(used, np.exp(mode.intercept + mode.slope * used), "-", color=colour, linewidth=1.2)
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "246" else ""))
    axis.tick_params(axis="y", which="minor", labelsize=7)
    axis.set_xlabel("begin of the window [s]")
    axis.set_ylabel(f"amplitude{_in(waterfall.unit)}")
    axis.grid(True, which="both")
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(fontsize=8, frameon=False)


def plot_decrement(record: DecayRecord, decrement: Decrement, path: str | Path, title: str = "") -> Path:
    """Draw the swing with its peaks and the envelopes fitted to it; other arguments as `plot_waterfall`."""
    return _write(path, title, (8, 4), lambda figure: draw_decrement(figure.subplots(), record, decrement))


def draw_decrement(axis: Any, record: DecayRecord, decrement: Decrement) -> None:
    """Draw swing, peaks and envelopes on an axis."""
    axis.plot(record.time, record.values, color="#9aa7b1", linewidth=0.9)
    axis.plot(
        decrement.peak_times,
        decrement.rest + decrement.peaks,
        "o",
        color=COLOURS[0],
        markersize=4,
        label=f"peaks: ξ = {decrement.ratio:.4g}",
    )
    times = np.linspace(decrement.extreme_times[0], decrement.extreme_times[-1], 400)
    fits = decrement.envelopes.fits if decrement.envelopes is not None else ()
    for k, fit in enumerate([fit for fit in fits if fit.law in ("viscous", "coulomb", decrement_law(decrement))]):
        colour = COLOURS[(k + 1) % len(COLOURS)]
        share = fit.rms / float(decrement.extremes[0])
        label = f"{fit.law}, residual {100 * share:.2g} % of the first amplitude"
        for sign in (1, -1):
            axis.plot(
                times,
                decrement.rest + sign * fit.at(times),
                color=colour,
                linewidth=1.2,
                linestyle="-" if k == 0 else "--",
                label=label if sign > 0 else None,
            )
    end = 1.1 * float(decrement.extreme_times[-1])
    axis.set_xlim(0, min(end, float(record.time[-1])))
    axis.set_xlabel("time [s]")
    axis.set_ylabel(f"{record.name}{_in(record.unit)}")
    axis.grid(True)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(fontsize=8, frameon=False, loc="upper right")


def decrement_law(decrement: Decrement) -> str:
    """The law that fits a swing best."""
    return decrement.envelopes.fits[0].law if decrement.envelopes is not None else ""


def _in(unit: str) -> str:
    return "" if unit in ("", "1", "*") else f" [{unit.replace('.', '·')}]"


def _write(path: str | Path, title: str, size: tuple[float, float], draw: Callable[[Any], None]) -> Path:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with (
        writing(Path(path), FIGURES) as temporary,
        mpl.rc_context({"grid.color": "#dddddd", "grid.linewidth": 0.6}),
    ):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        if title:
            figure.suptitle(title, fontsize=11, fontweight="bold")
        save(figure, temporary)
    return Path(path)
