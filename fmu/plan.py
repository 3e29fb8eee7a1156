"""The plan of an export, computed once: names, structure, grid, clocks."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import metadata

import numpy as np

from engine.errors import FlexarmError
from engine.model import Model, Vector
from engine.simulate import common_tick, rational
from engine.start import start_values
from engine.step import fastest, following_step, internal_step
from fmu.arrays import Array, with_elements
from fmu.arrays import arrays as found_arrays
from fmu.coupling import Coupling
from fmu.nominal import nominals
from fmu.structure import Structure, structure
from fmu.twists import Twist, twists
from fmu.variables import COORDINATE, STATE, FmuVariable, variables

FINEST, COARSEST = 1e-12, 1e-2
"""Relative tolerances that a variable internal step may have."""


@dataclass(frozen=True)
class Plan:
    """An export, ready to be written.

    Attributes:
        model: the model.
        step: cell of the internal grid (s).
        stop: end of the default experiment (s).
        identifier: C identifier, and name of the binaries.
        variables: of the FMU, by reference.
        structure: dependencies.
        tick: resolution of the instants (s), of which the grid and all clocks are whole multiples.
        hmax: longest integration step (s), chosen at the default parameters.
        rate: of the fastest mode (1/s), at the default parameters.
        following: longest step (s) that follows every lightly damped mode to ``stop``, at the default parameters.
        coupling: what is known of inputs at cuts.
        twists: shown as states in place of coordinates.
        variable_step: relative tolerance of a variable internal step in Co-Simulation, or None for a fixed one.
        results: names of outputs that are shown as local variables.
        arrays: array variables of FMI 3, none unless they are asked for.
        typical: inputs and tables for which hmax is chosen.
        start: states at the start at the default parameters.
        memory: memories at the start at the default parameters.
    """

    model: Model
    step: float
    stop: float
    identifier: str
    variables: list[FmuVariable]
    structure: Structure
    tick: Fraction
    hmax: float
    rate: float
    following: float
    coupling: Coupling
    twists: tuple[Twist, ...]
    variable_step: float | None
    results: frozenset[str]
    arrays: tuple[Array, ...]
    typical: Vector
    start: Vector
    memory: Vector

    @property
    def tool(self) -> str:
        """Name and version of this program."""
        try:
            return f"flexarm {metadata.version('flexarm')}"
        except metadata.PackageNotFoundError:
            return "flexarm"

    @functools.cached_property
    def _firsts(self) -> dict[str, int]:
        return {variable.kind: variable.reference for variable in reversed(self.variables)}

    def first(self, kind: str) -> int:
        """Reference of the first variable of a kind; 0 if there is none."""
        return self._firsts.get(kind, 0)

    def position(self, kind: str, k: int) -> int:
        """1-based position in ModelVariables of the k-th variable of a kind."""
        return self.first(kind) + k + 1

    def start_reference(self, k: int) -> int:
        """Reference of the variable that holds the start of the model's k-th state, also where a twist is shown."""
        for i, twist in enumerate(self.twists):
            if twist.coordinate == k:
                return self.first(COORDINATE) + i
        return self.first(STATE) + k

    def ticks(self, seconds: float) -> int:
        """Whole ticks in a period or offset."""
        return int(rational(seconds) / self.tick)


def plan(
    model: Model,
    step: float = 1e-3,
    stop: float = 10.0,
    magnitudes: Mapping[str, float] | None = None,
    coupling: Coupling | None = None,
    settable: bool = True,
    variable_step: float | None = None,
    results: Iterable[str] = (),
    arrays: bool = False,
) -> Plan:
    """Plan an export.

    Args:
        model: the model.
        step: cell of the internal grid (s).
        stop: end of the default experiment (s).
        magnitudes: state or twist name -> its largest magnitude in use; see `fmu.nominal`.
        coupling: what is known of inputs at cuts.
        variable_step: relative tolerance of a variable internal step; a fixed one if None.
        results: names of outputs that are local variables, for importers that record them.
        arrays: whether numbered states and parameters of a block are one array variable; FMI 3 alone.
        settable: whether an importer may set the states' starts, and sees states at all as an integrator does.

    Raises:
        FlexarmError: the step is not a positive number or has no common tick with a clock, the tolerance is not from
            `FINEST` to `COARSEST`, or two names are equal.
    """
    for name, value in (("step", step), ("stop", stop)):
        if not (math.isfinite(value) and value > 0):
            raise FlexarmError(f"{name} is {value}", remedy=f"give a {name} above zero, in seconds")
    if variable_step is not None and not FINEST <= variable_step <= COARSEST:
        raise FlexarmError(
            f"the tolerance of the variable step is {variable_step:g}", remedy=f"allowed: {FINEST:g} to {COARSEST:g}"
        )
    local, model = frozenset(results), _pinned(model)
    instants = [step, *[clock.period for clock in model.clocks], *[clock.offset for clock in model.clocks]]
    tick = common_tick(instants)
    if tick < Fraction(1, 10**13):
        raise FlexarmError(
            f"step and sample periods {instants} have no common tick", remedy="make them multiples of one another"
        )
    p = model.parameter_values
    start = start_values(model, p)
    coupling = coupling or Coupling()
    typical = np.zeros(model.equations.u.numel())
    for k, entry in enumerate(model.inputs):
        typical[k] = coupling.typical.get(entry.name, 0.0)
    shown = twists(model) if settable else ()
    found = structure(model, shown)
    if not settable:
        found = replace(found, exact=[False] * len(model.states))
    starts = {s.name: float(x) for s, x, exact in zip(model.states, start, found.exact, strict=True) if exact}
    listed = variables(model, starts, nominals(model, magnitudes or {}, shown), coupling.starts(), shown, local)
    grouped = found_arrays(listed) if arrays else ()
    return Plan(
        model=model,
        step=step,
        stop=stop,
        identifier=identifier(model.name),
        variables=with_elements(listed, grouped),
        structure=found,
        tick=tick,
        hmax=internal_step(model, p, start, step, stop, typical),
        rate=fastest(model, p, start, typical).rate,
        following=following_step(model, p, start, stop, typical),
        coupling=coupling,
        twists=shown,
        variable_step=variable_step,
        results=local,
        arrays=grouped,
        typical=typical,
        start=start,
        memory=model.functions["memory_start"](p).full().ravel(),
    )


def _pinned(model: Model) -> Model:
    """The model in which a parameter may have no other value if something that it gives would not follow it."""
    if not any(parameter.fixed for parameter in model.parameters):
        return model
    made = []
    for entry in model.parameters:
        if entry.fixed:
            doc = f"{entry.declared.doc}; stays as it is, since it gives {' and '.join(entry.fixed)} too"
            only = replace(entry.declared, gt=None, lt=None, ge=entry.value, le=entry.value, nonzero=False, doc=doc)
            entry = replace(entry, declared=only)
        made.append(entry)
    return replace(model, parameters=tuple(made))


def identifier(name: str) -> str:
    """A C identifier made of a model's name, short enough for the name of a file."""
    plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:100] or "model"
    return plain if plain[0].isalpha() else f"m_{plain}"
