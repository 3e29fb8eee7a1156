"""A frequency response by simulation: a sine of the table's amplitude until the answer repeats, then half its range.

Friction and backlash act, so the answer depends on the amplitude and is read from the last period as on the bench.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from diagnosis.columns import Vector
from diagnosis.period import Runs, extremes
from diagnosis.recording import FrequencyTable
from engine.errors import FlexarmError, ParameterError, Where
from engine.model import FRICTION, SWITCH, Model
from engine.quantity import compatible
from engine.simulate import prepare, simulate
from engine.start import start_values
from engine.step import fastest
from engine.system import Connection, bypass
from engine.threads import Threads

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

SWITCHES = 1_000_000
"""Switches of a run with clocks that are known at most."""

BESIDE = 4
"""Rows beyond a period over which its extremes are read."""


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
    with Threads(os.cpu_count() or 1) as pool:
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
    if model.clocks:
        return _ticking(model, values, period, step, longest, cycles)
    prepare(model, cycles * period, step, parameters=values, internal_step=step)  # refuses what would not end
    runs, x, modes = Runs(model), None, np.full(len(model.modes), np.nan)
    rows, wait, before = 0, cycles // 2, None
    while True:
        job = replace(runs.job(p, x, step, wait, rows), m0=modes, output_ticks=per_period, record_states=False)
        waited = runs.run(replace(job, log_capacity=0))
        x, modes, rows = waited.x1, waited.m1, rows + wait * per_period
        # Some rows more than a period, so that an extreme at its ends has rows on both sides.
        job = replace(runs.job(p, x, step, per_period + BESIDE, rows), m0=modes)
        high, low, _ = runs.extremes(job, runs.run(job), repeats=False)
        last = (high - low) / 2
        if before is not None and _same(last, before):
            return last, True
        if 2 * rows > MOST_STEPS:
            return last, False
        before, wait = last, rows // per_period


def _ticking(
    model: Model, values: dict[str, float], period: float, step: float, longest: float, cycles: int
) -> tuple[Vector, bool]:
    """The same for a model with clocks, whose run cannot go on from its states alone."""
    per_period = math.ceil(period / step - 1e-9)
    capacity = SWITCHES if model.modes else 0
    while True:
        rows = math.ceil(cycles * period / step)
        run = simulate(
            model, rows * step, step, parameters=values, internal_step=min(longest, step), log_capacity=capacity
        )
        switched = np.array([time for time, _, _ in run.events]) / step
        end = len(run.values) - 1
        last, before = (
            half_range(run.values[max(0, row - per_period) : row + 1], switched - max(0, row - per_period))
            for row in (end, len(run.values) // 2)
        )
        if _same(last, before):
            return last, True
        if 2 * rows > MOST_STEPS:
            return last, False
        cycles *= 2


def _same(last: Vector, before: Vector) -> bool:
    return bool(np.all(np.abs(last - before) <= SETTLED * np.abs(last)))


def half_range(values: NDArray[np.float64], switches: Vector) -> Vector:
    """Half the peak to peak of each column over one period, between the rows too; see `diagnosis.period.extremes`.

    Args:
        values: shape (rows, columns).
        switches: where they lie (rows, not whole), ascending. The values there are those of parabolas through three
            rows on either side: a corner or a jump lies between them.
    """

    def at(position: float) -> NDArray[np.float64]:
        cell = int(position)
        sides = [np.arange(max(cell - 2, 0), cell + 1), np.arange(cell + 1, min(cell + 4, len(values)))]
        whole = [rows for rows in sides if len(rows) == 3]
        return np.array([values[cell], *(_parabola(position - rows[0]) @ values[rows] for rows in whole)])

    inside = switches[(switches > 0) & (switches < len(values) - 1)]
    high, low, _ = extremes(values, inside, at, repeats=False)
    return np.asarray((high - low) / 2)


def _parabola(x: float) -> Vector:
    """Weights of rows 0, 1 and 2 in the value at ``x`` of the parabola through them."""
    return np.array([(x - 1) * (x - 2) / 2, x * (2 - x), x * (x - 1) / 2])
