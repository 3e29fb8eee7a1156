"""A scenario cut open for an analysis: its inputs freed, its outputs chosen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from engine.errors import Where, nearest
from engine.model import TIME, Mode, Model
from engine.system import bypass
from scenarios.load import AnalysisSettings, Scenario, Simulation, load
from scenarios.validate import ScenarioError

Source = Scenario | str | Path
"""A scenario, its file or shipped name."""


def as_scenario(source: Source) -> Scenario:
    """The scenario itself, read if it is given as a file or name."""
    return source if isinstance(source, Scenario) else load(source)


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
    scenario = as_scenario(source)
    settings = _settings(scenario, kind, analysis, inputs, outputs)
    model = scenario.build(settings.inputs, settings.outputs)
    # A mode that the file asks for is gone when its friction is set to zero; a name that is no block stays wrong.
    kept = {
        name: value for name, value in settings.modes.items() if find_mode(model, name) or not _is_block(scenario, name)
    }
    settings = replace(settings, modes=kept)
    dropped = bypass(scenario.system, list(settings.inputs), settings.outputs or ())[1]
    return Cut(model, tuple(dropped), settings, scenario, scenario.simulation)


def _is_block(scenario: Scenario, name: str) -> bool:
    parts = name.split(".")
    return any(".".join(parts[:cut]) in scenario.system.blocks for cut in range(len(parts), 0, -1))


def find_mode(model: Model, name: str) -> Mode | None:
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
