"""Figures of the page."""

from __future__ import annotations

import itertools
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


CLAIMED = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Ends of the ranges of claimed probability."""


def binned(rows: Sequence[Score]) -> list[tuple[float, float, float, int, int]]:
    """For each range of claimed probability: its ends, the mean claim, how many findings are right, and of how many."""
    odds = [pair for r in rows if not r.spec["withheld"] for pair in r.odds]
    found = []
    for low, high in itertools.pairwise(CLAIMED):
        here = [(p, hit) for p, hit in odds if low <= p < high or p == high == 1.0]
        if here:
            found.append((low, high, sum(p for p, _ in here) / len(here), sum(hit for _, hit in here), len(here)))
    return found


def reliability(rows: Sequence[Score], path: Path) -> None:
    """Share of findings that are right against the probability that they claim, with 95 % bounds, as SVG."""
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(4.4, 4.0), layout="constrained")
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color=GREY, lw=0.8, ls=":", label="as claimed")
        table = binned(rows)
        claimed = [row[2] for row in table]
        shares = np.array([right / total for *_, right, total in table])
        bounds = np.array([wilson(right, total) for *_, right, total in table]).reshape(-1, 2)
        axes.errorbar(claimed, shares, np.abs(bounds.T - shares), fmt="o", color=BLUE, capsize=3, label="measured")
        for (*_, total), x, (low, _) in zip(table, claimed, bounds, strict=True):
            # Below its bar: points that claim nearly the same have bounds that differ.
            axes.annotate(str(total), (x, low), textcoords="offset points", xytext=(0, -11), fontsize=8, ha="center")
        axes.set(
            xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="claimed probability [1]", ylabel="share that is right [1]"
        )
        axes.grid(alpha=0.3)
        axes.legend(loc="lower left", fontsize=8)
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
