"""The force that is missing: recovered over time at a place, without a name, and against what it depends on.

The residual of the refitted model is r = S dp + G w + e: G answers to a force w(t) at the place, straight lines between
knots, S to a change of the parameters within their tolerances, which is not to be mistaken for a force. With the prior
that w is smooth, the most probable w and its band follow from one linear system; how smooth, the data decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from blocks.registry import registry
from diagnosis.effects.effect import Candidate
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.time_experiment import TimeExperiment, over_time
from diagnosis.search.study import Study
from diagnosis.thresholds import RECOVERY
from engine.assemble import build
from engine.errors import FlexarmError, SimulationError
from engine.linearise import linearise
from engine.simulate import simulate
from engine.system import Connection, System
from scenarios.amend import AtFlange, Between, InSignal, Replace, Set


@dataclass(frozen=True)
class Curve:
    """The recovered force against one quantity.

    Attributes:
        title: what is shown.
        x_label, x_unit: what it is plotted against.
        y_label, y_unit: the force.
        x: centres of the bins, shape (bins,).
        y, low, high: mean of the force in each bin and its 95 % band, shape (bins,).
        share: of the force's variance that the curve explains.
        reach: the least and the greatest x that was met; the outermost bins' centres lie within.
    """

    title: str
    x_label: str
    x_unit: str
    y_label: str
    y_unit: str
    x: Array
    y: Array
    low: Array
    high: Array
    share: float
    reach: tuple[float, float]


@dataclass(frozen=True)
class RecoveredForce:
    """What is missing at a place, as a force over time and as curves.

    Attributes:
        place: where the force acts.
        unit: of the force.
        time, force, deviation: of one held-out recording: knots (s), force and its standard deviation, shape (knots,).
        recording: its name.
        curves: against speed, angle, input; the one that explains most first.
        log_odds: log evidence that a force acts here, against none.
    """

    place: str
    unit: str
    time: Array
    force: Array
    deviation: Array
    recording: str
    curves: tuple[Curve, ...]
    log_odds: float

    def numbers(self) -> dict[str, Any]:
        """As it stands in ``diagnosis.json``: the curves, the best first."""
        curves = [
            {
                "against": c.x_label,
                "unit": c.x_unit,
                "explains": c.share,
                "x": c.x.tolist(),
                "force": c.y.tolist(),
                "low": c.low.tolist(),
                "high": c.high.tolist(),
            }
            for c in self.curves
        ]
        return {"place": self.place, "unit": self.unit, "log_odds": self.log_odds, "curves": curves}


@dataclass(frozen=True)
class _Recovered:
    """The force in one recording."""

    experiment: TimeExperiment
    time: Array
    force: Array
    deviation: Array
    log_odds: float


def recover(study: Study, flange: str, unit: str = "N.m") -> RecoveredForce | None:
    """The force that is missing at a flange or an input, if the model can be linearised there.

    Args:
        study: with the refitted model.
        flange: ``block.port`` of a flange, or of a driven input.
        unit: of the force.
    """
    base, x = study.refit.fit, study.refit.fit.x
    problem, loose = base.problem, RECOVERY.loose
    if study.chosen.effects:
        # With the parameters of the amended model, which has no need to bend them, the force shows in full.
        found_values = study.chosen.fit.parameters()
        x = np.array([f.position(found_values.get(f.name, f.value(v))) for f, v in zip(problem.free, x, strict=True)])
        loose = 0.0
    parameters = problem.values(x)[0]
    experiments = [e for e in over_time(problem.experiments) if not e.uneven]
    if not flange or not experiments:
        return None
    try:
        answer = _answer(study, flange, parameters, experiments[0])
    except (FlexarmError, np.linalg.LinAlgError):
        return None
    found = []
    for e in experiments:
        try:
            r, J = problem.linearised(x, e)
        except SimulationError:
            continue  # where the model runs away from the recording there is nothing to compare
        found.append(_one(e, r.reshape(len(e.time), -1), loose * J.reshape(len(e.time), -1, J.shape[1]), answer))
    if not found:
        return None
    curves = _curves(study, flange, unit, parameters, found)
    held = [f for f in found if f.experiment.role == "hold_out"] or found
    shown = max(held, key=lambda f: float(np.ptp(f.force)))
    return RecoveredForce(
        flange,
        unit,
        shown.time,
        shown.force,
        shown.deviation,
        shown.experiment.name,
        tuple(sorted(curves, key=lambda c: -c.share)),
        sum(f.log_odds for f in found),
    )


def place_of(effect: Candidate, study: Study) -> tuple[str, str]:
    """The flange or input at which the force of an effect acts, and the force's unit; empty if there is none."""
    problem = study.refit.fit.problem
    for edit in effect.edits(effect.starts[0]):
        if isinstance(edit, InSignal):
            return edit.target, next((v.unit for v in problem.model.inputs if v.name == edit.target), "")
        flange = edit.target if isinstance(edit, AtFlange | Between) else ""
        if isinstance(edit, Set | Replace):
            groups = study.scales.groups.items()
            flange = next((f for f, m in groups if any(end.startswith(f"{edit.name}.") for end in (f, *m))), "")
        if flange:
            return flange, "N" if flange in study.scales.slides else "N.m"
    return "", ""


