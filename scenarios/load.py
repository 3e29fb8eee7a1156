"""Load a scenario from a file or a shipped name: apply overrides, check it, and make its system."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.display import counts
from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.files import is_file
from engine.ports import MOTION
from engine.quantity import convert, number_or_text
from engine.rows import check_rows
from engine.system import System
from scenarios.common import root_scope, substitute
from scenarios.document import Node, parse, read
from scenarios.flatten import Flat, flatten
from scenarios.patch import override
from scenarios.schema import AnyAnalysis, FrequencyRecording, ScenarioFile, TimeRecording
from scenarios.validate import ScenarioError, validate

if TYPE_CHECKING:
    from engine.model import Model

SHIPPED = Path(__file__).parent
"""Folder of the scenarios that come with flexarm."""

_BLOCKS = re.compile(rb"^[\"']?blocks[\"']?\s*:", re.MULTILINE)
"""The key that every scenario has."""

NAMED = 5
"""Files of a folder that are named where one of them was meant."""


@dataclass(frozen=True)
class Simulation:
    """How to simulate: times in seconds, signals to record (None for all)."""

    stop: float
    step: float = 1e-3
    internal_step: float | None = None
    step_tolerance: float | None = None
    record: tuple[str, ...] | None = None


@dataclass(frozen=True)
class AnalysisSettings:
    """An analysis of the file: its kind, inputs, outputs, modes, operating point, and what else its kind has.

    Numbers of ``at`` and of ``options`` are as they stand in the file, parameters of the scenario put in.
    """

    name: str
    kind: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    modes: dict[str, int | str] = field(default_factory=dict)
    at: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(repr=False)
class Scenario:
    """A scenario, checked and ready to be built.

    Attributes:
        path: the file.
        file: the file's fixed structure.
        system: blocks and connections.
        simulation: how to simulate, None if the file does not say.
        analyses, recordings: by name.
        tolerances: shares by which a fit or a draw may move parameters; of a vector, one for each of its values.
        digest: identifies the content of every file read and the overrides.
        document: the file as a tree with line numbers, overrides included.
        overrides: the ``key=value`` texts applied.
    """

    path: Path
    file: ScenarioFile
    system: System
    simulation: Simulation | None
    analyses: dict[str, AnalysisSettings]
    recordings: dict[str, TimeRecording | FrequencyRecording]
    tolerances: dict[str, float]
    digest: str
    document: Node
    overrides: tuple[str, ...] = ()
    flat: Flat = field(repr=False, default_factory=lambda: Flat(System({}, [])))

    def __repr__(self) -> str:
        return f"<scenario '{self.name}': {counts(blocks=len(self.system.blocks))}, from {self.path}>"

    @property
    def name(self) -> str:
        """The scenario's name."""
        return self.file.name

    @property
    def description(self) -> str:
        """The scenario's description."""
        return self.file.description

    def where(self, *path: str | int) -> Where:
        """The place of a path of keys in the file."""
        return self.document.where(*path)

    def resolve(self, name: str) -> str:
        """A signal's name with exposed names replaced by the inner ones."""
        return self.flat.resolve(name)

    def resolved(self, names: Iterable[str]) -> tuple[str, ...]:
        """Signals, or a single one as a plain text, with exposed names replaced by the inner ones."""
        return tuple(self.resolve(name) for name in ([names] if isinstance(names, str) else names))

    def build(
        self,
        inputs: Iterable[str] = (),
        outputs: Iterable[str] | None = None,
        *,
        energy: bool = False,
        system: System | None = None,
        variant: bool = False,
        smooth_readings: bool = False,
    ) -> Model:
        """The model: see `engine.assemble.build`.

        Args:
            inputs: signal inputs to drive from outside, in this order; one may be a plain text.
            outputs: signals to output, likewise; those the file records if None.
            energy: also keep the energy balance.
            system: build this variant of the scenario's system instead.
            variant: this is one of many that are alike.
            smooth_readings: encoders tell a motion by the straight line through their steps.

        Raises:
            FlexarmError: a wrong connection; the place in the file is named.
        """
        from engine.assemble import build

        if outputs is None and self.simulation is not None and self.simulation.record is not None:
            outputs = self.simulation.record
        wanted = None if outputs is None else [*self.resolved(outputs)]
        free = [*self.resolved(inputs)]
        try:
            model = build(
                system or self.system,
                inputs=free,
                outputs=wanted,
                energy=energy,
                variant=variant,
                smooth_readings=smooth_readings,
            )
        except FlexarmError as error:
            self._check_ends()
            raise error.at(self._named(error.signal, free, wanted or []) or Where(self.document.file)) from None
        self._starting_values(model)
        if system is None:
            self._begun(model)
        return model

    def _check_ends(self) -> None:
        """Refuse an end of a connection that names no connector: the engine would take it for a further signal."""
        for connection in self.system.connections:
            for end in connection.ends:
                block, port = self.system.split(end, connection.where)
                made = self.system.blocks[block]
                if port not in made.ports and self.system_observable(end) is None:
                    names = [f"{block}.{name}" for name in made.ports]
                    close = nearest(end, names)
                    if close.startswith("did you mean") or "." not in port:
                        raise ScenarioError(f"'{end}' names no connector of '{block}'", connection.where, close)

    def _named(self, signal: str, inputs: list[str], outputs: list[str]) -> Where | None:
        """Where the file names a signal to record, to drive or to give out; None if it does not, or none is meant.

        Args:
            signal: which.
            inputs: of the model that was asked for; a list with just these comes before others.
            outputs: the same.
        """
        lists: list[tuple[list[str], tuple[str, ...]]] = []
        for key, analysis in self.file.analyses.items():
            lists.append((analysis.inputs, ("analyses", key, "inputs")))
        if self.file.simulate:
            lists.append((self.file.simulate.record or [], ("simulate", "record")))
        for key, analysis in self.file.analyses.items():
            lists.append((analysis.outputs, ("analyses", key, "outputs")))
        resolved = [([self.resolve(name) for name in names], path) for names, path in lists]
        resolved.sort(key=lambda pair: pair[0] not in (inputs, outputs))
        for names, path in resolved:
            if signal in names:
                return self.where(*path, names.index(signal))
        return None

    def _starting_values(self, model: Model) -> None:
        """Check the names and units of starting values against the model."""
        units = {state.name: state.unit for state in model.states}
        for name, node in self.flat.initial.items():
            place = Where(node.file, node.line, f"initial.{name}")
            if self.system_observable(name) is None:
                if name not in units:
                    raise ScenarioError(f"'{name}' is not a state of the model", place, nearest(name, units))
                _number(node.value, units[name], place)

    def _begun(self, model: Model) -> None:
        """Refuse starting values that contradict one another, where the file gives them."""
        from engine.start import start_values

        try:
            start_values(model, model.parameter_values)
        except ParameterError as error:
            node = self.flat.initial.get(error.signal)
            place = Where(node.file, node.line, f"initial.{error.signal}") if node else Where(self.document.file)
            raise error.at(place) from None

    def tolerances_of(self, model: Model) -> dict[str, float]:
        """The stated tolerances of a model's parameters.

        Raises:
            ParameterError: the file states one of a parameter that the model does not have.
        """
        known = [parameter.name for parameter in model.parameters]
        for name in self.tolerances:
            if name in known:
                continue
            if common := self.system.followed(name):
                shown = " and ".join(f"'{each}'" for each in common)
                raise ParameterError(
                    f"'{name}' follows {shown}", self.where("tolerances", name), f"state the tolerance of {shown}"
                )
            raise ParameterError(
                f"the model has no parameter '{name}'", self.where("tolerances", name), nearest(name, known)
            )
        return self.tolerances

    def system_observable(self, name: str) -> tuple[str, str, int] | None:
        """Block, flange and derivative order of the motion of a flange; None for anything else."""
        try:
            return self.system.observable(name)
        except FlexarmError:
            return None


