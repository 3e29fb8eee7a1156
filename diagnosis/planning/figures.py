"""The figure of a plan: the smallest size of each effect, and which effects could not be told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diagnosis.planning.plan import Plan
from diagnosis.planning.wording import size_in_words
from engine.figures import save
from engine.files import writing

APART, OPEN, STAYS = "#e8eef4", "#e6a15c", "#b03a48"
"""Told apart, tied at the first size, and still at the last."""

BAR = "#1a6aad"


def matrix(found: Plan, path: Path) -> Path:
    """Write the figure.

    Raises:
        FlexarmError: the file cannot be written.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    shown = found.shown
    count = len(shown)
    figure = Figure(figsize=(15, max(3.0, 1.6 + 0.23 * count)), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.0, 1.1)})
    places = np.arange(count)
    relative = np.array([row.relative if row.relative else np.nan for row in shown])
    left.barh(places, relative, color=BAR, height=0.7)
    least = np.nanmin(relative) if np.isfinite(relative).any() else 1e-3
    left.set_xscale("log")
    left.set_xlim(least / 3, 1e3 * max(1.0, float(np.nanmax(relative))) if np.isfinite(relative).any() else 1.0)
    for k, row in enumerate(shown):
        at = row.relative if row.relative else least / 2
        left.text(1.2 * at, k, size_in_words(row), va="center", fontsize=7)
    left.set_yticks(places, [f"{row.label}  {row.number}" for row in shown], fontsize=7)
    left.set_xlabel("smallest size that shows, over a size that matters")
    left.set_ylim(count - 0.5, -0.5)
    left.spines[["top", "right"]].set_visible(False)
    first, last = found.multiples[0], found.multiples[-1]
    number = {row.number: k for k, row in enumerate(shown)}
    cells = np.zeros((count, count))
    for level, multiple in ((1.0, first), (2.0, last)):
        if level == 2.0 and last == first:
            continue
        for i, j in found.tied[multiple]:
            a, b = number[i], number[j]
            cells[a, b] = cells[b, a] = level
    right.imshow(cells, cmap=ListedColormap([APART, OPEN, STAYS]), vmin=0, vmax=2, aspect="auto")
    names = [str(row.number) for row in shown]
    right.set_xticks(places, names, fontsize=6, rotation=90)
    right.set_yticks(places, names, fontsize=7)
    right.set_xticks(places - 0.5, minor=True)
    right.set_yticks(places - 0.5, minor=True)
    right.grid(which="minor", color="white", lw=0.8)
    right.tick_params(which="both", length=0)
    right.spines[:].set_visible(False)
    right.set_title("Which could be told apart", fontsize=10)
    handles = [Patch(color=APART, label="told apart"), Patch(color=OPEN, label=f"not at {first:g} times that size")]
    if last != first:
        handles.append(Patch(color=STAYS, label=f"nor at {last:g} times"))
    right.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=3, fontsize=8, frameon=False)
    left.set_title("The smallest size of each effect", fontsize=10)
    figure.suptitle(f"{found.scenario.name}: what this experiment could tell", fontsize=11)
    with writing(path, (".png",)) as temporary:
        save(figure, temporary, dpi=110)
    return path
