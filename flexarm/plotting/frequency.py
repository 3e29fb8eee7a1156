"""Figures of a linear model: Bode, poles and zeros, and Nichols."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from engine.figures import save
from engine.files import writing
from flexarm.plotting.axes import FLOOR, clean, degrees, per, phase
from flexarm.plotting.results import COLOURS, FIGURES

if TYPE_CHECKING:
    from engine.linearise import LinearModel

MOST_PAIRS = len(COLOURS)
SHARPEST = 1e-3
"""Relative width down to which a resonance is resolved; an undamped one would have no end."""


@dataclass(frozen=True)
class Response:
    """Frequency response of one output to one input.

    Attributes:
        output, input: names.
        unit: of the gain.
        frequency: rad/s, shape (n,).
        gain: complex, shape (n,).
    """

    output: str
    input: str
    unit: str
    frequency: NDArray[np.float64]
    gain: NDArray[np.complex128]

    @property
    def decibel(self) -> NDArray[np.float64]:
        """Gain in dB re the unit."""
        return np.asarray(20 * np.log10(np.maximum(np.abs(self.gain), FLOOR)))

    @property
    def degrees(self) -> NDArray[np.float64]:
        """Phase without jumps; see `flexarm.plotting.axes.phase`."""
        return phase(self.gain, self.frequency)


def frequencies(linear: LinearModel, points: int = 500) -> NDArray[np.float64]:
    """Frequencies (rad/s) from a decade below the slowest pole or zero to a decade above the fastest.

    They are dense about every resonance and every notch, so that a lightly damped one is drawn to its height.
    """
    roots = [linear.poles(), *(linear.zeros(y, u) for y in linear.outputs for u in linear.inputs)]
    every = np.concatenate(roots) if roots else np.zeros(0, dtype=complex)
    sizes = np.abs(every)
    sizes = sizes[(sizes > 1e-6 * sizes.max(initial=0.0)) & (sizes > 1e-9)]
    low, high = (sizes.min() / 10, sizes.max() * 10) if len(sizes) else (0.1, 1e3)
    grid = [np.geomspace(low, high, points)]
    away = np.concatenate([-np.geomspace(30, 0.1, 20), np.geomspace(0.1, 30, 20)])
    for root in every:
        centre, width = abs(root.imag), max(abs(root.real), SHARPEST * abs(root.imag))
        if centre > 0:
            near = centre + width * away
            grid.append(near[(near > low) & (near < high)])
    return np.unique(np.concatenate(grid))


def responses(linear: LinearModel) -> list[Response]:
    """Frequency responses of every output to every input that reaches it."""
    omega = frequencies(linear)
    gains = np.array([linear.gain(w) for w in omega])
    rows = []
    for i, output in enumerate(linear.outputs):
        for j, driven in enumerate(linear.inputs):
            if np.abs(gains[:, i, j]).max(initial=0.0) > FLOOR:
                unit = per(linear.units.get(output, ""), linear.units.get(driven, ""))
                rows.append(Response(output, driven, unit, omega, gains[:, i, j]))
    return rows


def plot_linear(linear: LinearModel, path: str | Path, title: str = "") -> Path:
    """Draw Bode, pole-zero and Nichols plots of a linear model into a .png, .pdf or .svg file.

    Where no output depends on an input, as behind a stuck joint, there are only poles to draw.

    Args:
        linear: the model.
        path: the file to write.
        title: of the figure; the modes that were linearised are added.

    Returns:
        The path written.

    Raises:
        FlexarmError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    rows = responses(linear)
    shown = rows[:MOST_PAIRS]
    head = _title(linear, title)
    figure = Figure(figsize=(12, 7.4) if rows else (6, 4.4), layout="constrained")
    if rows:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
        gain = figure.add_subplot(grid[0, 0])
        phase = figure.add_subplot(grid[1, 0], sharex=gain)
        _bode(gain, phase, shown, len({r.input for r in rows}) > 1)
        _roots(figure.add_subplot(grid[0, 1]), linear, shown)
        _nichols(figure.add_subplot(grid[1, 1]), shown)
        figure.legend(*gain.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False)
        if len(rows) > len(shown):
            head += f"\nthe first {len(shown)} of {len(rows)} pairs"
    else:
        _roots(figure.add_subplot(), linear, rows)
        head += "\nno output depends on an input here"
    figure.suptitle(head, fontsize=11)
    with writing(Path(path), FIGURES) as temporary:
        save(figure, temporary)
    return Path(path)


def _title(linear: LinearModel, title: str) -> str:
    modes = [f"{name} {label}" for name, label in linear.modes.items()]
    lines = [", ".join(modes[i : i + 4]) for i in range(0, len(modes), 4)]
    return "\n".join([title, *lines]) if title else "\n".join(lines)


