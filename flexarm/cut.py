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
    """A scenario's model with external inputs, and the blocks they replace; ``chosen`` says what nobody named."""

    model: Model
    bypassed: tuple[str, ...]
    settings: AnalysisSettings
    scenario: Scenario
    simulation: Simulation | None = None
    chosen: tuple[str, ...] = ()


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
        kind: of the analysis, such as ``linearise`` or ``export``.
        analysis: name of an analysis in the file; the first of that kind if None.
        inputs: signal inputs that replace those of the analysis; one may be a plain text.
        outputs: signals that replace those of the analysis; one may be a plain text.

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
    own = (("inputs are what the sources feed", inputs), ("outputs are what the run records", outputs))
    chosen = () if settings.name else tuple(text for text, given in own if not given)
    return Cut(model, tuple(dropped), settings, scenario, scenario.simulation, chosen)


def _is_block(scenario: Scenario, name: str) -> bool:
    parts = name.split(".")
    return any(".".join(parts[:cut]) in scenario.system.blocks for cut in range(len(parts), 0, -1))


def find_mode(model: Model, name: str) -> Mode | None:
    """A mode by its name, by one of the frictions that share it (``a + b``), or by the block whose only mode it is."""
    modes = [mode for mode in model.modes if mode.kind != TIME]
    found = [mode for mode in modes if name in (mode.name, *mode.name.split(" + "))]
    of_block = [mode for mode in modes if mode.name.startswith(f"{name}.")]
    return found[0] if found else of_block[0] if len(of_block) == 1 else None


DEFAULTED = ("linearise", "trim", "uncertain")
"""Kinds of analysis that choose their own inputs and outputs where the file describes no analysis."""


def default_ends(scenario: Scenario, inputs: tuple[str, ...] | None = None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Inputs and outputs where nobody names any: what sources feed, and what the run records.

    Args:
        scenario: the scenario.
        inputs: inputs that are given, in place of those.
    """
    system, made = scenario.system, scenario.system.sources()
    sources = {
        name
        for name, block in system.blocks.items()
        if not block.is_physical() and block.ports and all(port.role == "output" for port in block.ports.values())
    }
    fed = {end: system.split(made[end][0])[0] for end in system.inputs() if end in made}
    free = tuple(end for end, owner in fed.items() if owner in sources) if inputs is None else inputs
    gone = bypass(system, list(free))[1] if free else []
    planned = scenario.simulation
    wanted = planned.record if planned is not None and planned.record is not None else None
    names = wanted if wanted is not None else tuple(v.name for v in scenario.build().outputs)
    return free, tuple(name for name in names if system.split(name)[0] not in gone)


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
    candidates = list(fitting.values()) or [a for a in scenario.analyses.values() if a.inputs and a.outputs]
    found = fitting[analysis] if analysis is not None else candidates[0] if candidates else None
    given_inputs, given_outputs = (None if given is None else scenario.resolved(given) for given in (inputs, outputs))
    if found is None:
        if kind in DEFAULTED and not (given_inputs and given_outputs):
            own_inputs, own_outputs = default_ends(scenario, given_inputs)
            given_inputs, given_outputs = given_inputs or own_inputs, given_outputs or own_outputs
            if given_outputs:
                return AnalysisSettings("", kind, given_inputs, given_outputs)
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
        found.modes if kind != "trim" or found.kind == kind else {},  # an equilibrium finds its own
        found.at,
        found.options if found.kind == kind else {},
    )
