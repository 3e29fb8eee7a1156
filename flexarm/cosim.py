"""Co-simulation of an FMU or SSP with FMPy beside the runner's simulation of the scenario it was made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.errors import FlexarmError, Where
from engine.quantity import convert
from engine.rows import check_rows
from engine.simulate import Drive, simulate
from flexarm.cut import cut
from fmu.variables import flat, structured
from fmu.verify import Trace, cosim, find

if TYPE_CHECKING:
    from scenarios.load import Scenario


@dataclass(frozen=True)
class Run:
    """A co-simulation.

    Attributes:
        trace: its outputs over time.
        step: communication step (s).
        inputs: constant value of each input, SI units.
        units: of the inputs.
        differences: of each output both have, the largest absolute difference from the scenario's run, SI units; None
            without a scenario.
    """

    trace: Trace
    step: float
    inputs: dict[str, float]
    units: dict[str, str]
    differences: dict[str, float] | None = None


def run(
    path: Path,
    scenario: Scenario | None = None,
    analysis: str | None = None,
    inputs: Mapping[str, str | float] | None = None,
    stop: float | None = None,
    step: float | None = None,
    *,
    made_with: tuple[Sequence[str] | None, Sequence[str] | None] = (None, None),
) -> Run:
    """Co-simulate with constant inputs, and compare.

    Args:
        path: an FMU or SSP.
        scenario: what it was made from. Parameters that the FMU has take its start values.
        analysis: of kind ``export`` by which it was made.
        inputs: values with units by name; 1 in SI units for the rest.
        stop: end (s); that of the file if None.
        step: communication step (s); that of the file if None.
        made_with: inputs and outputs with which it was exported; those of the analysis where None.

    Raises:
        FlexarmError: the file cannot be read or loaded, or has no such input.
        SimulationError: one of the runs fails.
    """
    described = _describe(path)
    stop = stop if stop is not None else described.stop
    step = step if step is not None else described.step
    check_rows(stop, step)
    here = {flat(name) for name in described.inputs}
    meant = {  # an exposed name, where the file has none of that spelling
        name if scenario is None or flat(name) in here else scenario.resolve(name): value
        for name, value in (inputs or {}).items()
    }
    values = _inputs(described, meant)
    drive = Drive([0.0], [list(values.values())]) if values else None
    if path.suffix.lower() == ".ssp":
        from fmu.ssp import cosim_ssp

        trace = cosim_ssp(path, stop, step, drive=drive)
    else:
        trace = cosim(path, stop, step, drive=drive)
    if scenario is None:
        return Run(trace, step, values, described.units)
    return Run(
        trace, step, values, described.units, _differences(scenario, analysis, made_with, described, trace, drive, step)
    )


@dataclass(frozen=True)
class _Described:
    """Inputs with units, parameters with start values, and the default experiment of a file."""

    inputs: tuple[str, ...]
    units: dict[str, str]
    parameters: dict[str, float]
    stop: float
    step: float


def _describe(path: Path) -> _Described:
    if not path.is_file():
        raise FlexarmError(f"there is no file '{path}'", remedy="write one by flexarm export")
    if path.suffix.lower() == ".ssp":
        from fmu.ssp import describe

        names, units, stop, step = describe(path)
        return _Described(names, units, {}, stop, step)
    from fmu.archive import description

    found: Any = description(path)
    variables = found.modelVariables
    default = found.defaultExperiment
    ends, every = (getattr(default, key, None) for key in ("stopTime", "stepSize"))
    return _Described(
        tuple(v.name for v in variables if v.causality == "input"),
        {v.name: v.unit or "" for v in variables if v.causality == "input"},
        {
            v.name: _number(path, f"start of '{v.name}'", v.start, 0.0)
            for v in variables
            if v.causality == "parameter" and v.type in ("Real", "Float64") and not v.dimensions
        },
        _number(path, "stopTime", ends, 1.0),
        _number(path, "stepSize", every, 1e-3),
    )


def _number(path: Path, what: str, text: Any, default: float) -> float:
    try:
        return default if text is None else float(text)
    except (TypeError, ValueError):
        raise FlexarmError(f"in '{path}' the {what} is {str(text)[:40]!r}, which is no number") from None


def _inputs(described: _Described, given: Mapping[str, str | float]) -> dict[str, float]:
    values = dict.fromkeys(described.inputs, 1.0)
    for name, value in given.items():
        try:
            known = find(name, described.inputs, "input")
            values[known] = convert(value, described.units[known] or "*")
        except FlexarmError as error:
            raise error.at(Where("--input")) from None
    return values


def _differences(
    scenario: Scenario,
    analysis: str | None,
    made_with: tuple[Sequence[str] | None, Sequence[str] | None],
    described: _Described,
    trace: Trace,
    drive: Drive | None,
    step: float,
) -> dict[str, float]:
    model = cut(scenario, "export", analysis, inputs=made_with[0], outputs=made_with[1]).model
    there = tuple(flat(variable.name) for variable in model.inputs)
    here = [flat(name) for name in described.inputs]
    if sorted(there) != sorted(here):
        raise FlexarmError(
            f"the file's inputs are {', '.join(described.inputs) or 'none'}, those of scenario "
            f"'{scenario.name}' {', '.join(there) or 'none'}",
            remedy="give the scenario and --analysis, or --inputs and --outputs, with which the file was made",
        )
    if drive is not None:
        row = np.asarray(drive.values, dtype=float)[0]
        drive = Drive([0.0], [[float(row[here.index(name)]) for name in there]])
    known = {structured(parameter.name): parameter.name for parameter in model.parameters}
    values = {known[name]: value for name, value in described.parameters.items() if name in known}
    result = simulate(model, float(trace.time[-1]), step, drive=drive, parameters=values)
    shared = len(result.time)  # a last step that is shorter has a row in the co-simulation alone
    own = {flat(name): name for name in result.names}
    differences = ((name, result[own[flat(name)]] - trace[name][:shared]) for name in trace.names if flat(name) in own)
    return {name: float(np.abs(apart).max()) for name, apart in differences}
