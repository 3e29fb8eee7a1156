"""Sensitivities of a run's outputs to parameters and starting values, carried through every located event.

The derivative is that of the discrete algorithm, so it agrees with differences of runs as closely as rounding allows,
as long as both runs switch in the same order. Where the order changes there is no gradient.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine import bytecode, native
from engine.codegen import tangent_source
from engine.compile import known, library
from engine.errors import ParameterError, SimulationError, nearest
from engine.model import Model, Vector
from engine.simulate import MOST_BEGUN, Drive, Result, as_result, explain, note_work, prepare
from engine.start import start_values, starting_names

GRAZING = 1e-9
"""A guard met at a rate below this share of its parts is grazed: its instant has no usable derivative."""


@dataclass(frozen=True)
class Tangents:
    """A run and its derivatives.

    Attributes:
        result: the run.
        wrt: names of the directions.
        values: d output / d direction, shape (rows, outputs, directions), SI units.
        grazing: whether some guard was met tangentially, so that later derivatives are unreliable.
    """

    result: Result
    wrt: tuple[str, ...]
    values: NDArray[np.float64]
    grazing: bool

    def of(self, output: str, direction: str) -> Vector:
        """One derivative over time, shape (rows,).

        Raises:
            ParameterError: unknown name.
        """
        for name, names in ((output, self.result.names), (direction, list(self.wrt))):
            if name not in names:
                raise ParameterError(f"no derivative for '{name}'", remedy=nearest(name, names))
        return np.asarray(self.values[:, self.result.names.index(output), self.wrt.index(direction)])


def _entry(source: str) -> Any:
    function = library(source, in_lines=True).fa_simulate_tangents
    function.argtypes = [ctypes.c_void_p, *[POINTER(c_double)] * 4]
    function.restype = ctypes.c_int
    return function


def _way(model: Model, indices: tuple[int, ...], directions: int) -> native.Way:
    return native.way(
        (model.law, indices, directions),
        lambda: native.Way(
            lambda: native.translated(bytecode.tangent_code(model, indices, directions), bytecode.room_for(directions)),
            lambda: tangent_source(model, indices, directions),
            _entry,
            lambda source: known(source, in_lines=True),
        ),
    )


def tangents(
    model: Model,
    stop: float,
    step: float = 1e-3,
    *,
    wrt: list[str],
    parameters: dict[str, float] | None = None,
    drive: Drive | None = None,
    initial: dict[str, float] | None = None,
    internal_step: float | None = None,
    rows: Vector | None = None,
    room: int = 0,
) -> Tangents:
    """Simulate with sensitivities; needs a C compiler.

    Args:
        model: the model.
        stop: end (s).
        step: time between rows (s).
        wrt: parameters, and motions or states whose starting value is meant.
        parameters: values that replace the model's, SI units.
        drive: the external inputs.
        initial: starting values by name, SI units.
        internal_step: longest integration step (s).
        rows: instants of the rows (s); as of `SimulationOptions`.
        room: directions that the compiled code has room for, at least; runs of equal room share it.

    Raises:
        ParameterError: a name that is neither a parameter nor a starting value, or a model that calls Python functions.
        SimulationError: the run diverged or chattered.
        CompilerUnavailable: no compiler runs.
    """
    if model.externals:
        raise ParameterError(
            f"'{model.externals[0].name}' is a Python function or a foreign FMU, which has no derivative",
            remedy="leave it out of the model, or compare runs with slightly different values",
        )
    ordered, indices = _directions(model, tuple(wrt))
    job = prepare(
        model,
        stop,
        step,
        parameters=parameters,
        drive=drive,
        initial=initial,
        internal_step=internal_step,
        rows=rows,
    )
    room = max(len(ordered), room)
    S0, D0 = _seeds(model, job.p, dict(initial or {}), ordered, indices, room)
    slopes = np.empty((room, job.outputs + 1, len(model.outputs)))
    least = np.zeros(1)
    way = _way(model, indices, room)
    code = None if way.chosen(native.steps_of(job)) else way.code
    function = way.own if code is None else native.interpreter(bytecode.room_for(room), _entry)
    extra = [a.ctypes.data_as(POINTER(c_double)) for a in (S0, D0, slopes, least)]
    outcome = native.call(model, job, lambda c: function(ctypes.addressof(c), *extra), code)
    note_work(model, [outcome], len(ordered))
    if outcome.status:
        raise SimulationError(explain(model, outcome))
    back = [ordered.index(name) for name in wrt]
    slopes = slopes[: len(back)] if back == sorted(back) else slopes[back]
    result = as_result(model, job, outcome, "c", parameters)
    return Tangents(result, tuple(wrt), slopes.transpose(1, 2, 0), bool(least[0] < GRAZING))


def _directions(model: Model, wrt: tuple[str, ...]) -> tuple[list[str], tuple[int, ...]]:
    """The directions in the runtime's order, parameters first, and the parameters' positions; found once.

    Raises:
        ParameterError: as of `tangents`.
    """
    found = model.directions.get(wrt)
    if found is None:
        known = [parameter.name for parameter in model.parameters]
        starting = starting_names(model)
        for name in wrt:
            if name not in known and name not in starting:
                remedy = nearest(name, [*known, *starting])
                raise ParameterError(f"no parameter or starting value '{name}'", remedy=remedy)
        ordered = [name for name in wrt if name in known] + [name for name in wrt if name not in known]
        found = ordered, tuple(known.index(name) for name in ordered if name in known)
        if len(model.directions) >= MOST_BEGUN:
            model.directions.clear()
        model.directions[wrt] = found
    return found


def _seeds(
    model: Model, p: Vector, initial: dict[str, float], names: list[str], indices: tuple[int, ...], room: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """dx0/dq and dd0/dq, worked out once for all parameters that give the same; see `_differences`."""
    same = (p[model.shapes].tobytes(), tuple(initial.items()), tuple(names), room)
    found = model.seeds.get(same)
    if found is None:
        found = _differences(model, p, initial, names, indices, room)
        if len(model.seeds) >= MOST_BEGUN:
            model.seeds.clear()
        model.seeds[same] = found
    return found


def _differences(
    model: Model, p: Vector, initial: dict[str, float], names: list[str], indices: tuple[int, ...], room: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """dx0/dq and dd0/dq. Starting values are smooth, nearly linear functions: central differences are exact enough."""
    S0 = np.zeros((len(model.states), room))
    D0 = np.zeros((len(model.memories), room))

    def memories(q: Vector) -> Vector:
        return model.at("memory_start")(q).ravel()

    moving = model.shaping
    for j, name in enumerate(names):
        if j < len(indices):
            if indices[j] not in moving:
                continue
            up, down = p.copy(), p.copy()
            delta = 1e-6 * max(abs(p[indices[j]]), 1e-12)
            up[indices[j]] += delta
            down[indices[j]] -= delta
            width = up[indices[j]] - down[indices[j]]
            S0[:, j] = (start_values(model, up, initial) - start_values(model, down, initial)) / width
            D0[:, j] = (memories(up) - memories(down)) / width
        else:
            value = {**model.initial, **initial}.get(name, 0.0)
            up_x, down_x = (start_values(model, p, {**initial, name: value + s}) for s in (0.5, -0.5))
            S0[:, j] = up_x - down_x
    return S0, D0