def _bode(gain: Any, phase: Any, rows: list[Response], many: bool) -> None:
    for row, colour in zip(rows, COLOURS, strict=False):
        label = f"{row.output} / {row.input}" if many else row.output
        gain.semilogx(row.frequency, row.decibel, color=colour, lw=1.4, label=f"{label}  [{row.unit}]")
        phase.semilogx(row.frequency, row.degrees, color=colour, lw=1.4)
    units = {row.unit for row in rows}
    gain.set_ylabel(f"gain [dB re 1 {units.pop()}]" if len(units) == 1 else "gain [dB re the unit in the legend]")
    gain.tick_params(labelbottom=False)
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("angular frequency [rad/s]")
    degrees(phase.yaxis, min(r.degrees.min() for r in rows), max(r.degrees.max() for r in rows))
    gain.margins(x=0)
    for axis in (gain, phase):
        clean(axis)


def _roots(axis: Any, linear: LinearModel, rows: list[Response]) -> None:
    poles = linear.poles()
    single = len(rows) <= 3
    axis.axhline(0, color="#999999", lw=0.8)
    axis.axvline(0, color="#999999", lw=0.8)
    axis.plot(poles.real, poles.imag, "x", color="#333333", ms=7, mew=1.6, label="poles")
    for row, colour in zip(rows, COLOURS, strict=False):
        zeros = linear.zeros(row.output, row.input)
        if len(zeros):
            looks = {"mfc": "none", "mec": colour, "ms": 7, "mew": 1.4}
            axis.plot(zeros.real, zeros.imag, "o", **looks, label=f"zeros of {row.output}" if single else None)
    if not single:
        axis.plot([], [], "o", mfc="none", mec="#333333", ms=7, mew=1.4, label="zeros, in the colour of the pair")
    every = np.concatenate([poles, *(linear.zeros(r.output, r.input) for r in rows)])
    inner = _near(every)
    axis.update_datalim(np.column_stack([inner.real, inner.imag]))
    reach = [
        (v.min(), v.max(), max(np.ptp(v), 1e-3 * np.abs(inner).max(initial=1.0))) for v in (inner.real, inner.imag)
    ]
    (left, right, wide), (below, above, high) = reach
    axis.set_xlim(min(left, 0.0) - 0.12 * wide, max(right, 0.0) + 0.12 * wide)
    axis.set_ylim(below - 0.12 * high, above + 0.12 * high)
    if len(inner) < len(every):
        axis.set_title(f"outside the view: {_listed(every, inner)}", fontsize=8, loc="right")
    axis.set_xlabel("real part [1/s]")
    axis.set_ylabel("imaginary part [1/s]")
    axis.legend(fontsize=8, framealpha=0.9, loc="best")
    clean(axis)


def _near(roots: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """The roots without the few that are so fast that they would press all others into a point."""
    kept = roots[np.argsort(np.abs(roots))]
    most = len(kept) // 3
    for count in range(1, most + 1):
        outer, inner = abs(kept[-count]), abs(kept[-count - 1])
        if outer > 4 * inner > 0:
            return np.asarray(kept[:-count])
    return np.asarray(kept)


def _listed(every: NDArray[np.complex128], inner: NDArray[np.complex128]) -> str:
    """The roots left out, in words; conjugates once, at most three."""
    limit = np.abs(inner).max(initial=0.0)
    outer = [r for r in every if abs(r) > limit and r.imag >= -1e-9 * abs(r)]
    texts = dict.fromkeys(f"{r.real:.3g} ± {r.imag:.3g}i" if r.imag > 1e-9 * abs(r) else f"{r.real:.3g}" for r in outer)
    return ", ".join(list(texts)[:3]) + (", ..." if len(texts) > 3 else "")


def _nichols(axis: Any, rows: list[Response]) -> None:
    for row, colour in zip(rows, COLOURS, strict=False):
        axis.plot(row.degrees, row.decibel, color=colour, lw=1.4)
    for critical in _critical(rows):
        axis.plot([critical], [0], "+", color="#333333", ms=9, mew=1.6)
    degrees(axis.xaxis, min(r.degrees.min() for r in rows), max(r.degrees.max() for r in rows))
    axis.set_xlabel("phase [deg]")
    axis.set_ylabel("gain [dB]")
    axis.set_title("Nichols; + is the critical point", fontsize=8, loc="right")
    clean(axis)


def _critical(rows: list[Response]) -> list[float]:
    """Odd multiples of 180 degrees within the phases shown; the nearest one at least."""
    low, high = min(r.degrees.min() for r in rows), max(r.degrees.max() for r in rows)
    found = [180.0 * k for k in range(-31, 32, 2) if low - 45 <= 180 * k <= high + 45]
    return found or [min((180.0 * k for k in range(-31, 32, 2)), key=lambda v: abs(v - (low + high) / 2))]
