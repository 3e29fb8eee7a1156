"""Effects along a slide: the candidates of a shaft, told of the blocks and units of translation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from blocks.registry import registry
from diagnosis.effects.effect import Candidate, Sizes
from engine.ports import TRANSLATIONAL
from engine.system import System
from scenarios.amend import AtFlange, Between, Edit

TYPES = {"Inertia": "Mass"}
"""Twins whose names do not follow from that of the rotational block."""

NAMES = {"inertia": "mass", "rest_angle": "rest_position", "yield_twist": "yield_compression"}
"""Parameters that are called otherwise in the twin."""

UNITS = {
    "N.m": "N",
    "N.m.s/rad": "N.s/m",
    "N.m.s2/rad2": "N.s2/m2",
    "N.m/rad": "N/m",
    "N.m/rad3": "N/m3",
    "rad": "m",
    "rad/s": "m/s",
    "kg.m2": "kg",
}
"""Unit of a quantity of rotation: that of translation."""

SAME = ("frequency", "phase")
"""Parameters that mean the same in both."""


def slides(system: System, candidate: Candidate) -> bool:
    """Whether a candidate acts at a flange that slides."""
    for edit in candidate.edits(candidate.starts[0]):
        if isinstance(edit, AtFlange | Between):
            block, port = system.split(edit.target)
            return system.blocks[block].ports[port].kind == TRANSLATIONAL
    return False


def along_slide(candidate: Candidate) -> Candidate:
    """The candidate for a translational flange.

    Args:
        candidate: made for a rotational one, with sizes that are those of the slide.

    A block without a twin keeps a name that no block has, and the catalogue leaves it out.
    """
    back = {new: old for old, new in NAMES.items()}

    def edits(values: Sizes) -> list[Edit]:
        made = candidate.edits({back.get(key, key): value for key, value in values.items()})
        return [_translated(edit) for edit in made]

    return replace(
        candidate,
        edits=edits,
        parameters=tuple(
            replace(parameter, name=NAMES.get(parameter.name, parameter.name)) for parameter in candidate.parameters
        ),
        starts=tuple({NAMES.get(key, key): value for key, value in start.items()} for start in candidate.starts),
    )


def _translated(edit: Edit) -> Edit:
    if not isinstance(edit, AtFlange | Between):
        return edit
    kind = TYPES.get(edit.type, f"Translational{edit.type}")
    parameters = {NAMES.get(key, key): _unit(key, value) for key, value in edit.parameters.items()}
    if isinstance(edit, AtFlange):
        made = registry().get(kind)
        port = next((p.name for p in made.ports.values() if p.role == "flange"), edit.port) if made else edit.port
        return replace(edit, type=kind, port=port, parameters=parameters)
    return replace(edit, type=kind, parameters=parameters)


def _unit(key: str, value: Any) -> Any:
    if not isinstance(value, str) or " " not in value or key in SAME:
        return value
    number, unit = value.split(" ", 1)
    return f"{number} {UNITS.get(unit, unit)}"
