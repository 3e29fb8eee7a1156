"""The verbs of the public API on scenarios: simulate, linearise, export, compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.model import TIME, Model
from engine.ports import MOTION
from engine.simulate import Result, SimulationKeywords, SimulationOptions
from engine.simulate import simulate as run_model
from flexarm.cut import Cut, Source, as_scenario, cut, find_mode
from scenarios.load import si
from scenarios.validate import ScenarioError

if TYPE_CHECKING:
    from diagnosis.compare import Comparison
    from diagnosis.recordings.types import FrequencyTable, Recording
    from engine.discretise import DiscreteModel
    from engine.linearise import LinearModel


def simulate(
    source: Source | Model,
    stop: float | None = None,
    step: float | None = None,
    options: SimulationOptions | None = None,
    **given: Unpack[SimulationKeywords],
) -> Result:
    """Simulate a scenario as its file says, or a model.

    Args:
        source: a scenario, its file or shipped name, or a model built from one.
        stop: end (s); that of the scenario if None.
        step: time between rows (s); that of the scenario, or 1 ms, if None.
        options: how to simulate; the internal step and its tolerance are those of the scenario where None.
        **given: fields of `SimulationOptions` as keywords, over those of ``options``, such as ``parameters={...}``,
            ``drive=...`` or ``record_states=True``.

    Raises:
        FlexarmError: the scenario or a value does not fit, or the simulation diverges.
    """
    chosen = replace(options or SimulationOptions(), **given)
    if isinstance(source, Model):
        model = source
    else:
        scenario = as_scenario(source)
        model = scenario.build()
        planned = scenario.simulation
        if planned is not None:
            stop = planned.stop if stop is None else stop
            step = planned.step if step is None else step
            if chosen.internal_step is None:
                chosen = replace(chosen, internal_step=planned.internal_step)
            if chosen.step_tolerance is None:
                chosen = replace(chosen, step_tolerance=planned.step_tolerance)
        elif stop is None:
            raise ScenarioError(
                "the scenario does not say how long to simulate",
                Where(scenario.document.file),
                "add 'simulate: {stop: 4 s}', or give a stop time",
            )
    if stop is None:
        raise ParameterError("no stop time is given", remedy="give one in seconds")
    return run_model(model, stop, 1e-3 if step is None else step, chosen)


def linearise(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    discrete: bool | None = None,
) -> LinearModel:
    """The linear model of a scenario: in discrete time where sampled blocks act, so that loops through them are closed.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``linearise`` if None.
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        modes: mode name -> label (``stuck``, ``inside``, ...), or -1, 0 or 1, over those of the analysis.
        at: states, motions and inputs at the point, over those of the analysis: SI numbers or texts with a unit.
        discrete: True for a `DiscreteModel`; False for the continuous states alone, with what sampled blocks hold kept
            as it is, and their loops open; None for a `DiscreteModel` if the model has sampled blocks.

    Raises:
        FlexarmError: a name, label or unit that does not fit, or the point lies between two modes and none is chosen.
    """
    from engine.discretise import discretise as sampled
    from engine.linearise import linearise as continuous

    made = source if isinstance(source, Cut) else cut(source, "linearise", analysis, inputs=inputs, outputs=outputs)
    linear = sampled if (bool(made.model.clocks) if discrete is None else discrete) else continuous
    found = linear(made.model, **_point(made, modes, at))
    if found.ambiguous:
        (mode, labels), *_ = found.ambiguous.items()
        choices = " or ".join(f"--mode '{mode}={label}'" for label in labels)
        raise ParameterError(
            f"the point lies exactly on the edge between the modes {' and '.join(labels)} of '{mode}', "
            "and the linear model of each is another",
            remedy=f"choose: {choices}; in a file, under 'modes:' of the analysis; or another point, by --at",
        )
    return found


def discretise(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
) -> DiscreteModel:
    """The discrete-time linear model of a scenario with sampled blocks; arguments and errors as of `linearise`."""
    from engine.discretise import DiscreteModel

    found = linearise(source, analysis, inputs=inputs, outputs=outputs, modes=modes, at=at, discrete=True)
    assert isinstance(found, DiscreteModel)
    return found


def _point(made: Cut, modes: Mapping[str, int | str] | None, at: Mapping[str, Any] | None) -> dict[str, Any]:
    """Arguments for `engine.linearise.linearise`: the point and modes of the analysis and those given, in SI units."""
    model, resolve = made.model, made.scenario.resolve
    wanted: dict[str, int | str] = {**made.settings.modes, **(modes or {})}
    labels = dict(_label(model, name, value) for name, value in wanted.items())
    point: dict[str, Any] = {**made.settings.at, **{resolve(name): value for name, value in (at or {}).items()}}
    input_units = {variable.name: variable.unit for variable in model.inputs}
    state_units = _motion_units(made)
    given = {name: si(value, {**state_units, **input_units}, name) for name, value in point.items()}
    return {
        "at": {name: value for name, value in given.items() if name not in input_units},
        "inputs": {name: value for name, value in given.items() if name in input_units},
        "modes": labels,
    }


def _motion_units(made: Cut) -> dict[str, str]:
    """Units of everything that has a value at an operating point, each flange's by its own kind."""
    units = {variable.name: variable.unit for variable in (*made.model.states, *made.model.memories)}
    system = made.scenario.system
    for name in made.model.motions:
        block, port = system.split(name)
        for quantity, unit in MOTION[system.blocks[block].ports[port].kind][:2]:
            units.setdefault(f"{name}.{quantity}", unit)
    return units


