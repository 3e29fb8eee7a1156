"""A frequency response by simulation: a sine of the table's amplitude until the answer repeats, then half its range.

Friction and backlash act, so the answer depends on the amplitude and is read from the last period as on the bench.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from diagnosis.columns import Vector
from diagnosis.recording import FrequencyTable
from engine.errors import FlexarmError, ParameterError, Where
from engine.model import FRICTION, SWITCH, Model
from engine.quantity import compatible
from engine.simulate import simulate
from engine.start import start_values
from engine.step import fastest
from engine.system import Connection, bypass

if TYPE_CHECKING:
    from scenarios.load import Scenario

POINTS, STEP_PER_RATE = 240, 0.5
"""Steps per period at least, and longest step times the fastest rate of the model."""

POINTS_AT_CONTACTS, STEP_PER_RATE_AT_CONTACTS = 2000, 0.1
"""The same where contacts or dead zones switch: speeds then peak sharply between rows (0.01 dB at this fineness)."""

SETTLED = 2e-4
"""Relative change of the range between half-time and the end that counts as periodic."""

TIME_CONSTANTS = 4.0
"""Length of the first attempt in time constants of the slowest mode."""

LONGEST = 30.0
"""Slow modes beyond this time (s) do not lengthen the first attempt; the test for periodicity still applies."""

MOST_STEPS = 8_000_000
"""Steps after which a row is taken as it is, with a note."""


@dataclass(frozen=True)
class SineModel:
    """A scenario whose input a sine drives.

    Attributes:
        model: with the table's signals as outputs.
        sine: name of the sine block.
        bypassed: blocks that the sine replaces.
    """

    model: Model
    sine: str
    bypassed: tuple[str, ...]


@dataclass(frozen=True)
class Response:
    """Simulated amplitudes.

    Attributes:
        amplitudes: half the peak to peak of the last period, shape (rows, responses).
        notes: rows that never became periodic.
    """

    amplitudes: NDArray[np.float64]
    notes: tuple[str, ...]


def sweep(driven: SineModel, table: FrequencyTable, progress: Callable[[float], None] | None = None) -> Response:
    """Simulate every row of a table.

    Args:
        driven: the model with its sine.
        table: frequencies and amplitudes.
        progress: is told the share done.

    Raises:
        FlexarmError: a simulation fails.
    """
    model, sine = driven.model, driven.sine
    settle = settling_time(model, model.parameter_values, TIME_CONSTANTS)
    rows: NDArray[np.float64] = np.zeros((len(table.frequency), len(model.outputs)))
    restless: list[int] = []

    def row(i: int) -> tuple[Vector, bool]:
        values = {f"{sine}.amplitude": float(table.amplitude[i])}
        values[f"{sine}.frequency"] = float(table.frequency[i]) / (2 * math.pi)
        return periodic(model, values, float(table.frequency[i]), settle, table.largest_step)

    # The first row compiles the model; the others share it.
    if len(rows):
        rows[0], settled = row(0)
        restless += [] if settled else [0]
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        jobs = {pool.submit(row, i): i for i in range(1, len(rows))}
        try:
            for done, job in enumerate(as_completed(jobs), 2):
                rows[jobs[job]], settled = job.result()
                restless += [] if settled else [jobs[job]]
                if progress is not None:
                    progress(done / len(rows))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    notes = [
        f"at {table.frequency[i]:g} rad/s the response does not repeat after {MOST_STEPS} steps; its last period counts"
        for i in sorted(restless)
    ]
    return Response(rows, tuple(notes))


def sine_model(scenario: Scenario, table: FrequencyTable, where: Where | None = None) -> SineModel:
    """The scenario with a sine in place of what fed the table's input.

    Args:
        scenario: the model.
        table: names and units.
        where: the place in the file that states the amplitude.

    Raises:
        FlexarmError: a name or unit that does not fit.
    """
    from blocks.registry import find

    system, dropped = bypass(scenario.system, [table.drive])
    name = "sweep"
    while name in system.blocks:
        name += "_"
    try:
        wave = find("Sine")(amplitude=f"1 {table.amplitude_unit}", frequency=1.0)
    except ParameterError as error:
        raise (error.at(where) if where else error) from None
    block, port = system.split(table.drive)
    expected = system.blocks[block].ports[port].unit
    if not compatible(table.amplitude_unit, expected):
        raise ParameterError(f"the amplitude is in {table.amplitude_unit} but '{table.drive}' takes {expected}", where)
    joined = Connection((f"{name}.out", table.drive), where or Where())
    changed = replace(system, blocks={**system.blocks, name: wave}, connections=[*system.connections, joined])
    signals = [channel.name for channel in table.responses]
    try:
        return SineModel(scenario.build((), signals, system=changed), name, tuple(dropped))
    except FlexarmError as error:
        for signal in signals:
            if f"'{signal}' names no" in error.message and table.name in scenario.recordings:
                error.where = scenario.where("recordings", table.name, "response", signal)
        raise


def settling_time(model: Model, p: Vector, time_constants: float) -> float:
    """A few time constants (s) of the slowest mode with joints sliding and contacts closed, at given parameters."""
    e = model.equations
    x = start_values(model, p)
    modes = [1.0 if mode.kind in (FRICTION, SWITCH) else 0.0 for mode in model.modes]
    if "jacobian" not in model.functions:
        model.functions["jacobian"] = ca.Function("jacobian", e.arguments, [ca.jacobian(e.derivative, e.x)])
    matrix = np.array(model.functions["jacobian"](0, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), modes, p).full())
    if not matrix.size or not np.isfinite(matrix).all():
        return 0.0
    rates = -np.linalg.eigvals(matrix).real
    slow = rates[rates > 1 / LONGEST]
    return time_constants / float(slow.min()) if len(slow) else 0.0


def periodic(
    model: Model, values: dict[str, float], frequency: float, settle: float, largest_step: float | None
) -> tuple[Vector, bool]:
    """Half the range of each output over the last period, and whether it had settled."""
    period = 2 * math.pi / frequency
    p = model.parameter_vector(values)
    sharp = model.count(SWITCH) > 0
    longest = min(period / (POINTS_AT_CONTACTS if sharp else POINTS), largest_step or math.inf)
    rate = fastest(model, p, start_values(model, p)).rate
    longest = min(longest, (STEP_PER_RATE_AT_CONTACTS if sharp else STEP_PER_RATE) / max(rate, 1e-9))
    if model.clocks:
        tick = min(clock.period for clock in model.clocks)
        step = tick / math.ceil(tick / longest) if longest < tick else tick
    else:
        step = period / math.ceil(period / longest)
    per_period = math.ceil(period / step - 1e-9)
    cycles = max(2, 2 * math.ceil(settle / period))
    while True:
        rows = cycles * per_period if not model.clocks else math.ceil(cycles * period / step)
        result = simulate(model, rows * step, step, parameters=values, internal_step=min(longest, step), log_capacity=0)
        last = half_range(result.values[-per_period - 1 :])
        middle = len(result.values) // 2
        before = half_range(result.values[max(0, middle - per_period) : middle + 1])
        if np.all(np.abs(last - before) <= SETTLED * np.abs(last)):
            return last, True
        if 2 * rows > MOST_STEPS:
            return last, False
        cycles *= 2


def half_range(values: NDArray[np.float64]) -> Vector:
    """Half the peak to peak of each column over one period, extremes refined by a parabola through three points."""
    return np.array([(_top(column) + _top(-column)) / 2 for column in values.T])


def _top(values: Vector) -> float:
    """The highest value of one period: of the parabola about its highest row, or of the kink that a contact makes."""
    i, last = int(np.argmax(values)), len(values) - 1
    before, here, after = values[i - 1 if i else last - 1], values[i], values[i + 1 if i < last else 1]
    bend = before - 2 * here + after
    inside = bend < 0 and max(before, after) <= here
    smooth = float(here - (after - before) ** 2 / (8 * bend)) if inside else float(here)
    if last < 12:
        return smooth
    near = values[(i + np.arange(-3, 4)) % last]
    return _kink(near, smooth) if inside else smooth


_AHEAD = np.array([1.0, -3.0, 3.0])
"""Value of a parabola one row on from three."""


def _kink(near: Vector, smooth: float) -> float:
    """Where two parabolas meet beside the middle of seven rows, if one side alone does not continue over the middle.

    The effort of a contact jumps as it closes, and the speed peaks in a corner that lies between two rows.
    """
    left, right = abs(_AHEAD @ near[:3] - near[3]), abs(_AHEAD @ near[:3:-1] - near[3])
    if min(left, right) > 0.2 * max(left, right):
        return smooth
    if right < left:
        near = near[::-1]
    # On the side that continues, the rows -2, -1, 0; on the other, 1, 2, 3; they meet between 0 and 1.
    one, other = np.polyfit([-2.0, -1.0, 0.0], near[1:4], 2), np.polyfit([1.0, 2.0, 3.0], near[4:], 2)
    meet = [r.real for r in np.roots(one - other) if abs(r.imag) < 1e-12 and -1e-9 <= r.real <= 1 + 1e-9]
    found = max((float(np.polyval(one, r)) for r in meet), default=smooth)
    return found if near[3] <= found <= near[3] + 2 * abs(near[3] - near[4]) + 2 * abs(near[3] - near[2]) else smooth
