"""Figures of results, with units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.figures import save
from engine.files import writing

if TYPE_CHECKING:
    from engine.simulate import Result

FIGURES = (".png", ".pdf", ".svg")
COLOURS = ("#1b6ca8", "#d1495b", "#2e8b57", "#e08e0b", "#6a4c93", "#5c5c5c", "#17a2a2", "#a0522d")
MOST_IN_PANEL = 8

SMALLEST_IN_PANEL = 0.05
"""A signal smaller than this share of the greatest one in a panel would be a flat line there."""


def panels(units: dict[str, str], sizes: dict[str, float] | None = None) -> list[tuple[str, list[str]]]:
    """Signals grouped into panels by unit, in order of appearance; a crowded panel is split.

    Args:
        units: of each signal.
        sizes: greatest magnitude of each signal; signals of very different size get panels of their own.
    """
    groups: dict[str, list[str]] = {}
    for name, unit in units.items():
        groups.setdefault(unit, []).append(name)
    return [
        (unit, names[i : i + MOST_IN_PANEL])
        for unit, together in groups.items()
        for names in (_alike(together, sizes) if sizes else [together])
        for i in range(0, len(names), MOST_IN_PANEL)
    ]


def _alike(names: list[str], sizes: dict[str, float]) -> list[list[str]]:
    """Signals of one unit, parted by size, the greatest first; signals that are 0 stay with the first."""
    greatest = max(sizes[name] for name in names)
    first = [name for name in names if not 0 < sizes[name] < SMALLEST_IN_PANEL * greatest]
    rest = [name for name in names if name not in first]
    return [first, *(_alike(rest, sizes) if rest else [])]


def _quantity(names: list[str], unit: str) -> str:
    """Axis label: what the signals have in common, and the unit."""
    last = {name.rsplit(".", 1)[-1] for name in names}
    word = last.pop() if len(last) == 1 and not last & {"in", "out"} else ""
    shown = "" if unit in ("1", "", "*") else unit.replace(".", "·")
    return f"{word} [{shown}]".strip() if shown else word


def plot(results: Result | Sequence[tuple[str, Result]], path: str | Path, title: str = "") -> Path:
    """Draw results over time, one panel for each unit, into a .png, .pdf or .svg file.

    Args:
        results: one result, or several with a label each, drawn into the same panels.
        path: the file to write.
        title: of the figure.

    Returns:
        The path written.

    Raises:
        FlexarmError: it cannot be written.
    """
    from matplotlib.figure import Figure  # pyplot would choose a backend, and a notebook has its own

    labelled = [("", results)] if not isinstance(results, Sequence) else list(results)
    units: dict[str, str] = {}
    for _, result in labelled:
        for name, unit in result.units.items():
            units.setdefault(name, unit)
    sizes = {n: max(float(abs(r[n]).max()) for _, r in labelled if n in r.units) for n in units}
    rows = panels(units, sizes)
    with writing(Path(path), FIGURES) as temporary:
        figure = Figure(figsize=(8, 0.9 + 2.3 * max(1, len(rows))), layout="constrained")
        axes = figure.subplots(max(1, len(rows)), 1, sharex=True, squeeze=False)
        for axis, (unit, names) in zip(axes[:, 0], rows, strict=False):
            _panel(axis, labelled, unit, names)
        axes[-1, 0].set_xlabel("time [s]")
        if title:
            figure.suptitle(title, fontsize=11, fontweight="bold")
        figure.align_ylabels()
        save(figure, temporary, dpi=150)
    return Path(path)


def _panel(axis: Any, labelled: Sequence[tuple[str, Result]], unit: str, names: list[str]) -> None:
    styles = ("-", "--", ":", "-.")
    for k, (label, result) in enumerate(labelled):
        for i, name in enumerate(names):
            if name not in result.units:
                continue
            colour = COLOURS[
                (i * len(labelled) + k if len(names) * len(labelled) <= len(COLOURS) else i) % len(COLOURS)
            ]
            text = f"{name}, {label}" if label and len(names) > 1 else label or name
            style = styles[k % len(styles)]
            axis.plot(result.time, result[name], style, color=colour, linewidth=1.4, label=text)
    single, count = len(names) == 1, len(names) * len(labelled)
    if single and count == 1:
        axis.set_title(names[0], fontsize=9, loc="left")
    axis.set_ylabel(_quantity(names, unit))
    axis.grid(True, color="#dddddd", linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.margins(x=0)
    if count > 1:
        # Above the panel: inside it would hide curves.
        axis.legend(
            title=names[0] if single else None,
            ncols=min(count, 4),
            fontsize=8,
            title_fontsize=9,
            alignment="left",
            frameon=False,
            loc="lower left",
            bbox_to_anchor=(-0.01, 0.97),
            borderpad=0.2,
        )
