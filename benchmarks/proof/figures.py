"""Figures of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.proof.score import Score, wilson
from benchmarks.proof.summary import FLOOR_BOUND, amended, by_size, confusion
from engine.files import writing

BLUE, RED, GREEN, GREY = "#1b6ca8", "#d1495b", "#2e8b57", "#5c5c5c"
STYLE: dict[str, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "svg.hashsalt": "proof"}


def power(rows: Sequence[Score], path: Path) -> None:
    """Rates against effect size, and the distribution of held-out errors, as SVG."""
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        table = by_size(rows)
        sizes = sorted({size for found in table.values() for size in found})
        for test, text, color in (
            (lambda r: r.right, "right name or correct tie", BLUE),
            (lambda r: bool(r.placed), "right place", GREEN),
            (lambda r: r.claimed, "wrong name claimed", RED),
        ):
            counts = [[test(r) for found in table.values() for r in found.get(size, [])] for size in sizes]
            shares = np.array([np.mean(c) for c in counts])
            bounds = np.array([wilson(sum(c), len(c)) for c in counts]).reshape(-1, 2)
            reach = np.abs(bounds.T - shares)
            left.errorbar(sizes, shares, reach, fmt="o-", color=color, label=text, capsize=3, lw=1.5)
        left.set(xscale="log", ylim=(-0.03, 1.03), xlabel="effect size [detection thresholds]", ylabel="share of cases")
        left.set_xticks(sizes, [f"{size:g}" for size in sizes])
        left.minorticks_off()
        if sizes:
            left.legend(loc="center right", fontsize=8)
        errors = np.array(amended(rows)).reshape(-1, 3)
        for k, (text, color) in enumerate((("nominal", GREY), ("refit alone", RED), ("amended", BLUE))):
            values = np.sort(errors[:, k])
            right.step(values, np.arange(1, len(values) + 1) / max(len(values), 1), color=color, label=text)
        right.axvline(FLOOR_BOUND, color="k", lw=0.8, ls=":")
        right.set(xscale="log", xlabel="held-out error [mean square over the floor]", ylabel="share of cases")
        if len(errors):
            right.legend(loc="lower right", fontsize=8)
        for axes in (left, right):
            axes.grid(alpha=0.3)
        with writing(path, (".svg",)) as temporary:
            figure.savefig(temporary, metadata={"Date": None})


def matrix(rows: Sequence[Score], path: Path) -> None:
    """Confusion matrix, truth against report, as PNG."""
    table = confusion(rows)
    truths = sorted(table, key=lambda name: (name in ("none", "wrong_parameter"), name))
    others = sorted({name for counts in table.values() for name in counts} - set(truths))
    columns = [*truths, *others]
    shares = np.array([[table[t][c] for c in columns] for t in truths], dtype=float).reshape(len(truths), len(columns))
    figure = Figure(figsize=(1.5 + 0.27 * len(columns), 1.5 + 0.25 * len(truths)), dpi=80, layout="constrained")
    axes = figure.subplots()
    totals = np.maximum(shares.sum(axis=1, keepdims=True), 1)
    if shares.size:
        axes.imshow(shares / totals, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for i, row in enumerate(shares):
        for j, count in enumerate(row):
            if count:
                dark = count / totals[i, 0] > 0.6
                axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=7, color="w" if dark else "k")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(truths)), truths, fontsize=7)
    axes.set(xlabel="reported", ylabel="concealed")
    with writing(path, (".png",)) as temporary:
        figure.savefig(temporary)