def _answer(study: Study, flange: str, parameters: dict[str, float], e: TimeExperiment) -> Array:
    """Outputs after one hat of force at the first knot, at the kept instants, shape (rows, signals)."""
    problem = study.refit.fit.problem
    system, outputs = problem.scenario.system, [v.name for v in problem.model.outputs]
    inputs = [v.name for v in problem.model.inputs]
    if flange in inputs:
        probe, probed = flange, system
    else:
        sliding = flange in study.scales.slides
        kind, port, effort = ("Force", "flange", "force") if sliding else ("Torque", "shaft", "torque")
        probe = f"probe.{effort}"
        blocks = {**system.blocks, "probe": registry()[kind]()}
        links = [*system.connections, Connection((flange, f"probe.{port}"))]
        probed = System(blocks, links, system.shared, system.initial, system.places)
    model = build(probed, inputs=[probe, *(i for i in inputs if i != probe)], outputs=outputs)
    modes = {m.name: "sliding forward" for m in model.modes if m.kind == "friction"}
    values = {p.name: parameters[p.name] for p in model.parameters if p.name in parameters}
    plant = linearise(model, modes=modes, parameters=values)
    dt = RECOVERY.knot / RECOVERY.rows_per_knot
    n = len(plant.A)
    # Exact for a force that changes along straight lines: the force and its slope are two more states.
    big = np.zeros((n + 2, n + 2))
    big[:n, :n], big[:n, n : n + 1], big[n, n + 1] = plant.A, plant.B[:, :1], 1.0
    step = scipy.linalg.expm(big * dt)
    rows = int(e.time[-1] / dt) + 1
    made = np.zeros((rows, len(outputs)))
    x = np.zeros(n + 2)
    for k in range(rows):
        x[n], x[n + 1] = (
            _hat(k),
            (
                1 / RECOVERY.knot
                if k < RECOVERY.rows_per_knot
                else -1 / RECOVERY.knot
                if k < 2 * RECOVERY.rows_per_knot
                else 0.0
            ),
        )
        made[k] = plant.C @ x[:n] + plant.D[:, 0] * x[n]
        x = step @ x
    return made


def _hat(k: int) -> float:
    return max(0.0, 1 - abs(k / RECOVERY.rows_per_knot - 1))


