"""Figures of a diagnosis: before and after on held-out data, the odds of each place, and the fit of every model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.fit import Fit
from diagnosis.problem import Experiment
from diagnosis.sines import Sines
from diagnosis.sines_report import draw
from diagnosis.verdict import Diagnosis, fit_table, place_odds
from engine.files import writing

COLOURS = {"recording": "#333333", "nominal": "#b0b0b0", "refit": "#c8405a", "amended": "#1a6aad"}


def _plt() -> Any:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    return plt


def models(diagnosis: Diagnosis) -> dict[str, Fit]:
    """The user's model as given, refitted, and amended."""
    from dataclasses import replace

    refit = diagnosis.study.refit.fit
    given = replace(refit, x=np.zeros(len(refit.problem.free)))
    return {"nominal": given, "refit": refit, "amended": diagnosis.study.chosen.fit}


def held_out(diagnosis: Diagnosis, path: Path) -> Path:
    """The first held-out recording against the three models, and what each leaves over."""
    plt = _plt()
    made = models(diagnosis)
    base = made["refit"].problem
    held: Experiment = (base.chosen("hold_out") or base.chosen("train", "repeat"))[0]
    outputs = base.model.outputs
    figure, axes = plt.subplots(
        2 * len(outputs), 1, sharex=True, figsize=(9, 3.4 * len(outputs) + 1), layout="constrained"
    )
    table = isinstance(held, Sines)
    for k, variable in enumerate(outputs):
        above, below = axes[2 * k], axes[2 * k + 1]
        if isinstance(held, Sines):
            draw((above, below), made, COLOURS, k)
            above.set_ylabel(f"{variable.name}\n[dB re 1 {held.unit}]", fontsize=9)
            below.set_ylabel("left over\n[dB]", fontsize=9)
            for axis in (above, below):
                _plain(axis)
            continue
        above.plot(held.time, held.measured[:, k], color=COLOURS["recording"], lw=1.6, label="recording")
        for label, fit in made.items():
            e = next(x for x in fit.problem.experiments if x.name == held.name)
            left = fit.problem.residual(fit.x, e)[:, k] * e.sigma[k]
            style = "--" if label != "amended" else "-"
            above.plot(held.time, held.measured[:, k] - left, style, color=COLOURS[label], lw=1.2, label=label)
            below.plot(held.time, left, color=COLOURS[label], lw=1.0, label=label)
        below.axhspan(-2 * held.sigma[k], 2 * held.sigma[k], color="#dddddd", zorder=0, label="noise, two sigma")
        above.set_ylabel(f"{variable.name}\n[{variable.unit}]", fontsize=9)
        below.set_ylabel(f"left over\n[{variable.unit}]", fontsize=9)
        for axis in (above, below):
            _plain(axis)
    axes[0].legend(ncols=4, fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0, 1))
    axes[1].legend(ncols=4, fontsize=8, frameon=False, loc="upper right")
    axes[-1].set_xlabel("frequency [rad/s]" if table else "time [s]")
    role = "held out" if held.role == "hold_out" else "not held out"
    figure.suptitle(f"{held.name} ({role})", x=0.99, ha="right", fontsize=10)
    return _save(figure, path, plt)


def _plain(axis: Any) -> None:
    axis.grid(True, color="#e4e4e4", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.margins(x=0)


def recovered(diagnosis: Diagnosis, path: Path) -> Path:
    """The force that is missing: over one held-out recording, and against what it depends on most."""
    plt = _plt()
    found = diagnosis.recovered
    assert found is not None
    count = 1 + bool(found.curves)
    figure, axes = plt.subplots(1, count, figsize=(5.2 * count, 3.6), layout="constrained", squeeze=False)
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
        right.set_title(f"mean over all recordings; explains {curve.share:.0%} of it", fontsize=10)
    for axis in axes[0]:
        axis.axhline(0, color="#333333", lw=0.6)
        axis.grid(True, color="#e4e4e4", lw=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    return _save(figure, path, plt)


def odds(diagnosis: Diagnosis, path: Path) -> Path:
    """Odds of each place as bars, on a scale of tenfold steps."""
    plt = _plt()
    found = dict(list(place_odds(diagnosis.study).items())[:10]) or {"nowhere": 1.0}
    names, values = list(found)[::-1], [max(v, 1e-12) for v in found.values()][::-1]
    figure, axis = plt.subplots(figsize=(8, 0.45 * len(names) + 1.3), layout="constrained")
    axis.barh(names, values, color=[COLOURS["amended"] if v == max(values) else "#b8cfe2" for v in values])
    axis.set_xscale("log")
    axis.set_xlim(1e-12, 3)
    axis.set_xlabel("odds that something is missing here")
    axis.grid(True, axis="x", color="#e4e4e4", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    return _save(figure, path, plt)


def before_after(diagnosis: Diagnosis, path: Path) -> Path:
    """chi2 of each signal for the three models on both kinds of data; 1 is the noise floor."""
    plt = _plt()
    table = fit_table(diagnosis.study)
    roles = [role for role in ("train", "hold_out") if table[role]["refit"]]
    signals = list(table["train"]["refit"])
    figure, axes = plt.subplots(
        1, len(roles), sharey=True, figsize=(4.5 * len(roles), 3.6), layout="constrained", squeeze=False
    )
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
    axes[0][-1].legend(fontsize=8, frameon=False)
    return _save(figure, path, plt)


def _save(figure: Any, path: Path, plt: Any) -> Path:
    try:
        with writing(path, (".png", ".pdf", ".svg")) as temporary:
            figure.savefig(temporary, dpi=130)
    finally:
        plt.close(figure)
    return path
