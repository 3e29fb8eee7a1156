"""The verbs of the public API on scenarios: simulate, linearise, export, compare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.model import TIME, Mode, Model
from engine.simulate import Drive, Result
from engine.simulate import simulate as run_model
from engine.system import bypass
from scenarios.load import AnalysisSettings, Scenario, Simulation, load, si
from scenarios.validate import ScenarioError

if TYPE_CHECKING:
    from diagnosis.compare import Comparison
    from diagnosis.recording import FrequencyTable, Recording
    from engine.discretise import DiscreteModel
    from engine.linearise import LinearModel

Source = Scenario | str | Path


def _scenario(source: Source) -> Scenario:
    return source if isinstance(source, Scenario) else load(source)


def simulate(
    source: Source | Model,
    stop: float | None = None,
    step: float | None = None,
    *,
    parameters: dict[str, float] | None = None,
    drive: Drive | None = None,
    initial: dict[str, float] | None = None,
    internal_step: float | None = None,
    step_tolerance: float | None = None,
    record_states: bool = False,
    backend: str = "auto",
) -> Result:
    """Simulate a scenario as its file says, or a model.

    Args:
        source: a scenario, its file or shipped name, or a model built from one.
        stop: end (s); that of the scenario if None.
        step: time between rows (s); that of the scenario, or 1 ms, if None.
        parameters: values that replace the model's, SI units.
        drive: external inputs of a model built with inputs.
        initial: starting values by name, SI units.
        internal_step: longest integration step (s).
        step_tolerance: warn if half that step changes an output by more than this share of its range.
        record_states: also keep states and modes at every row.
        backend: ``c``, ``interpreter`` or ``auto``.

    Raises:
        FlexarmError: the scenario or a value does not fit, or the simulation diverges.
    """
    if isinstance(source, Model):
        model = source
    else:
        scenario = _scenario(source)
        model = scenario.build()
        planned = scenario.simulation
        if planned is not None:
            stop = planned.stop if stop is None else stop
            step = planned.step if step is None else step
            internal_step = planned.internal_step if internal_step is None else internal_step
            step_tolerance = planned.step_tolerance if step_tolerance is None else step_tolerance
        elif stop is None:
            raise ScenarioError(
                "the scenario does not say how long to simulate",
                Where(scenario.document.file),
                "add 'simulate: {stop: 4 s}', or give a stop time",
            )
    if stop is None:
        raise ParameterError("no stop time is given", remedy="give one in seconds")
    return run_model(
        model,
        stop,
        1e-3 if step is None else step,
        parameters=parameters,
        drive=drive,
        initial=initial,
        internal_step=internal_step,
        step_tolerance=step_tolerance,
        record_states=record_states,
        backend=backend,
    )


@dataclass(frozen=True)
class Cut:
    """A scenario's model with external inputs, and the blocks those inputs replace."""

    model: Model
    bypassed: tuple[str, ...]
    settings: AnalysisSettings
    scenario: Scenario
    simulation: Simulation | None = None


def cut(
    source: Source,
    kind: str,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
) -> Cut:
    """Free a scenario's inputs for an analysis.

    Args:
        source: a scenario, its file or shipped name.
        kind: ``linearise`` or ``export``.
        analysis: name of an analysis in the file; the first of that kind if None.
        inputs: signal inputs that replace those of the analysis.
        outputs: signals that replace those of the analysis.

    Raises:
        FlexarmError: no such analysis, input or output.
    """
    scenario = _scenario(source)
    settings = _settings(scenario, kind, analysis, inputs, outputs)
    model = scenario.build(settings.inputs, settings.outputs)
    # A mode that the file asks for is gone when its friction is set to zero; a name that is no block stays wrong.
    kept = {
        name: value for name, value in settings.modes.items() if _mode(model, name) or not _is_block(scenario, name)
    }
    settings = replace(settings, modes=kept)
    dropped = bypass(scenario.system, list(settings.inputs), settings.outputs or ())[1]
    return Cut(model, tuple(dropped), settings, scenario, scenario.simulation)


def _is_block(scenario: Scenario, name: str) -> bool:
    parts = name.split(".")
    return any(".".join(parts[:cut]) in scenario.system.blocks for cut in range(len(parts), 0, -1))


def _mode(model: Model, name: str) -> Mode | None:
    """A mode by its name, or by one of the frictions that share it (``a + b``)."""
    found = [mode for mode in model.modes if mode.kind != TIME and name in (mode.name, *mode.name.split(" + "))]
    return found[0] if found else None


def _settings(
    scenario: Scenario, kind: str, analysis: str | None, inputs: Iterable[str] | None, outputs: Iterable[str] | None
) -> AnalysisSettings:
    fitting = {name: found for name, found in scenario.analyses.items() if found.kind == kind}
    if analysis is not None and analysis not in fitting:
        raise ScenarioError(
            f"the scenario has no analysis '{analysis}' of kind {kind}",
            scenario.where("analyses"),
            nearest(analysis, fitting),
        )
    # Any analysis names inputs and outputs, so one of the other kind will do where there is none of this.
    candidates = list(fitting.values()) or list(scenario.analyses.values())
    found = fitting[analysis] if analysis is not None else candidates[0] if candidates else None
    given_inputs = None if inputs is None else tuple(scenario.resolve(name) for name in inputs)
    given_outputs = None if outputs is None else tuple(scenario.resolve(name) for name in outputs)
    if found is None:
        if not given_inputs or not given_outputs:
            raise ScenarioError(
                f"the scenario describes no analysis of kind {kind}",
                Where(scenario.document.file),
                "add one under 'analyses:', or give inputs and outputs (-u and -y)",
            )
        return AnalysisSettings("", kind, given_inputs, given_outputs)
    return AnalysisSettings(
        found.name,
        kind,
        given_inputs or found.inputs,
        given_outputs or found.outputs,
        found.modes,
        found.at,
    )


