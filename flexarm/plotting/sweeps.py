"""Figures of a sweep: which drawn values move a number (tornado), and how (scatter)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.errors import FlexarmError
from engine.figures import save
from engine.files import writing

if TYPE_CHECKING:
    from flexarm.sweeps.sweep import Sweep

MOST_BARS = 15
MOST_POINTS = 5000
FEWEST = 5


def plot_sweep(sweep: Sweep) -> tuple[Path, ...]:
    """Draw ``tornado.png`` and ``scatter.png`` beside the table; returns their paths.

    A bar is Spearman's rank correlation of a drawn parameter with a number, over the runs that did not fail: +1 where
    the number always rises with it. The numbers are the metrics, or where there are none the outputs' last values.

    Raises:
        FlexarmError: nothing was drawn, or too few runs ended well.
    """
    from flexarm.table import read

    plan = sweep.plan
    inputs = [sample.name for sample in plan.samples] + [axis.key for axis in plan.axes if axis.numbers]
    numbers = [(m.name, m.unit) for m in plan.metrics] or [(f"{name}.final", unit) for name, unit in plan.outputs]
    table = read(sweep.table, [*inputs, *(name for name, _ in numbers)])
    columns = {name: np.asarray(table[name], dtype=float) for name in (*inputs, *(name for name, _ in numbers))}
    inputs = [name for name in inputs if np.ptp(columns[name]) > 0]
    if not inputs:
        raise FlexarmError(
            "there is nothing to draw: no number was varied",
            remedy="draw something, such as KEY~tolerance, and give --runs",
        )
    most = max((int(np.isfinite(columns[name]).sum()) for name, _ in numbers), default=0)
    numbers = [(name, unit) for name, unit in numbers if np.isfinite(columns[name]).sum() >= FEWEST][:4]
    if not numbers:
        raise FlexarmError(
            f"there is nothing to draw: figures need {FEWEST} runs with a number, and {most} of {plan.total} have one",
            remedy="vary more values, or give more --runs",
        )
    folder = sweep.table.parent
    stem = "" if sweep.table.name == "runs.parquet" else f"{sweep.table.stem}-"
    made = (folder / f"{stem}tornado.png", folder / f"{stem}scatter.png")
    _draw(made[0], _tornado(columns, inputs, numbers))
    _draw(made[1], _scatter(columns, inputs, numbers, table.units))
    return made


def rank_correlation(x: Any, y: Any) -> float:
    """Spearman's rank correlation over the finite pairs; 0 where one of them does not vary."""
    from scipy.stats import rankdata

    both = np.isfinite(x) & np.isfinite(y)
    a, b = (rankdata(v[both]) for v in (x, y))
    if both.sum() < 2 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def _draw(path: Path, figure: Any) -> None:
    with writing(path, (".png",)) as temporary:
        save(figure, temporary)


def _tornado(columns: dict[str, Any], inputs: list[str], numbers: list[tuple[str, str]]) -> Any:
    from matplotlib.figure import Figure

    bars = min(len(inputs), MOST_BARS)
    figure = Figure(figsize=(4.2 * len(numbers) + 1.5, 0.35 * bars + 1.2), layout="constrained")
    for axes, (name, _) in zip(np.atleast_1d(figure.subplots(1, len(numbers))), numbers, strict=True):
        ranked = sorted(((rank_correlation(columns[x], columns[name]), x) for x in inputs), key=lambda p: -abs(p[0]))
        ranked = ranked[:MOST_BARS][::-1]
        colours = ["#d1495b" if value < 0 else "#1b6ca8" for value, _ in ranked]
        axes.barh([x for _, x in ranked], [value for value, _ in ranked], color=colours)
        axes.set(xlim=(-1, 1), xlabel="rank correlation", title=name)
        axes.axvline(0, color="black", linewidth=0.8)
    return figure


def _scatter(columns: dict[str, Any], inputs: list[str], numbers: list[tuple[str, str]], units: dict[str, str]) -> Any:
    from matplotlib.figure import Figure

    def strength(x: str) -> float:
        return max(abs(rank_correlation(columns[x], columns[name])) for name, _ in numbers)

    strongest = sorted(inputs, key=strength, reverse=True)[:4]
    figure = Figure(figsize=(2.8 * len(strongest) + 0.6, 2.3 * len(numbers) + 0.4), layout="constrained")
    grid = figure.subplots(len(numbers), len(strongest), squeeze=False, sharex="col", sharey="row")
    count = len(columns[strongest[0]])
    rows = np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(int)
    for line, (name, unit) in zip(grid, numbers, strict=True):
        for axes, x in zip(line, strongest, strict=True):
            axes.plot(columns[x][rows], columns[name][rows], ".", markersize=3, color="#1b6ca8")
        line[0].set_ylabel(f"{name} [{unit}]" if unit else name)
    for axes, x in zip(grid[-1], strongest, strict=True):
        axes.set_xlabel(f"{x} [{units[x]}]" if units.get(x) else x)
    return figure
