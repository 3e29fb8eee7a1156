"""Recordings against models as charts, and what rivals predict for the next experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from diagnosis.frequency_response.table_experiment import TableExperiment, tables
from diagnosis.verdict.figures import models
from flexarm.report.series import Chart, Panel, Trace

if TYPE_CHECKING:
    from diagnosis.estimation.experiment import Experiment
    from diagnosis.estimation.least_squares import Fit
    from diagnosis.verdict.experiment_design import Proposal
    from diagnosis.verdict.verdict import Diagnosis
    from engine.model import Model

ROLES = {"train": "fitted", "repeat": "fitted (repeat)", "hold_out": "held out"}
LABELS = {"nominal": "model as given", "refit": "refitted", "amended": "amended"}
DWARFS = 10.0
"""Ratio of errors beyond which one curve hides what is left over of the others."""
KEY = "before-after"


def before_after(found: Diagnosis) -> Chart:
    """Every recording, the held-out ones first, with each model and what it leaves over."""
    made = models(found)
    if not found.study.chosen.effects:
        del made["amended"]
    base = made["refit"].problem
    judged = [e.name for e in base.judged]
    chart = beside(made, [*base.judged, *(e for e in base.experiments if e.name not in judged)])
    nominal, refit = found.study.nominal[1], found.study.refit.hold_out
    if nominal < DWARFS * refit:
        return chart
    return _without_nominal(chart)


def beside(made: dict[str, Fit], shown: Sequence[Experiment]) -> Chart:
    """Recordings, with each model and what it leaves over; of tables all rows.

    Args:
        made: models by their keys in `LABELS`, ``refit`` among them.
        shown: recordings over time.
    """
    base = made["refit"].problem
    given = tables(base.experiments)
    if given:
        view = ("", _rows(made, base.model, given))
        return Chart(KEY, "Table and models over frequency", "frequency", "rad/s", (view,), log=True)
    views = [(f"{e.name} ({ROLES.get(e.role, e.role)})", _recording(made, base.model, e)) for e in shown]
    return Chart(KEY, "Recording and models over time", "time", "s", tuple(views), "Recording")


def _without_nominal(chart: Chart) -> Chart:
    note = (
        f"“{LABELS['nominal']}” is hidden at first, since its error would dwarf the others; press its name to show it."
    )
    return replace(chart, hidden=(LABELS["nominal"],), notes=[note])


def _recording(made: dict[str, Fit], model: Model, experiment: Experiment) -> tuple[Panel, ...]:
    left = {name: _left(fit, experiment) for name, fit in made.items()}
    panels = []
    for k, variable in enumerate(model.outputs):
        measured = experiment.measured[:, k]
        rows = [Trace("recording", experiment.time, measured, "recording")]
        rows += [Trace(LABELS[n], experiment.time, measured - r[:, k], n) for n, r in left.items()]
        panels.append(Panel(variable.name, variable.unit, tuple(rows)))
        rest = tuple(Trace(LABELS[n], experiment.time, r[:, k], n) for n, r in left.items())
        noise = 2 * float(experiment.sigma[k])
        panels.append(Panel(f"left over of {variable.name}", variable.unit, rest, (-noise, noise), "noise, ±2σ"))
    return tuple(panels)


def _left(fit: Fit, experiment: Experiment) -> NDArray[np.float64]:
    """Recorded less simulated, in the signals' units; NaN where nothing was recorded."""
    own = next(e for e in fit.problem.experiments if e.name == experiment.name)
    left = own.in_units(fit.problem.residual(fit.x, own))
    return np.where(np.isfinite(own.measured), left, np.nan)


def _rows(made: dict[str, Fit], model: Model, tables: list[TableExperiment]) -> tuple[Panel, ...]:
    """The rows of tables, fitted and held out, in the order of their frequencies."""
    frequency = np.concatenate([e.frequency for e in tables])
    order = np.argsort(frequency)
    frequency = frequency[order]
    measured = np.concatenate([e.measured for e in tables])[order]
    held = np.concatenate([np.full(len(e.frequency), e.role == "hold_out") for e in tables])[order]
    left = {name: np.concatenate([_left(fit, e) for e in tables])[order] for name, fit in made.items()}
    panels = []
    for k, variable in enumerate(model.outputs):
        below = f"({tables[0].unit})" if set("./") & set(tables[0].unit) else tables[0].unit
        unit = f"dB re 1 {variable.unit}/{below}"
        rows = [
            Trace(f"recording, {word}", frequency[chosen], measured[chosen, k], style, points=True)
            for word, chosen, style in (("fitted", ~held, "recording"), ("held out", held, "s4"))
            if chosen.any()
        ]
        rows += [Trace(LABELS[n], frequency, measured[:, k] - r[:, k], n) for n, r in left.items()]
        panels.append(Panel(variable.name, unit, tuple(rows)))
        rest = tuple(Trace(LABELS[n], frequency, r[:, k], n) for n, r in left.items())
        panels.append(Panel(f"left over of {variable.name}", "dB", rest))
    return tuple(panels)


def prediction(proposal: Proposal, units: dict[str, str]) -> Chart:
    """The input to apply, and what each rival predicts; ``units`` of the signals by name."""
    styles = ("amended", "refit", "s3", "s4", "s5", "s6")
    label, _, unit = proposal.axis.rstrip("]").partition(" [")
    table = unit != "s"
    x, drive = np.asarray(proposal.time), np.asarray(proposal.drive)
    order = np.argsort(x, kind="stable")
    given = Trace("input to apply", x[order], drive[order], "recording", points=table)
    panels = [Panel(proposal.input, proposal.unit, (given,))]
    for k, name in enumerate(proposal.signals):
        traces = tuple(
            Trace(rival, x[order], values[: len(x), k][order], styles[i % len(styles)], points=table)
            for i, (rival, values) in enumerate(proposal.predictions.items())
        )
        panels.append(Panel(name, "dB" if table else units.get(name, ""), traces))
    title = "Input to apply, and what each rival predicts"
    return Chart("prediction", title, "time" if label == "t" else label, unit, (("", tuple(panels)),), log=table)