def _number(value: Any, unit: str, where: Where) -> float:
    try:
        return convert(value, unit)
    except ParameterError as error:
        raise error.at(where) from None


def _share(given: Any, where: Where) -> float:
    """A tolerance.

    Raises:
        ParameterError: it is no share, below zero, or a number above 1 that does not say whether it is in per cent.
    """
    share = _number(given, "1", where)
    if share < 0:
        raise ParameterError(f"a tolerance of {given}", where, "give a share such as 0.1, or 0 for a known value")
    if share > 1 and number_or_text(str(given)) == share:
        raise ParameterError(
            f"a tolerance of {given} is {100 * share:g} %", where, f"write '{given} %', or '{100 * share:g} %' if it is"
        )
    return share


def _tolerances(document: Node, file: ScenarioFile, system: System) -> dict[str, float]:
    """Tolerances by parameter: that of a vector holds for each of its values that has none of its own."""
    stated = {name: _share(given, document.where("tolerances", name)) for name, given in file.tolerances.items()}
    values = {name: _values(system, name) for name in stated}
    spread = {one: stated[name] for name, each in values.items() for one in each}
    return spread | {name: share for name, share in stated.items() if not values[name]}


def _values(system: System, name: str) -> list[str]:
    """Names of a vector's values that follow no parameter of the scenario, if a block has a vector of that name."""
    block, _, parameter = name.rpartition(".")
    declared = system.blocks[block].parameters.get(parameter) if block in system.blocks else None
    if declared is None or not declared.size:
        return []
    every = [f"{name}[{k}]" for k in range(1, 1 + len(system.blocks[block].values[parameter]))]
    return [one for one in every if not system.followed(one)]


