"""What may be missing in a mount: a spring between two slides that gives way more than it should, or has play."""

from __future__ import annotations

import math
from collections.abc import Iterator

from diagnosis.effects.effect import Candidate, EffectParameter, Sizes, shares, with_unit
from diagnosis.effects.scales import OperatingScales
from scenarios.amend import Edit, Replace, Set

GIVES = (0.003, 0.02, 0.1, 0.3)
"""Starting sizes of what a mount gives way by under the force that acts, as shares of the travel."""

PLAYS = (0.003, 0.03, 0.15, 0.4)
"""Starting sizes of play, as shares of the travel."""


def at_mounts(scales: OperatingScales) -> Iterator[Candidate]:
    """Compliance and play of every translational spring; its own stiffness was given for a mount that has neither."""
    for name, block in scales.problem.scenario.system.blocks.items():
        if type(block).__name__ != "TranslationalSpringDamper":
            continue
        ends = [flange for flange, members in scales.groups.items() if _ends(name, [flange, *members])]
        force = max((scales.torque[flange] for flange in ends), default=1.0)
        travel = max((scales.angle[flange] for flange in ends), default=1.0)
        mass = min((scales.inertia[flange] for flange in ends), default=1.0)
        springs = []
        for give in shares(travel, *GIVES):
            stiffness = force / give
            springs.append({"stiffness": stiffness, "damping": 0.1 * math.sqrt(stiffness * mass)})
        parameters = (
            EffectParameter("stiffness", springs[1]["stiffness"]),
            EffectParameter("damping", springs[1]["damping"]),
        )

        def softer(values: Sizes, name: str = name) -> list[Edit]:
            return [Set(name, key, with_unit(values[key], unit)) for key, unit in _UNITS.items() if key in values]

        def loose(values: Sizes, name: str = name) -> list[Edit]:
            given = {key: with_unit(values[key], unit) for key, unit in _UNITS.items() if key in values}
            return [Replace(name, "TranslationalBacklash", {"law": "push_only", **given}, ("rest_distance",))]

        yield Candidate("joint_flexibility", name, name, name, softer, parameters, tuple(springs))
        plays = tuple({"half_gap": gap, **s} for gap in shares(travel, *PLAYS) for s in springs)
        yield Candidate("backlash", name, name, name, loose, (EffectParameter("half_gap", travel), *parameters), plays)


_UNITS = {"stiffness": "N/m", "damping": "N.s/m", "half_gap": "m"}


def _ends(name: str, flanges: list[str]) -> bool:
    return any(flange in (f"{name}.a", f"{name}.b") for flange in flanges)
