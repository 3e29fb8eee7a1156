"""Figures of a diagnosis: before and after on held-out data, what each place explains, and the fit of every model.

They are drawn without pyplot, which would choose a backend: a notebook has its own.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import Fit
from diagnosis.frequency_response.table_experiment import tables
from diagnosis.search.posterior import place_odds
from diagnosis.search.scored_model import ScoredModel
from diagnosis.verdict.table_report import draw
from diagnosis.verdict.verdict import Diagnosis, fit_table
from engine.figures import save
from engine.files import writing

COLOURS = {"recording": "#333333", "nominal": "#b0b0b0", "refit": "#c8405a", "amended": "#1a6aad"}

DWARFS = 10.0
"""Ratio beyond which what the model as given leaves over would flatten the other curves of its panel."""

FAINT = 1e-12
"""Odds below which their number says nothing more."""

PLACES = 10
"""Places that a figure shows at most."""


def _drawn(rows: int, columns: int, size: tuple[float, float], **shared: Any) -> tuple[Any, Any]:
    """A figure and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def models(diagnosis: Diagnosis) -> dict[str, Fit]:
    """The user's model as given, refitted, and amended."""
    from dataclasses import replace

    refit = diagnosis.study.refit.fit
    given = replace(refit, x=np.zeros(len(refit.problem.free)))
    return {"nominal": given, "refit": refit, "amended": diagnosis.study.chosen.fit}


def held_out(diagnosis: Diagnosis, path: Path) -> Path:
    """The first held-out recording against the three models, and what each leaves over."""
    made = models(diagnosis)
    if not diagnosis.study.chosen.effects:
        del made["amended"]
    base = made["refit"].problem
    held: Experiment = (base.judged)[0]
    outputs = base.model.outputs
    figure, axes = _drawn(2 * len(outputs), 1, (9, 3.4 * len(outputs) + 1), sharex=True)
    axes = axes[:, 0]
    table = tables([held])
    for k, variable in enumerate(outputs):
        above, below = axes[2 * k], axes[2 * k + 1]
        if table:
            draw((above, below), made, COLOURS, k)
            under = f"({table[0].unit})" if set("./") & set(table[0].unit) else table[0].unit
            above.set_ylabel(f"{variable.name}\n[dB re 1 {variable.unit}/{under}]", fontsize=9)
            below.set_ylabel("left over\n[dB]", fontsize=9)
            for axis in (above, below):
                _plain(axis)
                axis.margins(x=0.02)  # rings around the outermost rows are whole
            continue
        above.plot(held.time, held.measured[:, k], color=COLOURS["recording"], lw=1.6, label="recording")
        rest = {}
        for label, fit in made.items():
            e = next(x for x in fit.problem.experiments if x.name == held.name)
            left = fit.problem.residual(fit.x, e)[:, k] * e.sigma[k]
            style = "--" if label != "amended" else "-"
            above.plot(held.time, held.measured[:, k] - left, style, color=COLOURS[label], lw=1.2, label=label)
            rest[label] = left
        _left_over(below, held.time, rest, variable.unit)
        below.axhspan(-2 * held.sigma[k], 2 * held.sigma[k], color="#dddddd", zorder=0, label="noise, two sigma")
        above.set_ylabel(f"{variable.name}\n[{variable.unit}]", fontsize=9)
        below.set_ylabel(f"left over\n[{variable.unit}]", fontsize=9)
        for axis in (above, below):
            _plain(axis)
    role = "held out" if held.role == "hold_out" else "not held out"
    _legend(figure, axes[:2], f"{held.name}, {role}")
    figure.align_ylabels()
    axes[-1].set_xlabel("frequency [rad/s]" if table else "time [s]")
    return _save(figure, path)


def _left_over(axis: Any, time: Any, rest: dict[str, Any], unit: str) -> None:
    """What each model leaves over, without the one as given where that would flatten the others."""
    sizes = {label: float(np.nanmax(np.abs(left), initial=0.0)) for label, left in rest.items()}
    largest = sizes["nominal"]
    if largest > DWARFS * max(size for label, size in sizes.items() if label != "nominal"):
        rest = {label: left for label, left in rest.items() if label != "nominal"}
        axis.set_title(f"nominal not shown: it leaves up to {largest:.2g} {unit}", fontsize=8, loc="right")
    for label, left in rest.items():
        axis.plot(time, left, color=COLOURS[label], lw=1.0, label=label)


def _legend(figure: Any, axes: Any, title: str = "") -> None:
    """One legend above all axes, where it hides no curve."""
    shown: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    looks = {"loc": "outside upper center", "ncols": 6, "fontsize": 8, "frameon": False}
    figure.legend(shown.values(), shown.keys(), title=title or None, title_fontsize=10, **looks)