def linearise(
    source: Source | Cut,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
) -> LinearModel:
    """The linear model of a scenario.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        analysis: name of an analysis in the file; the first of kind ``linearise`` if None.
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        modes: mode name -> label (``stuck``, ``inside``, ...), or -1, 0 or 1, over those of the analysis.
        at: states, motions and inputs at the point, over those of the analysis: SI numbers or texts with a unit.

    Raises:
        FlexarmError: a name, label or unit that does not fit, or the point lies between two modes and none is chosen.
    """
    from engine.linearise import linearise as linear

    made = source if isinstance(source, Cut) else cut(source, "linearise", analysis, inputs=inputs, outputs=outputs)
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
    from engine.discretise import discretise as discrete

    made = source if isinstance(source, Cut) else cut(source, "linearise", analysis, inputs=inputs, outputs=outputs)
    return discrete(made.model, **_point(made, modes, at))


def _point(made: Cut, modes: Mapping[str, int | str] | None, at: Mapping[str, Any] | None) -> dict[str, Any]:
    """Arguments for `engine.linearise.linearise`: the point and modes of the analysis and those given, in SI units."""
    model = made.model
    wanted: dict[str, int | str] = {**made.settings.modes, **(modes or {})}
    labels = dict(_label(model, name, value) for name, value in wanted.items())
    point: dict[str, Any] = {**made.settings.at, **(at or {})}
    input_units = {variable.name: variable.unit for variable in model.inputs}
    state_units = _motion_units(model)
    given = {name: si(value, {**state_units, **input_units}, name) for name, value in point.items()}
    return {
        "at": {name: value for name, value in given.items() if name not in input_units},
        "inputs": {name: value for name, value in given.items() if name in input_units},
        "modes": labels,
    }


def _motion_units(model: Model) -> dict[str, str]:
    """Units of everything that has a value at an operating point."""
    units = {variable.name: variable.unit for variable in (*model.states, *model.memories)}
    for flange in model.motions:
        for quantity, unit in (("angle", "rad"), ("speed", "rad/s"), ("position", "m")):
            units.setdefault(f"{flange}.{quantity}", unit)
    return units


def _label(model: Model, name: str, value: int | str) -> tuple[str, str]:
    """Full name of a mode, and the label of the value asked for."""
    found = _mode(model, name)
    if found is None:
        raise ParameterError(f"no mode '{name}'", remedy=nearest(name, [m.name for m in model.modes if m.kind != TIME]))
    if isinstance(value, str) and value not in ("-1", "0", "1", "+1"):
        return found.name, value
    number = int(value)
    if number not in (-1, 0, 1):
        raise ParameterError(f"mode '{name}' cannot be {number}", remedy="-1, 0, 1, or " + ", ".join(found.labels))
    return found.name, found.labels[number + 1]


def export(
    source: Source | Cut,
    path: str | Path,
    analysis: str | None = None,
    *,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
    platforms: Iterable[str] | None = None,
    version: int = 2,
    linear_twin: bool = False,
    beside: bool = True,
    backend: str = "c",
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
) -> Path:
    """Write a scenario's model as an FMU, whose default experiment is that of the scenario.

    Args:
        source: a scenario, its file or shipped name, or the result of `cut`.
        path: the file to write.
        analysis: name of an analysis in the file; the first of kind ``export`` if None.
        inputs: signal inputs in place of those of the analysis.
        outputs: signals in place of those of the analysis.
        platforms: what to compile for, such as ``linux64`` and ``win64``; those of `fmu.export` if None.
        version: of FMI: 2 or 3.
        linear_twin: also run the linear model on the same inputs, as outputs ``NAME_lin``.
        beside: also write ``NAME_linear.mat`` and ``NAME_linear.m`` beside the FMU, if there is a linear model.
        backend: ``c``, or ``python`` for a model with Python functions: the FMU then needs Python where it runs.
        modes: modes of the linear model, over those of the analysis; see `linearise`.
        at: operating point of the linear model, over that of the analysis.

    Returns:
        The path written.

    Raises:
        FlexarmError: a name that does not fit, or no compiler. Nothing is written then.
    """
    from fmu import export as write_fmu

    made = source if isinstance(source, Cut) else cut(source, "export", analysis, inputs=inputs, outputs=outputs)
    if backend not in ("c", "python"):
        raise ParameterError(f"there is no backend '{backend}'", remedy="allowed: c, python")
    settings: dict[str, Any] = {}
    if made.simulation is not None:
        settings |= {"step": made.simulation.step, "stop": made.simulation.stop}
    if backend == "python":
        if version != 2 or linear_twin or platforms is not None:
            raise ParameterError(
                "the python backend writes FMI 2 without a linear twin, for any platform that has Python",
                remedy="leave out --fmi, --linear-twin and --platforms",
            )
        from flexarm.recipe import LOADER, recipe
        from fmu.python_backend import export_python

        return export_python(made.model, path, LOADER, *recipe(made), **settings)
    if platforms is not None:
        settings["platforms"] = tuple(platforms)
    settings["magnitudes"] = magnitudes(made)
    model = made.model
    if beside or linear_twin:
        settings |= _linear_settings(made, modes, at)
        beside = beside and "linear" in settings
    return write_fmu(model, path, version=version, linear_twin=linear_twin, beside=beside, **settings)


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

    return run(_scenario(source), recording, progress=progress)


__all__ = ["Cut", "FlexarmError", "compare", "cut", "discretise", "export", "linearise", "simulate"]