def find(path_or_name: str | Path) -> Path:
    """The file of a scenario, given its path or the name of a shipped one.

    Raises:
        ScenarioError: there is none; names the nearest.
    """
    path = Path(path_or_name)
    if is_file(path):
        return path
    text = str(path_or_name)
    if path.name == text and not path.suffix:
        shipped = SHIPPED / f"{text}.yaml"
        if shipped.is_file():
            return shipped
    try:
        if path.is_dir() and (inside := _scenarios_in(path)):
            told = ", ".join(inside[:NAMED]) + (", ..." if len(inside) > NAMED else "")
            raise ScenarioError(f"'{text}' is a folder", remedy=f"give a scenario in it: {told}")
        around = _scenarios_in(path.parent) if path.parent.is_dir() else []
        what = "is a folder" if path.is_dir() else "is no regular file" if path.exists() else "does not exist"
    except OSError as error:  # such as a name that is too long
        raise ScenarioError(f"'{text}' cannot be read: {error.strerror}", remedy="give a file name") from None
    raise ScenarioError(f"'{text}' {what}", remedy=nearest(text, [*shipped_names(), *around]))


def _scenarios_in(folder: Path) -> list[str]:
    """Files of a folder that have blocks: a project has other YAML files too."""
    return [str(path) for path in sorted(folder.glob("*.y*ml")) if _has_blocks(path)]


def _has_blocks(path: Path) -> bool:
    try:
        return is_file(path) and _BLOCKS.search(path.read_bytes()) is not None
    except OSError:  # one that may not be read is not proposed
        return False


def shipped_names() -> list[str]:
    """Names of the scenarios that come with flexarm."""
    return sorted(path.stem for path in SHIPPED.glob("*.yaml"))


