"""A scenario with a sine on one of its inputs, and the time that its response takes to settle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.recordings.types import FrequencyTable
from engine.errors import ParameterError, Where
from engine.model import FRICTION, SWITCH, Model, Vector
from engine.quantity import compatible
from engine.start import start_values
from engine.system import Connection, bypass

if TYPE_CHECKING:
    from scenarios.load import Scenario

LONGEST = 30.0
"""Modes with a longer time constant (s) do not count: an integrator never settles."""


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


def sine_model(scenario: Scenario, table: FrequencyTable, where: Where | None = None) -> SineModel:
    """The scenario with a sine on the table's input, in place of the blocks that fed it.

    Args:
        scenario: the model.
        table: names and units.
        where: the place in the scenario that states the amplitude.

    Raises:
        FlexarmError: a name or unit that does not fit.
    """
    from blocks.registry import find

    system, bypassed = bypass(scenario.system, [table.drive])
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
    return SineModel(scenario.build((), signals, system=changed), name, tuple(bypassed))


def settling_time(model: Model, p: Vector, time_constants: float) -> float:
    """Some time constants of the slowest mode (s), with joints sliding and contacts closed; 0 if there is none."""
    e = model.equations
    x = start_values(model, p)
    modes = [1.0 if mode.kind in (FRICTION, SWITCH) else 0.0 for mode in model.modes]
    matrix = np.array(model.jacobian(0, x, np.zeros(e.u.numel()), np.zeros(e.d.numel()), modes, p).full())
    if not matrix.size or not np.isfinite(matrix).all():
        return 0.0
    rates = -np.linalg.eigvals(matrix).real
    slow = rates[rates > 1 / LONGEST]
    return time_constants / float(slow.min()) if len(slow) else 0.0
