"""Stops at the ends of the range in which a shaft turned or a slide moved."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.effects.effect import Candidate, EffectParameter, Sizes
from diagnosis.effects.insertion import at_flange
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales

DEPTHS = (2e-3, 0.01, 0.05)
"""Starting sizes of how far a body runs into a stop at its typical speed, as shares of its range."""

DAMPED = 0.4
"""Starting damping of a stop, as a multiple of sqrt(stiffness * inertia)."""

FAR = 10.0
"""Where a stop is that is not touched, in ranges beyond what was measured."""

USUAL, ABRUPT = 0.9, 4.0
"""A stop turns a body back at least four times as fast as it is accelerated elsewhere in nine of ten samples."""

WINDOW = 4
"""Samples over which a speed is taken: to tell it from the steps of an encoder."""


def at_measured_shaft(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Stops at a shaft or slide whose position is measured and turns back abruptly at an end of what was measured."""
    found = next(_measured(scales, place), None)
    if found is None:
        return
    signal, flange = found
    rows = [m[np.isfinite(m)] for m in scales.measured(signal)]
    low, high = min(float(m.min()) for m in rows), max(float(m.max()) for m in rows)
    span = high - low
    touched = {side for side in (-1, 1) if _abrupt(scales, rows, span, side, high if side > 0 else low)}
    if not touched or not span > 0:
        return
    here, unit = scales.member(place, flange), "m" if place.sliding else "rad"
    reference = max(abs(low), abs(high))
    stiff = here.inertia * (here.speed / (DEPTHS[1] * span)) ** 2
    common = (
        EffectParameter("stiffness", stiff, usual=1.0),
        EffectParameter("damping", DAMPED * math.sqrt(stiff * here.inertia), usual=1.0),
    )
    sides = [{side} for side in sorted(touched, reverse=True)] + ([{-1, 1}] if len(touched) > 1 else [])
    names = {-1: "lower", 1: "upper"}
    away = {"lower": f"{low - FAR * span:.10g} {unit}", "upper": f"{high + FAR * span:.10g} {unit}"}
    for chosen in sides:
        starts: list[Sizes] = []
        for depth in DEPTHS:
            stiffness = here.inertia * (here.speed / (depth * span)) ** 2
            ends = {names[side]: (high if side > 0 else low) - side * depth * span for side in chosen}
            starts.append({**ends, "stiffness": stiffness, "damping": DAMPED * math.sqrt(stiffness * here.inertia)})
        given: dict[str, Any] = {name: away[name] for side, name in names.items() if side not in chosen}
        told = "both" if len(chosen) > 1 else f"{names[next(iter(chosen))]} one"
        yield from at_flange(
            replace(here, option=told),
            "end_stop",
            "EndStop",
            starts,
            *(EffectParameter(names[side], reference, signed=True, usual=1.0) for side in sorted(chosen)),
            *common,
            **given,
        )


def _measured(scales: OperatingScales, place: Place) -> Iterator[tuple[str, str]]:
    """Signals that are the position of a member of a shaft, and the member: read at it, or by an encoder on it."""
    members = scales.groups[place.target]
    for variable in scales.problem.model.outputs:
        flange, _, quantity = variable.name.rpartition(".")
        if flange in members and quantity in ("angle", "position"):
            yield variable.name, flange
            continue
        block = scales.system.blocks.get(flange)
        if block is None or variable.unit not in ("rad", "m"):
            continue
        flanges = [name for name, port in block.ports.items() if port.role == "flange"]
        on = f"{flange}.{flanges[0]}" if len(flanges) == 1 else ""
        if on in members:
            yield variable.name, on


def _abrupt(scales: OperatingScales, rows: list[np.ndarray], span: float, side: int, end: float) -> bool:
    """Whether positions turn back at an end much faster than they are accelerated elsewhere."""
    inside, there = [], [0.0]
    for m in rows:
        if len(m) < 4 * WINDOW:
            continue
        speed = (m[WINDOW:] - m[:-WINDOW]) / WINDOW
        change = -side * (speed[WINDOW:] - speed[:-WINDOW])
        near = side * (end - m[WINDOW:-WINDOW]) < DEPTHS[-1] * span
        beside = np.convolve(near, np.ones(4 * WINDOW + 1), "same") > 0
        inside.append(np.abs(change[~beside]))
        there.append(float(change[near].max()) if near.any() else 0.0)
    usual = float(np.quantile(np.concatenate(inside), USUAL)) if inside and any(len(i) for i in inside) else 0.0
    return max(there) > ABRUPT * usual