def load(path_or_name: str | Path, overrides: Iterable[str] = (), *, text: str | None = None) -> Scenario:
    """Load a scenario.

    Args:
        path_or_name: a YAML file, or the name of a shipped scenario such as ``quanser-single-link``.
        overrides: ``key=value`` texts, applied in order; see `scenarios.patch.override`.
        text: used instead of the file's content; paths in it are relative to the file.

    Raises:
        FlexarmError: the first problem found, with file, line, key and remedy.
    """
    from blocks.registry import find as find_block

    path, texts = find(path_or_name), tuple(overrides)
    document = read(path) if text is None else parse(text, str(path))
    if isinstance(document.value, dict):
        for change in texts:
            document = override(document, change)
    file = validate(document)
    flat = flatten(document, path, find_block)
    flat.system.description = file.description
    scenario = Scenario(
        path=path,
        file=file,
        system=flat.system,
        simulation=_simulation(document, file, flat),
        analyses={name: _analysis(document, name, made, flat) for name, made in file.analyses.items()},
        recordings=dict(file.recordings),
        tolerances=_tolerances(document, file, flat.system),
        digest=_digest(flat.files, texts, {} if text is None else {path: text}),
        document=document,
        overrides=texts,
        flat=flat,
    )
    for name, node in flat.initial.items():
        seen, unit = scenario.system_observable(name), "*"
        where = Where(node.file, node.line, f"initial.{name}")
        if seen is not None:
            block, port, order = seen
            if order == 2:
                raise ScenarioError(f"'{name}' is an acceleration and has no starting value", where)
            unit = MOTION[flat.system.blocks[block].ports[port].kind][order][1]
        flat.system.initial[name] = _number(node.value, unit, where)
    return scenario


def _digest(files: list[Path], overrides: tuple[str, ...], texts: dict[Path, str]) -> str:
    """The hash of files, of texts that were read in their place, and of overrides."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(texts[path].encode() if path in texts else path.read_bytes())
    digest.update("\0".join(overrides).encode())
    return digest.hexdigest()[:16]


def _simulation(document: Node, file: ScenarioFile, flat: Flat) -> Simulation | None:
    if file.simulate is None:
        return None
    scope = root_scope(document)

    def positive(key: str, unit: str = "s") -> float | None:
        node = document.get("simulate", key)
        if node is None or node.value is None:
            return None
        where = document.where("simulate", key)
        number = _number(substitute(node, scope, where), unit, where)
        if number <= 0:
            raise ScenarioError(f"{node.value!r} is not a positive {'time' if unit == 's' else 'number'}", where)
        return number

    stop, step = positive("stop"), positive("step") or 1e-3
    assert stop is not None
    try:
        check_rows(stop, step)
    except ParameterError as error:
        raise error.at(document.where("simulate", "step")) from None
    record = None if file.simulate.record is None else tuple(flat.resolve(name) for name in file.simulate.record)
    return Simulation(stop, step, positive("internal_step"), positive("step_tolerance", "1"), record)


def _analysis(document: Node, name: str, made: AnyAnalysis, flat: Flat) -> AnalysisSettings:
    scope, found = root_scope(document), made.model_dump()
    for key in ("kind", "inputs", "outputs"):
        found.pop(key)

    def value(*path: str | int) -> Any:
        node = document.get("analyses", name, *path)
        assert node is not None
        return substitute(node, scope, document.where("analyses", name, *path))

    for key, given in found.items():
        if key in _NAMED and given:
            found[key] = {flat.resolve(end): value(key, end) for end in given}
        elif key == "bounds":
            found[key] = {flat.resolve(end): tuple(value(key, end, i) for i in range(2)) for end in given}
        elif key == "amplitudes":
            found[key] = [value(key, i) for i in range(len(given))]
        elif key == "snapshots" and given is not None:
            found[key] = value(key)
        elif key == "free":
            found[key] = [flat.resolve(end) for end in given]
        elif key == "modes":
            found[key] = {flat.resolve(mode): label for mode, label in given.items()}
    return AnalysisSettings(
        name,
        made.kind,
        tuple(flat.resolve(end) for end in made.inputs),
        tuple(flat.resolve(end) for end in made.outputs),
        found.pop("modes", {}),
        found.pop("at", {}),
        found,
    )


_NAMED = ("at", "fix", "grid")
"""Sections of an analysis whose keys name variables of the model."""


def si(value: object, units: dict[str, str], name: str, where: Where | None = None) -> float:
    """A value as a number in the unit of the named variable.

    Raises:
        ScenarioError: no such variable.
        ParameterError: wrong unit.
    """
    if name not in units:
        raise ScenarioError(f"'{name}' is not a state or input of the model", where, nearest(name, units))
    try:
        return convert(value, units[name])
    except ParameterError as error:
        raise (error.at(where) if where else error) from None
