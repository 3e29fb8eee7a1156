"""What a worker does for a sweep: builds models, runs a span of the plan, sums each run up."""

from __future__ import annotations

import functools
import math
import threading
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.errors import FlexarmError
from engine.rows import check_rows
from flexarm._version import version
from flexarm.sweeps.plan import Run, SweepPlan
from scenarios.files import block_files, unpacked

if TYPE_CHECKING:
    from engine.model import Model
    from engine.simulate import Result
    from scenarios.load import Scenario

SUMMARIES = ("final", "min", "max", "rms")
"""What is kept of an output: its last, least and greatest recorded value, and its root mean square over the rows."""

_BUILT = 16
"""Models that a worker keeps."""

_building = threading.Lock()


@dataclass(frozen=True)
class Span:
    """The rows of consecutive runs.

    Attributes:
        columns: values by column: numbers, or texts and None.
        trajectories: columns ``run``, ``time`` and the outputs, if they are kept.
    """

    columns: dict[str, Any]
    trajectories: dict[str, Any] | None


@dataclass(frozen=True)
class Built:
    """A model, and how long to run it."""

    model: Model
    stop: float
    step: float
    internal_step: float | None
    every: int


def compute(plan: SweepPlan, span: tuple[int, int]) -> Span:
    """Do the runs from ``span[0]`` up to ``span[1]``, the last excluded."""
    if version() != plan.version:
        raise FlexarmError(
            f"a worker has flexarm {version()}, the sweep was started by {plan.version}",
            remedy="install the same version everywhere",
        )
    rows: list[dict[str, Any]] = []
    kept: list[tuple[int, Result, int]] = []
    runs = (plan.run(number) for number in range(*span))
    for structure, group in groupby(runs, key=lambda run: run.structure):
        for run, result, values in _runs(plan, structure, list(group)):
            rows.append(_row(plan, run, result, values))
            if plan.keep is not None and not isinstance(result, str):
                kept.append((run.number, result, _built(plan, structure).every))
    columns = {name: [row[name] for row in rows] for name in (rows[0] if rows else {})}
    return Span(columns, _trajectories(plan, kept) if plan.keep is not None else None)


def _runs(
    plan: SweepPlan, structure: tuple[str, ...], runs: list[Run]
) -> Iterator[tuple[Run, Result | str, list[float]]]:
    """Runs of one model: each with its result, or why there is none, and the values that were drawn."""
    from engine.batch import Case, Failure, batch

    nothing = [math.nan] * len(plan.samples)
    try:
        built = _built(plan, structure)
        own = [built.model.parameters[built.model.parameter_index(sample.name)].value for sample in plan.samples]
    except FlexarmError as error:
        for run in runs:
            yield run, error.message, nothing
        return
    drawn = [
        [sample.at(share, value) for sample, share, value in zip(plan.samples, run.shares, own, strict=True)]
        for run in runs
    ]
    names = [sample.name for sample in plan.samples]
    cases = [
        Case(run.parameters | dict(zip(names, values, strict=True))) for run, values in zip(runs, drawn, strict=True)
    ]
    done = 0
    while done < len(runs):
        found = batch(built.model, cases[done:], built.stop, built.step, internal_step=built.internal_step, workers=1)
        try:
            for result in found:
                yield runs[done], result.reason if isinstance(result, Failure) else result, drawn[done]
                done += 1
        except FlexarmError as error:  # values that do not fit end a batch; the runs after this one are another
            yield runs[done], error.message, drawn[done]
            done += 1


def _row(plan: SweepPlan, run: Run, result: Result | str, drawn: list[float]) -> dict[str, Any]:
    row: dict[str, Any] = {"run": run.number}
    for axis, k in zip(plan.axes, run.point, strict=True):
        row[axis.key] = axis.numbers[k] if axis.numbers else axis.texts[k]
    row |= {sample.name: value for sample, value in zip(plan.samples, drawn, strict=True)}
    for name, _ in plan.outputs:
        found = [math.nan] * len(SUMMARIES) if isinstance(result, str) else _summary(result[name])
        row |= {f"{name}.{kind}": value for kind, value in zip(SUMMARIES, found, strict=True)}
    row["failure"] = result if isinstance(result, str) else None
    for metric in plan.metrics:
        try:
            row[metric.name] = math.nan if isinstance(result, str) else metric.of(result)
        except FlexarmError as error:
            row[metric.name], row["failure"] = math.nan, error.message
    return row


def _summary(values: Any) -> list[float]:
    return [
        float(values[-1]),
        float(values.min()),
        float(values.max()),
        math.sqrt(float(np.mean(np.square(values)))),
    ]


def _trajectories(plan: SweepPlan, kept: list[tuple[int, Result, int]]) -> dict[str, Any]:
    parts: dict[str, list[Any]] = {"run": [], "time": [], **{name: [] for name, _ in plan.outputs}}
    for number, result, every in kept:
        time = result.time[::every]
        parts["run"].append(np.full(len(time), number, dtype=np.int64))
        parts["time"].append(time)
        for name, _ in plan.outputs:
            parts[name].append(result[name][::every])
    empty = {"run": np.empty(0, dtype=np.int64)}
    return {name: np.concatenate(v) if v else empty.get(name, np.empty(0)) for name, v in parts.items()}


def _built(plan: SweepPlan, structure: tuple[str, ...]) -> Built:
    with _building:  # workers of a cluster may have several threads
        return _kept(plan, structure)


@functools.lru_cache(_BUILT)
def _kept(plan: SweepPlan, structure: tuple[str, ...]) -> Built:
    return build(plan, structure)


def build(plan: SweepPlan, structure: tuple[str, ...]) -> Built:
    """The model with further overrides, and its times.

    Raises:
        FlexarmError: it cannot be built, does not say how long to run, or the scenario was changed since.
    """
    from scenarios.load import load

    path = unpacked(plan.files) if plan.files else Path(plan.scenario)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scenario = load(path if path.is_file() else plan.scenario, [*plan.overrides, *structure])
        if digest(load(scenario.path, plan.overrides)) != plan.digest:
            raise FlexarmError("the scenario was changed while the sweep ran", remedy="begin again, with --restart")
        model = scenario.build(outputs=[name for name, _ in plan.outputs])
    planned = scenario.simulation
    stop = plan.stop if plan.stop is not None else planned.stop if planned else None
    if stop is None:
        raise FlexarmError(
            "the scenario does not say how long to simulate",
            remedy="add 'simulate: {stop: 4 s}', or give --stop",
        )
    step = plan.step if plan.step is not None else planned.step if planned else 1e-3
    check_rows(stop, step)
    every = 1
    if plan.keep is not None:
        every = max(1, round(plan.keep / step))
        if abs(every * step - plan.keep) > 1e-6 * plan.keep:
            raise FlexarmError(
                f"trajectories every {plan.keep:g} s do not go with rows every {step:g} s",
                remedy=f"give a multiple, such as {every * step:g} s",
            )
    return Built(model, stop, step, planned.internal_step if planned else None, every)


def digest(scenario: Scenario) -> str:
    """Identifies a scenario with its overrides, and the files that its blocks read."""
    import hashlib

    made = hashlib.sha256(scenario.digest.encode())
    for path in block_files(scenario):
        made.update(path.read_bytes())
    return made.hexdigest()[:16]
