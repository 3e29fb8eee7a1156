"""Families of linear models of a scenario: over a grid, along its own run, or in every combination of modes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from engine.errors import FlexarmError, ParameterError, Where
from engine.family import Axis, LinearFamily, collect, combinations, scheduling_axis
from engine.family import grid as over_grid
from engine.linear_modes import deaf
from engine.linearise import Point, operating_point
from engine.model import TIME, Model
from engine.quantity import number_or_text
from flexarm.cut import Cut
from flexarm.design.point import motion_units, point, start_of, trim_arguments, wanted
from flexarm.sweeps.plan import parameters_of, texts_of
from scenarios.load import si

MOST_SNAPSHOTS = 10_000
"""Snapshots of one run."""


def grid(
    made: Cut,
    axes: Mapping[str, str | Sequence[float]],
    *,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
) -> LinearFamily:
    """A family over scheduling variables.

    Args:
        made: the model.
        axes: parameter, state, motion or input -> ``START:STOP:N`` or ``A,B,C`` with units, or SI numbers.
        modes: that are held; another is that of each point.
        at: the point otherwise; see `flexarm.api.linearise`.
        trim: an analysis of kind ``trim``: each member is at the equilibrium that has the axes' values.

    Raises:
        FlexarmError: a scheduling variable that is not one, values outside of the bounds of a parameter, a key that
            changes which states there are, no equilibrium at a point of the grid.
    """
    if not axes:
        raise FlexarmError(
            "a grid needs a scheduling variable", remedy="such as --grid 'arm.joint2.angle=-90 deg:90 deg:11'"
        )
    model = made.model
    found = [_axis(made, key, values) for key, values in axes.items()]
    asked = point(made, modes, at)
    for axis in found:
        asked["at"].pop(axis.name, None)
        asked["inputs"].pop(axis.name, None)
    own = {p.name for p in model.parameters}
    balance = trim or made.settings.options.get("trim")
    rest = trim_arguments(made, balance, modes) if balance else {}
    names = [v.name for v in (*model.states, *model.memories)]
    last: list[Point] = []

    def balanced(x: dict[str, float], u: dict[str, float], p: dict[str, float]) -> Point:
        from engine.trim import trim as solve

        values = {axis.name: {**x, **u}[axis.name] for axis in found if axis.name not in own}
        begin = dict(zip(names, [*last[-1].x.tolist(), *last[-1].d.tolist()], strict=True)) if last else x
        fix = {**rest["fix"], **{k: v for k, v in values.items() if k not in u}}
        try:
            there = solve(model, at=begin, inputs=u, parameters=p, tries=0, **{**rest, "fix": fix})
        except FlexarmError as error:
            where = ", ".join(f"{k} = {v:g}" for k, v in {**values, **p}.items())
            error.message = f"at {where}: {error.message}"
            raise
        last.append(there.point)
        return there.point

    find = balanced if balance else None
    family = over_grid(model, found, **asked, find=find)
    return _heard(made, family, found, asked, find)


def _heard(made: Cut, family: LinearFamily, axes: list[Axis], asked: dict[str, Any], find: Any) -> LinearFamily:
    """The family itself, or, where an input moves nothing in some member, that of modes in which it does."""
    from engine.linear_modes import audible
    from engine.linearise import linearise_at

    silent = next((k for k in range(len(family)) if deaf(family.kept(k))), None)
    if silent is None:
        return family
    there = family[silent].point
    names = {v.name for v in made.model.inputs}
    where = {
        "at": {k: v for k, v in there.items() if k not in names},
        "inputs": {k: there[k] for k in names},
        "parameters": family.parameters[silent],
        "modes": asked["modes"],
    }
    here = linearise_at(made.model, operating_point(made.model, **where), asked["modes"])
    heard = audible(made.model, here, **where)
    if not heard.assumed:
        return family
    chosen = {k: v for k, v in heard.modes.items() if v != here.modes[k]}
    again = over_grid(made.model, axes, **{**asked, "modes": {**asked["modes"], **chosen}}, find=find)
    return replace(again, assumed=heard.assumed)


def _axis(made: Cut, key: str, values: str | Sequence[float]) -> Axis:
    model, name = made.model, made.scenario.resolve(key)
    stated = made.settings.options.get("grid", {}).get(key) == values and made.settings.name
    where = made.scenario.where("analyses", stated, "grid", key) if stated else Where(f"--grid {key}")
    own = {p.name: p for p in model.parameters}
    units = {name: p.unit for name, p in own.items()} | motion_units(made) | {v.name: v.unit for v in model.inputs}
    names = parameters_of(model, name)
    if name not in units and len(names) == 1:
        name = names[0]
    try:
        if name not in units and _is_key(made, name):
            raise ParameterError(
                f"'{key}' shapes the model: its members would differ in states, and a family has one order of states",
                remedy=f"make a family for each value, by --set {key}=VALUE",
            )
        if isinstance(values, str):
            numbers = [si(number_or_text(text), units, name) for text in texts_of(values)] if name in units else []
        else:
            numbers = [float(v) for v in values]
            if not numbers:
                raise ParameterError(f"no values are given for '{key}'", remedy="give at least one")
        return scheduling_axis(model, name, numbers)
    except FlexarmError as error:
        raise error.at(where) from None


def verify(made: Cut) -> None:
    """Hold what an analysis says of its point, equilibrium and grid against the model, without working it out.

    Raises:
        FlexarmError: something does not fit, with its place in the file.
    """
    options = made.settings.options
    point(made, None, None)
    if made.settings.kind == "trim":
        wanted(made)
    if isinstance(name := options.get("trim"), str) and name != "auto":
        trim_arguments(made, name)
    for key, values in options.get("grid", {}).items():
        _axis(made, key, values)


def _is_key(made: Cut, name: str) -> bool:
    """Whether a name is a parameter or option of a block, though not one that the model can be tuned by."""
    block, _, key = name.rpartition(".")
    found = made.scenario.system.blocks.get(block)
    return found is not None and (key in type(found).parameters or key in type(found).options)


def every_mode(
    made: Cut,
    *,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    trim: str | None = None,
) -> LinearFamily:
    """A family over all combinations of modes that can occur; those of ``modes`` are held, not those of the file."""
    asked = point(made, modes, at)
    there = start_of(made, asked, trim, at)
    held = point(replace(made, settings=replace(made.settings, modes={})), modes, at)["modes"]
    return combinations(made.model, at=there["at"], inputs=there["inputs"], modes=held)


def snapshots(made: Cut, every: float, *, stop: float | None = None) -> LinearFamily:
    """A family along the scenario's own run: at the start, every so many seconds, and after every change of modes.

    Args:
        made: the model; what feeds its inputs in the scenario gives their values.
        every: interval (s).
        stop: end of the run (s); that of the scenario if None.

    Raises:
        FlexarmError: the scenario cannot be simulated, or the model has sampled blocks.
    """
    from engine.simulate import simulate

    model, scenario = made.model, made.scenario
    if model.memories:
        raise FlexarmError(
            f"'{model.memories[0].name}' is a memory of a sampled block, which a run does not record",
            remedy="free the inputs behind the sampled blocks (-u), and take snapshots of the plant",
        )
    if not (np.isfinite(every) and every > 0):
        raise ParameterError(f"{every:g} s is no interval between snapshots", remedy="give a time above zero")
    sources = scenario.system.sources()
    feeding = {name: sources[name][0] for name in (v.name for v in model.inputs) if name in sources}
    unfed = [v.name for v in model.inputs if v.name not in feeding]
    if unfed:
        raise FlexarmError(
            f"nothing feeds '{unfed[0]}' in the scenario's run", remedy="connect a source, or leave it out"
        )
    planned = scenario.simulation
    end = stop if stop is not None else planned.stop if planned is not None else None
    if end is None:
        raise FlexarmError("the scenario does not say how long to simulate", remedy="add 'simulate: {stop: 4 s}'")
    # Rows are as close as those of the scenario's run, and every so many of them are at the interval.
    stride = math.ceil(every / min(planned.step if planned is not None else 1e-3, end) * (1 - 1e-9))
    step = every / stride
    whole = scenario.build((), list(dict.fromkeys(feeding.values())))
    run = simulate(whole, end, step, record_states=True)
    assert run.states is not None
    assert run.modes is not None
    rows = set(range(0, len(run.time), stride))
    rows |= {int(k) + 1 for k in np.flatnonzero((np.diff(run.modes, axis=0) != 0).any(axis=1))}
    if len(rows) > MOST_SNAPSHOTS:
        raise FlexarmError(f"{len(rows)} snapshots are too many", remedy=f"at most {MOST_SNAPSHOTS}: a longer interval")
    taken = sorted(rows)
    points = [_snapshot(model, whole, run, k, feeding) for k in taken]
    axis = Axis("time", "s", run.time[taken])
    return collect(model, [axis], points)


def _snapshot(model: Model, whole: Model, run: Any, row: int, feeding: Mapping[str, str]) -> Point:
    """The model's point at a row of the run of the whole scenario."""
    states = dict(zip((v.name for v in whole.states), run.states[row].tolist(), strict=True))
    labels = {
        mode.name: mode.labels[int(v) + 1]
        for mode, v in zip(whole.modes, run.modes[row], strict=True)
        if mode.kind != TIME
    }
    known = {mode.name for mode in model.modes}
    missing = [v.name for v in model.states if v.name not in states]
    if missing:
        raise FlexarmError(f"state '{missing[0]}' is not one of the scenario's own run")
    return operating_point(
        model,
        at={v.name: states[v.name] for v in model.states},
        inputs={name: float(run[signal][row]) for name, signal in feeding.items()},
        modes={name: label for name, label in labels.items() if name in known},
        time=float(run.time[row]),
    )