def _plain(axis: Any) -> None:
    axis.grid(True, color="#e4e4e4", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.margins(x=0)


def recovered(diagnosis: Diagnosis, path: Path) -> Path:
    """The force that is missing: over one held-out recording, and against what it depends on most."""
    found = diagnosis.recovered
    assert found is not None
    count = 1 + bool(found.curves)
    figure, axes = _drawn(1, count, (5.2 * count, 3.6))
    left = axes[0][0]
    band = 1.96 * found.deviation
    left.fill_between(found.time, found.force - band, found.force + band, color=COLOURS["amended"], alpha=0.2, lw=0)
    left.plot(found.time, found.force, color=COLOURS["amended"], lw=1.2)
    left.set_xlabel("time [s]")
    left.set_ylabel(f"missing at {found.place} [{found.unit}]", fontsize=9)
    left.set_title(found.recording, fontsize=10)
    if found.curves:
        right, curve = axes[0][1], found.curves[0]
        right.fill_between(curve.x, curve.low, curve.high, color=COLOURS["amended"], alpha=0.2, lw=0)
        right.plot(curve.x, curve.y, "o-", color=COLOURS["amended"], lw=1.2, ms=3)
        right.set_xlabel(f"{curve.x_label} [{curve.x_unit}]")
        right.set_ylabel(f"{curve.y_label} [{curve.y_unit}]", fontsize=9)
        right.set_title(f"mean over all recordings; explains {curve.share:.0%} of it", fontsize=10)
    for axis in axes[0]:
        axis.axhline(0, color="#333333", lw=0.6)
        axis.grid(True, color="#e4e4e4", lw=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    return _save(figure, path)


def odds(diagnosis: Diagnosis, path: Path) -> Path:
    """What the best effect at each place leaves over on held-out data, most likely place first, and its odds.

    The odds alone would show one bar: beside the right place all others are soon beyond any scale.
    """
    study = diagnosis.study
    shares = dict(list(place_odds(study.trials, study.odds).items())[:PLACES])
    names = list(shares) or ["nowhere"]
    errors = [_best(diagnosis, place).hold_out for place in shares] or [study.refit.hold_out]
    reach = [max(e, 1e-3) for e in (*errors, study.refit.hold_out, 1.0) if math.isfinite(e)]
    figure, axes = _drawn(1, 1, (8, 0.4 * len(names) + 1.6))
    axis, rows = axes[0, 0], np.arange(len(names))
    leads = [shares.get(name) == max(shares.values(), default=None) for name in names]
    axis.barh(rows, errors, 0.6, color=[COLOURS["amended"] if leading else "#b8cfe2" for leading in leads])
    axis.axvline(study.refit.hold_out, color=COLOURS["refit"], lw=1.2, ls="--", label="refit, nothing put in")
    axis.axvline(1.0, color="#333333", lw=1.0, ls=":", label="noise floor")
    if max(reach) > 5 * min(reach):
        axis.set_xscale("log")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.set_xlim(min(reach) / 1.5, max(reach) * 1.2)
    axis.set_yticks(rows, names)
    axis.invert_yaxis()
    beside = {"transform": axis.get_yaxis_transform(), "va": "center", "fontsize": 9}
    for row, share in zip(rows, shares.values(), strict=False):
        axis.text(1.02, row, f"{share:.2g}" if share >= FAINT else f"< {FAINT:g}", **beside)
    if shares:
        axis.text(1.02, 1.0, "odds", transform=axis.transAxes, va="bottom", fontsize=9)
    axis.set_xlabel(f"mean squared error / noise variance, {_judged(diagnosis)} data, with the best effect there")
    axis.grid(True, axis="x", color="#e4e4e4", lw=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    _legend(figure, [axis])
    return _save(figure, path)


def _best(diagnosis: Diagnosis, place: str) -> ScoredModel:
    """The trial from which the odds of a place come."""
    study = diagnosis.study
    there = [t for t in study.trials if t.keys in study.odds and place in {c.place for c in t.effects}]
    return max(there, key=lambda trial: study.odds[trial.keys])


def _judged(diagnosis: Diagnosis) -> str:
    return "held-out" if diagnosis.study.refit.fit.problem.held_out else "fitted"


def before_after(diagnosis: Diagnosis, path: Path) -> Path:
    """chi2 of each signal for the three models on both kinds of data; 1 is the noise floor."""
    table = fit_table(diagnosis.study)
    roles = [role for role in ("train", "hold_out") if table[role]["refit"]]
    signals = list(table["train"]["refit"])
    figure, axes = _drawn(1, len(roles), (max(4.5, 1.5 * len(signals)) * len(roles), 3.6), sharey=True)
    for axis, role in zip(axes[0], roles, strict=True):
        for j, label in enumerate(("nominal", "refit", "amended")):
            rows = table[role][label]
            values = [rows[name]["chi2"] for name in rows]
            axis.bar(np.arange(len(values)) + 0.26 * (j - 1), values, 0.24, color=COLOURS[label], label=label)
        axis.axhline(1.0, color="#333333", lw=0.8, ls=":", label="noise floor")
        axis.set_yscale("log")
        axis.set_xticks(range(len(signals)), signals, fontsize=8)
        axis.set_title("fitted" if role == "train" else "held out", fontsize=10)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0][0].set_ylabel("mean squared error / noise variance")
    _legend(figure, axes[0])
    return _save(figure, path)


def _save(figure: Any, path: Path) -> Path:
    with writing(path, (".png", ".pdf", ".svg")) as temporary:
        save(figure, temporary, dpi=130)
    return path
