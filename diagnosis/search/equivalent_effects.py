"""Laws that contain others, and pairs of effects that are known to do what a single one does.

While something moves, Coulomb friction with a constant force beside it is friction that differs between the
directions; driven in one direction only, it is a dead zone. A further body on a spring and damper is, at low
frequencies, a spring and a damper to the ground. Where the single effect is in the best model, the pair is fitted
too, and where the pair is, the single effect, so that the verdict can say whether the recordings tell them apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from diagnosis.effects.effect import Candidate, all_beside
from diagnosis.search.scored_model import ScoredModel

NESTED = {
    "coulomb_friction": ("stribeck_friction", "direction_dependent_friction", "load_dependent_friction"),
    "load_dependent_friction": ("quadratic_load_friction",),
    "joint_flexibility": ("hardening_spring", "backlash", "hysteresis"),
    # A further body that is heavy, stiffly held or both is no further body.
    "viscous_friction": ("extra_mode",),
    "stray_spring": ("extra_mode",),
    "payload": ("extra_mode",),
}
"""Effect: those at the same place that contain it."""

NESTED_ANYWHERE = {"offset": ("stray_spring",)}
"""The same wherever they are: a soft spring at rest outside the range of its angle is nearly a constant torque."""

KNOWN = {
    "direction_dependent_friction": ("coulomb_friction", "offset"),
    "dead_zone": ("coulomb_friction", "offset"),
    "extra_mode": ("stray_spring", "viscous_friction"),
}
"""Effect: the pair that it may be taken for."""


def one_law(effects: Sequence[Candidate]) -> int:
    """How many of the known pairs are among some effects."""
    names = {c.effect for c in effects}
    return len({pair for pair in KNOWN.values() if set(pair) <= names})


def lookalikes(chosen: ScoredModel, listed: Sequence[Candidate]) -> list[tuple[Candidate, ...]]:
    """The chosen model with a single effect replaced by the pair that it may be taken for, or a pair by a single one.

    Each of the two is put where the single one is, or, if it has no place there, wherever it can be: an offset that
    does best alone, in a reference, is not the one that does a friction's work. The single one is put where either of
    the two is, or, if it has no place at either, wherever it can be.

    Args:
        chosen: the best model.
        listed: effects at places, the best first.
    """
    rows = []
    for k, effect in enumerate(chosen.effects):
        others = tuple(c for j, c in enumerate(chosen.effects) if j != k)
        options = [_where(name, effect.place, listed) for name in KNOWN.get(effect.effect, ())]
        rows += [row for pair in itertools.product(*options) if pair and (row := all_beside(others, pair)) is not None]
    for pair in itertools.combinations(chosen.effects, 2):
        others = tuple(c for c in chosen.effects if c not in pair)
        for name in (single for single, known in KNOWN.items() if {c.effect for c in pair} == set(known)):
            found = [c for c in listed if c.effect == name]
            there = {c.place: c for c in reversed(found) if c.place in {one.place for one in pair}}
            ways = there or {c.place: c for c in reversed(found)}
            rows += [row for c in ways.values() if (row := all_beside(others, [c])) is not None]
    return rows


def _where(name: str, place: str, listed: Sequence[Candidate]) -> list[Candidate]:
    """An effect at a place, or at all its places if it is none for it."""
    ways: dict[str, Candidate] = {}
    for c in listed:
        if c.effect == name:
            ways.setdefault(c.place, c)
    return [ways[place]] if place in ways else list(ways.values())
