"""Bode plots of a family of linear models in one picture, coloured by mode or by the first scheduling variable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.figures import save
from engine.files import writing
from engine.linearise import LinearModel
from flexarm.plotting.axes import FLOOR, clean, degrees, per, phase
from flexarm.plotting.results import COLOURS, FIGURES

if TYPE_CHECKING:
    from engine.family import LinearFamily

MOST_DRAWN = 121
"""Members that are drawn; of more, these are spread evenly."""


def span(members: list[LinearModel], points: int = 400) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Frequencies (rad/s) from a decade below the slowest pole to a decade above the fastest, dense at resonances."""
    poles = np.concatenate([member.poles() for member in members] or [np.zeros(0, dtype=complex)])
    sizes = np.abs(poles)
    sizes = sizes[(sizes > 1e-6 * sizes.max(initial=0.0)) & (sizes > 1e-9)]
    low, high = (sizes.min() / 10, sizes.max() * 10) if len(sizes) else (0.1, 1e3)
    grid = [np.geomspace(low, high, points)]
    sharp = poles[(poles.imag > 0) & (np.abs(poles.real) < 0.2 * np.abs(poles))]
    for pole in sharp[np.argsort(np.abs(sharp))][:: max(1, len(sharp) // 60)]:
        width = max(abs(pole.real), 1e-3 * pole.imag)
        grid.append(pole.imag + width * np.linspace(-4, 4, 17))
    found = np.unique(np.concatenate(grid))
    return np.asarray(found[(found >= low) & (found <= high)])


def _distinct(family: LinearFamily) -> tuple[list[int], list[str]]:
    """Members to draw, one for each different linear model where modes differ, and what to call each."""
    names = [", ".join(f"{name} {label}" for name, label in modes.items()) for modes in family.modes]
    size = len(family)
    if len(set(names)) < 2:
        chosen = np.unique(np.linspace(0, size - 1, min(size, MOST_DRAWN)).astype(int)).tolist()
        return chosen, [names[k] for k in chosen]
    groups: dict[bytes, list[int]] = {}
    for k in range(size):
        member = family[k]
        key = b"".join(np.round(matrix, 9).tobytes() for matrix in (member.A, member.B, member.C, member.D))
        groups.setdefault(key, []).append(k)
    rows = list(groups.values())
    if len(rows) > MOST_DRAWN:
        rows = [rows[int(i)] for i in np.linspace(0, len(rows) - 1, MOST_DRAWN)]
    merged = []
    for row in rows:
        found = list(dict.fromkeys(names[k] for k in row))
        merged.append(found[0] + (f", and {len(found) - 1} more alike" if len(found) > 1 else ""))
    return [row[0] for row in rows], merged


def _strongest(family: LinearFamily) -> int:
    """The axis along which the models differ most."""
    change = [float(np.ptp(family.A, axis=i).sum()) if k > 1 else -1.0 for i, k in enumerate(family.shape)]
    return int(np.argmax(change))


def plot_family(family: LinearFamily, path: str | Path, title: str = "") -> Path:
    """Draw magnitude and phase of every member and every pair of input and output into a .png, .pdf or .svg file.

    Raises:
        FlexarmError: the file cannot be written.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    chosen, labels = _distinct(family)
    members = [family.kept(k) for k in chosen]
    kinds = list(dict.fromkeys(labels))
    by_mode = 1 < len(kinds) <= len(COLOURS)
    which = _strongest(family)
    axis = family.axes[which]
    values = [float(axis.values[np.unravel_index(k, family.shape)[which]]) for k in chosen]
    norm = Normalize(min(values), max(values)) if max(values) > min(values) else Normalize(0, 1)
    shades = colormaps["viridis"]
    omega = span(members)
    gains = [np.array([member.gain(w) for w in omega]) for member in members]
    pairs = [(i, j) for i in range(len(family.outputs)) for j in range(len(family.inputs))]
    pairs = [(i, j) for i, j in pairs if max(np.abs(g[:, i, j]).max() for g in gains) > FLOOR][:4]
    figure = Figure(figsize=(max(5.0 * len(pairs), 6.5), 6.4), layout="constrained")
    grid = figure.subplots(2, max(len(pairs), 1), squeeze=False, sharex=True)
    for column, (i, j) in enumerate(pairs):
        upper, lower = grid[:, column]
        phases = []
        for gain, label, value in zip(gains, labels, values, strict=True):
            one = gain[:, i, j]
            if np.abs(one).max() <= FLOOR:
                continue
            colour = COLOURS[kinds.index(label)] if by_mode else shades(0.93 * norm(value))
            looks = {"color": colour, "lw": 0.9 if len(members) > 12 else 1.3, "alpha": 0.8}
            upper.semilogx(omega, 20 * np.log10(np.maximum(np.abs(one), FLOOR)), **looks)
            phases.append(phase(one, omega))
            lower.semilogx(omega, phases[-1], **looks)
        unit = per(family.units.get(family.outputs[i], ""), family.units.get(family.inputs[j], ""))
        upper.set_title(f"{family.outputs[i]} / {family.inputs[j]}", fontsize=9)
        upper.set_ylabel(f"gain [dB re 1 {unit}]")
        lower.set_ylabel("phase [deg]")
        lower.set_xlabel("angular frequency [rad/s]")
        if phases:
            degrees(lower.yaxis, min(p.min() for p in phases), max(p.max() for p in phases))
        for one_axis in (upper, lower):
            one_axis.margins(x=0)
            clean(one_axis)
    if by_mode:
        moved = {label for gain, label in zip(gains, labels, strict=True) if np.abs(gain).max() > FLOOR}
        handles = [
            grid[0, 0].plot(
                [], [], color=COLOURS[k], lw=1.6, label=kind if kind in moved else f"{kind}: no output moves"
            )[0]
            for k, kind in enumerate(kinds)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    elif max(values) > min(values):
        bar = figure.colorbar(ScalarMappable(norm, shades), ax=grid[:, -1].tolist(), pad=0.02)
        bar.set_label(f"{axis.name}{f' [{axis.unit}]' if axis.unit else ''}")
    head = title if by_mode or len(kinds) != 1 or not kinds[0] else f"{title}\n{kinds[0]}"
    few = (
        f"\n{len(members)} of {len(family)} members, the others being like these" if len(members) < len(family) else ""
    )
    figure.suptitle(head + few, fontsize=10)
    with writing(Path(path), FIGURES) as temporary:
        save(figure, temporary)
    return Path(path)