def _label(model: Model, name: str, value: int | str) -> tuple[str, str]:
    """Full name of a mode, and the label of the value asked for."""
    found = find_mode(model, name)
    if found is None:
        raise ParameterError(f"no mode '{name}'", remedy=nearest(name, [m.name for m in model.modes if m.kind != TIME]))
    if isinstance(value, str) and value not in ("-1", "0", "1", "+1"):
        return found.name, value
    number = int(value)
    if number not in (-1, 0, 1):
        raise ParameterError(f"mode '{name}' cannot be {number}", remedy="-1, 0, 1, or " + ", ".join(found.labels))
    return found.name, found.labels[number + 1]


class ExportKeywords(TypedDict, total=False):
    """The fields of `ExportOptions` as keyword arguments; why there are both: `engine.simulate.SimulationKeywords`."""

    inputs: Iterable[str] | None
    outputs: Iterable[str] | None
    platforms: Iterable[str] | None
    version: int
    linear_twin: bool
    beside: bool
    backend: str
    modes: Mapping[str, int | str] | None
    at: Mapping[str, Any] | None


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """What an FMU holds.

    Attributes:
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        platforms: what to compile for, such as ``linux64`` and ``win64``; those of `fmu.export` if None.
        version: of FMI: 2 or 3.
        linear_twin: also run the linear model on the same inputs, as outputs ``NAME_lin``.
        beside: also write ``NAME_linear.mat`` and ``NAME_linear.m`` beside the FMU, if there is a linear model.
        backend: ``c``, or ``python`` for a model with Python functions: the FMU then needs Python where it runs.
        modes: modes of the linear model, over those of the analysis; see `linearise`.
        at: operating point of the linear model, over that of the analysis.
    """

    inputs: Iterable[str] | None = None
    outputs: Iterable[str] | None = None
    platforms: Iterable[str] | None = None
    version: int = 2
    linear_twin: bool = False
    beside: bool = True
    backend: str = "c"
    modes: Mapping[str, int | str] | None = None
    at: Mapping[str, Any] | None = None


def export(
    source: Source | Cut,
    path: str | Path,
    analysis: str | None = None,
    options: ExportOptions | None = None,
    **given: Unpack[ExportKeywords],
) -> Path:
    """Write a scenario's model as an FMU, whose default experiment is that of the scenario.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        path: the file to write.
        analysis: name of an analysis in the file; the first of kind ``export`` if None.
        options: what the FMU holds.
        **given: fields of `ExportOptions` as keywords, over those of ``options``, such as ``version=3``.

    Returns:
        The path written.

    Raises:
        FlexarmError: a name that does not fit, or no compiler. Nothing is written then.
    """
    from fmu import export as write_fmu

    o = replace(options or ExportOptions(), **given)
    made = source if isinstance(source, Cut) else cut(source, "export", analysis, inputs=o.inputs, outputs=o.outputs)
    if o.backend not in ("c", "python"):
        raise ParameterError(f"there is no backend '{o.backend}'", remedy="allowed: c, python")
    settings: dict[str, Any] = {}
    if made.simulation is not None:
        settings |= {"step": made.simulation.step, "stop": made.simulation.stop}
    if o.backend == "python":
        if o.version != 2 or o.linear_twin or o.platforms is not None:
            raise ParameterError(
                "the python backend writes FMI 2 without a linear twin, for any platform that has Python",
                remedy="leave out --fmi, --linear-twin and --platforms",
            )
        from flexarm.recipe import LOADER, recipe
        from fmu.python_backend import export_python

        return export_python(made.model, path, LOADER, *recipe(made), **settings)
    if o.platforms is not None:
        settings["platforms"] = tuple(o.platforms)
    settings["magnitudes"] = magnitudes(made)
    model = made.model
    if o.beside or o.linear_twin:
        settings |= _linear_settings(made, o.modes, o.at)
    beside = o.beside and "linear" in settings
    return write_fmu(model, path, version=o.version, linear_twin=o.linear_twin, beside=beside, **settings)


def magnitudes(made: Cut) -> dict[str, float]:
    """How large the states get in the scenario's own run, by its own sources; SI units."""
    from fmu.nominal import magnitudes as largest

    found = made.simulation
    stop, step = (found.stop, found.step) if found is not None else (10.0, 1e-3)
    try:
        own = largest(made.scenario.build(), stop, step)
    except FlexarmError:  # inputs that are free in the scenario itself
        own = {}
    return own if all(own.get(state.name) for state in made.model.states) else largest(made.model, stop, step) | own


def _linear_settings(made: Cut, modes: Mapping[str, int | str] | None, at: Mapping[str, Any] | None) -> dict[str, Any]:
    """The linear models that travel with an FMU: those of the modes and point of its analysis, if there are any."""
    from engine.discretise import discretise as discrete
    from engine.linearise import linearise as linear

    model = made.model
    if not (model.states and model.inputs and model.outputs) or model.externals:
        return {}
    point = _point(made, modes, at)
    from fmu.linear import family

    at_point = linear(model, **point)
    found: dict[str, Any] = {"linear": at_point, "others": family(model, at_point, **point)}
    return found | ({"discrete": discrete(model, **point)} if model.clocks else {})


def compare(
    source: Source,
    recording: Recording | FrequencyTable | str | Path,
    *,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Hold a scenario against a recording; see `diagnosis.compare.compare`."""
    from diagnosis.compare import compare as run

    return run(as_scenario(source), recording, progress=progress)


__all__ = ["compare", "discretise", "export", "linearise", "simulate"]
