"""The operating point of an analysis: names, units and labels as the engine takes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from engine.errors import FlexarmError, ParameterError, nearest
from engine.model import TIME, Model
from engine.ports import MOTION
from flexarm.cut import Cut, cut, find_mode
from scenarios.load import AnalysisSettings, si
from scenarios.validate import ScenarioError

if TYPE_CHECKING:
    from engine.trim import Equilibrium


@contextmanager
def own(made: Cut, section: str, key: str, given: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Give an error the place of a key of the analysis in the file, unless the key is ``given`` from outside."""
    try:
        yield
    except FlexarmError as error:
        if made.settings.name and key not in (given or {}):
            raise error.at(made.scenario.where("analyses", made.settings.name, section, key)) from None
        raise


def point(made: Cut, modes: Mapping[str, int | str] | None, at: Mapping[str, Any] | None) -> dict[str, Any]:
    """Arguments for `engine.linearise.linearise`: the point and modes of the analysis and those given, in SI units."""
    model, resolve = made.model, made.scenario.resolve
    wanted: dict[str, int | str] = {**made.settings.modes, **(modes or {})}
    labels: dict[str, int | str] = {}
    for name, value in wanted.items():
        with own(made, "modes", name, modes):
            labels.update([label(model, name, value)])
    outside = {resolve(name): value for name, value in (at or {}).items()}
    point: dict[str, Any] = {**made.settings.at, **outside}
    input_units = {variable.name: variable.unit for variable in model.inputs}
    state_units = motion_units(made)
    given: dict[str, float] = {}
    for name, value in point.items():
        with own(made, "at", name, outside):
            given[name] = si(value, {**state_units, **input_units}, name)
    return {
        "at": {name: value for name, value in given.items() if name not in input_units},
        "inputs": {name: value for name, value in given.items() if name in input_units},
        "modes": labels,
    }


def motion_units(made: Cut) -> dict[str, str]:
    """Units of everything that has a value at an operating point, each flange's by its own kind."""
    units = {variable.name: variable.unit for variable in (*made.model.states, *made.model.memories)}
    system = made.scenario.system
    for name in made.model.motions:
        block, port = system.split(name)
        for quantity, unit in MOTION[system.blocks[block].ports[port].kind][:2]:
            units.setdefault(f"{name}.{quantity}", unit)
    return units


def label(model: Model, name: str, value: int | str) -> tuple[str, str]:
    """Full name of a mode, and the label of the value asked for."""
    found = find_mode(model, name)
    if found is None:
        raise ParameterError(f"no mode '{name}'", remedy=nearest(name, [m.name for m in model.modes if m.kind != TIME]))
    if isinstance(value, str) and value not in ("-1", "0", "1", "+1"):
        if value not in found.labels:
            raise ParameterError(f"mode '{name}' is never '{value}'", remedy=nearest(value, found.labels))
        return found.name, value
    number = int(value)
    if number not in (-1, 0, 1):
        raise ParameterError(f"mode '{name}' cannot be {number}", remedy="-1, 0, 1, or " + ", ".join(found.labels))
    return found.name, found.labels[number + 1]


def equilibrium(
    made: Cut,
    *,
    modes: Mapping[str, int | str] | None = None,
    at: Mapping[str, Any] | None = None,
    fix: Mapping[str, Any] | None = None,
    free: tuple[str, ...] | None = None,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
) -> Equilibrium:
    """The equilibrium that a trim analysis asks for, with what is given over it; see `engine.trim.trim`."""
    from engine.trim import trim

    return trim(made.model, **point(made, modes, at), **wanted(made, fix, free, bounds))


def wanted(
    made: Cut,
    fix: Mapping[str, Any] | None = None,
    free: tuple[str, ...] | None = None,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
) -> dict[str, Any]:
    """What a trim analysis fixes, frees and bounds, with what is given over it, as `engine.trim.trim` takes it."""
    model, options, names = made.model, made.settings.options, made.scenario.resolve
    units = motion_units(made) | {v.name: v.unit for v in (*model.inputs, *model.outputs)}
    fixed, limits = {}, {}
    for key, value in {**options.get("fix", {}), **(fix or {})}.items():
        with own(made, "fix", key, fix):
            fixed[names(key)] = si(value, units, names(key))
    for key, ends in {**options.get("bounds", {}), **(bounds or {})}.items():
        with own(made, "bounds", key, bounds):
            if isinstance(ends, str) or not hasattr(ends, "__len__") or len(ends) != 2:
                raise ParameterError(
                    f"the bounds of '{key}' are {ends!r}", remedy="give two: the least and the greatest value"
                )
            low, high = ends
            limits[names(key)] = si(low, units, names(key)), si(high, units, names(key))
    inputs = [v.name for v in model.inputs]
    freed = [names(name) for name in (options.get("free", ()) if free is None else free)]
    if free is None:  # what is given replaces what the file says
        freed = [name for name in freed if name not in {names(key) for key in fix or {}}]
    for name in freed:
        with own(made, "free", name, dict.fromkeys(free or ())):
            if name not in inputs:
                raise ParameterError(f"'{name}' is not an input that can be free", remedy=nearest(name, inputs))
    return {"fix": fixed, "free": freed, "bounds": limits}


def trim_arguments(made: Cut, name: str, modes: Mapping[str, int | str] | None = None) -> dict[str, Any]:
    """What an analysis of kind ``trim`` fixes, frees and bounds, and the modes it or ``modes`` holds, for a model."""
    settings = _trim_settings(made, name)
    there = replace(made, settings=settings)
    return wanted(there) | {"modes": point(there, modes, None)["modes"]}


def _trim_settings(made: Cut, name: str | None) -> AnalysisSettings:
    chosen = None if name in (None, "auto") else name
    known = {key for key, found in made.scenario.analyses.items() if found.kind == "trim"}
    if chosen is not None and chosen not in known and made.settings.options.get("trim") == chosen:
        raise ScenarioError(
            f"the scenario has no analysis '{chosen}' of kind trim",
            made.scenario.where("analyses", made.settings.name, "trim"),
            nearest(chosen, known) if known else "add one under 'analyses:', or say auto",
        )
    return cut(made.scenario, "trim", chosen, inputs=made.settings.inputs, outputs=made.settings.outputs).settings


def trimmed(made: Cut, name: str | None = None, at: Mapping[str, Any] | None = None) -> Equilibrium:
    """The equilibrium of an analysis of kind ``trim``, for the model of another analysis.

    Args:
        made: the model with its inputs and outputs.
        name: of the analysis; the first of that kind if None or ``auto``, and without one the nearest to the start.
        at: where to begin, over that of either analysis.

    Raises:
        FlexarmError: no such analysis, or no equilibrium.
    """
    settings = _trim_settings(made, name)
    given = {v.name for v in made.model.inputs}
    begin = {k: v for k, v in {**made.settings.at, **settings.at}.items() if k in motion_units(made) or k in given}
    settings = replace(settings, at={**begin, **(at or {})})
    return equilibrium(replace(made, settings=settings))


def start_of(made: Cut, asked: dict[str, Any], trim: str | None, at: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Arguments of the engine's linearisation: the point asked for, or the equilibrium of a trim analysis near it."""
    trim = trim or made.settings.options.get("trim")
    if trim is None:
        return asked
    found = trimmed(made, trim, at).arguments()
    return found | {"modes": {**found["modes"], **asked["modes"]}}