def _one(e: TimeExperiment, r: Array, slopes: Array, answer: Array) -> _Recovered:
    """The most probable force of one recording, with its standard deviation."""
    dt = RECOVERY.knot / RECOVERY.rows_per_knot
    places = np.round(np.arange(0, e.time[-1], dt) / (e.time[1] - e.time[0])).astype(int)
    keep = np.unique(np.clip(places, 0, len(r) - 1))
    rows, knots = len(keep), len(keep) // RECOVERY.rows_per_knot + 1
    signals = r.shape[1]
    G = np.zeros((rows, signals, knots))
    for j in range(knots):
        first = (j - 1) * RECOVERY.rows_per_knot
        a, b = max(first, 0), max(-first, 0)
        count = min(rows - a, len(answer) - b)
        if count > 0:
            G[a : a + count, :, j] = answer[b : b + count] / e.sigma
    fixed = np.asarray(e.from_first)
    G = np.where(fixed[None, :, None], G - G[:1], G)
    y, design = r[keep].reshape(-1), G.reshape(-1, knots)
    S = -slopes[keep].reshape(len(y), -1)
    scale = float(np.sqrt(np.mean(np.sum(design**2, axis=0)))) or 1.0
    bend = np.diff(np.eye(knots), 2, axis=0)
    # The parameters' changes are solved for together with the force, and then not looked at.
    whole = np.column_stack([design / scale, S])
    data, seen = whole.T @ whole, whole.T @ y
    smooth = 16 * bend.T @ bend + 0.02 * np.eye(knots)
    volume = float(np.linalg.slogdet(smooth)[1])
    best: tuple[float, Array, Array] | None = None
    for size in np.geomspace(0.1, 1e5, 13):
        prior = scipy.linalg.block_diag(smooth / size**2, np.eye(S.shape[1]))
        factor = scipy.linalg.cholesky(data + prior)
        w = scipy.linalg.cho_solve((factor, False), seen)
        spread = 2 * float(np.sum(np.log(np.diag(factor)))) - (volume - 2 * knots * math.log(size))
        odds = 0.5 * float(seen @ w) - 0.5 * spread
        if best is None or odds > best[0]:
            best = (odds, w[:knots] / scale, factor)
    assert best is not None
    variance = np.diag(scipy.linalg.lapack.dpotri(best[2])[0])[:knots]
    knot: Array = RECOVERY.knot * np.arange(knots, dtype=float)
    return _Recovered(e, knot, best[1], np.sqrt(variance) / scale, best[0])


def _curves(
    study: Study, flange: str, unit: str, parameters: dict[str, float], found: Sequence[_Recovered]
) -> list[Curve]:
    """The force against what it may depend on, over all recordings."""
    problem = study.refit.fit.problem
    system, inputs = problem.scenario.system, [v.name for v in problem.model.inputs]
    names = [] if flange in inputs else [f"{flange}.{q}" for q in ("speed", "angle")]
    rows: dict[str, list[Array]] = {name: [] for name in [*names, *inputs]}
    forces: list[Array] = []
    try:
        model = build(system, inputs, names or [v.name for v in problem.model.outputs])
    except FlexarmError:
        names = []
        rows = {name: [] for name in inputs}
        model = problem.model
    units = {v.name: v.unit for v in (*model.outputs, *model.inputs)}
    for f in found:
        e = f.experiment
        values = {p.name: parameters[p.name] for p in model.parameters if p.name in parameters}
        try:
            run = simulate(model, e.stop, e.step, drive=e.drive, internal_step=problem.internal_step, parameters=values)
        except FlexarmError:
            continue
        forces.append(f.force)
        for name in names:
            rows[name].append(np.interp(f.time, run.time, run[name]))
        if e.drive is not None:
            instants = np.asarray(e.drive.time, dtype=float)
            table = np.asarray(e.drive.values, dtype=float).reshape(len(instants), -1)
            for k, name in enumerate(inputs):
                rows[name].append(np.interp(f.time, instants, table[:, k]))
    if not forces:
        return []
    w = np.concatenate(forces)
    label = f"missing at {flange}"
    made = [
        _binned((name, units.get(name, "")), (label, unit), np.concatenate(x), w)
        for name, x in rows.items()
        if len(x) == len(forces)
    ]
    return [c for c in made if c is not None]


def _binned(of: tuple[str, str], force: tuple[str, str], x: Array, w: Array) -> Curve | None:
    """Mean of the force in bins of equal count, with the band of the mean."""
    if np.ptp(x) <= 0:
        return None
    parts = [part for part in np.array_split(np.argsort(x, kind="stable"), RECOVERY.bins) if len(part) > 2]
    if len(parts) < 4:
        return None
    y = np.array([w[p].mean() for p in parts])
    # Neighbouring knots are not independent: a fifth of them count.
    half = 1.96 * np.array([w[p].std() / math.sqrt(max(len(p) / 5, 1)) for p in parts])
    spread = sum(float(np.sum((w[p] - w[p].mean()) ** 2)) for p in parts)
    total = float(np.sum((w - w.mean()) ** 2))
    share = 1 - spread / total if total > 0 else 0.0
    title = f"{force[0]} against {of[0]}"
    middle = np.array([x[p].mean() for p in parts])
    return Curve(title, *of, *force, middle, y, y - half, y + half, share, (float(x.min()), float(x.max())))
