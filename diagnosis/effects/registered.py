"""Effects of other packages.

A package adds effects by the entry point group ``flexarm.effects``; the name is the effect's machine name::

    [project.entry-points."flexarm.effects"]
    eddy_current_drag = "my_package.effects:eddy_current_drag"

The function is called for each place of the scenario with `OperatingScales` and a `Place`, and returns `Candidate`s,
none where the effect cannot act.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from blocks.registry import registry
from diagnosis.effects.effect import Candidate
from diagnosis.effects.places import BLOCK, INPUT, JOINT, SENSOR, SHAFT, Place
from diagnosis.effects.scales import OperatingScales
from engine.errors import FlexarmError, nearest

GROUP = "flexarm.effects"


@dataclass(frozen=True)
class RegisteredEffect:
    """An effect that another package registers; it is imported when it is used.

    Attributes:
        entry: its entry point.
    """

    entry: EntryPoint

    @property
    def name(self) -> str:
        """Machine name."""
        return self.entry.name

    @property
    def owner(self) -> str:
        """The distribution that registers it, and where it lies."""
        return f"{_distribution(self.entry)} ({self.entry.value})"

    def candidates(self, scales: OperatingScales) -> list[Candidate]:
        """The effect at every place where it can act.

        Raises:
            FlexarmError: it cannot be imported, raises an error, or returns what cannot be put in.
        """
        try:
            function = self.entry.load()
        except Exception as error:
            raise self._unusable(f"it cannot be imported: {type(error).__name__}: {error}") from error
        if not callable(function):
            raise self._unusable("it is not a function of operating scales and a place")
        rows: list[Candidate] = []
        for kind in (INPUT, SHAFT, JOINT, BLOCK, SENSOR):
            for place in scales.places(kind):
                where = f"at the {kind} '{place.name}'"
                try:
                    made: list[Any] = list(function(scales, place))
                except Exception as error:
                    raise self._unusable(f"{where} it raises {type(error).__name__}: {error}") from error
                for candidate in made:
                    self._check(candidate, place, where)
                rows += made
        for key, count in Counter(candidate.key for candidate in rows).items():
            if count > 1:
                raise self._unusable(f"{count} of its candidates have the key '{key}'; the key tells them apart")
        return rows

    def _check(self, candidate: Any, place: Place, where: str) -> None:
        """Check that what the function returned can be put in."""
        if not isinstance(candidate, Candidate):
            raise self._unusable(f"{where} it returns {candidate!r}, which is no Candidate")
        if candidate.effect != self.name:
            raise self._unusable(f"{where} its candidate is called '{candidate.effect}', not '{self.name}'")
        if not candidate.starts:
            raise self._unusable(f"{where} its candidate has no sizes to start from")
        for start in candidate.starts:
            for parameter in candidate.parameters:
                if parameter.name not in start:
                    raise self._unusable(f"{where} a start of its candidate has no '{parameter.name}': {start}")
        try:
            edits = candidate.edits(candidate.starts[0])
        except Exception as error:
            raise self._unusable(f"{where} its edits raise {type(error).__name__}: {error}") from error
        for edit in edits:
            used = getattr(edit, "type", None)
            if used is not None and used not in registry():
                raise self._unusable(f"{where} there is no block type '{used}': {nearest(used, registry())}")

    def _unusable(self, why: str) -> FlexarmError:
        return FlexarmError(
            f"effect '{self.name}' of {self.owner}: {why}",
            remedy=f"mend that package or uninstall it, or leave the effect out: --without {self.name}",
        )


def registered(taken: Collection[str]) -> dict[str, RegisteredEffect]:
    """Effects that other packages register, by name; none is imported yet.

    Args:
        taken: names that are in use.

    Raises:
        FlexarmError: a name is in use, or registered twice.
    """
    found: dict[str, RegisteredEffect] = {}
    for entry in entry_points(group=GROUP):
        if entry.name in taken:
            raise FlexarmError(
                f"{_distribution(entry)} ({entry.value}) registers the effect '{entry.name}', which flexarm has itself",
                remedy="give it another name in the package's pyproject.toml, or uninstall the package",
            )
        other = found.get(entry.name)
        if other is not None and other.entry.value != entry.value:
            raise FlexarmError(
                f"{_distribution(entry)} ({entry.value}) and {other.owner} both register the effect '{entry.name}'",
                remedy="uninstall one of them",
            )
        found[entry.name] = RegisteredEffect(entry)
    return found


def _distribution(entry: EntryPoint) -> str:
    return f"distribution '{entry.dist.name}'" if entry.dist is not None else "an unknown distribution"
