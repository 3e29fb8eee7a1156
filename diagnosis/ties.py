"""Pairs of effects that are known to do what a single one does.

While something moves, Coulomb friction with a constant force beside it is friction that differs between the
directions; driven in one direction only, it is a dead zone. Where the single effect is the best, the pair is fitted
too, so that the verdict can say whether the recordings tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from diagnosis.candidate import Candidate
    from diagnosis.trial import Trial

KNOWN = {
    "direction_dependent_friction": ("coulomb_friction", "offset"),
    "dead_zone": ("coulomb_friction", "offset"),
}
"""Effect: the pair that it may be taken for."""


def lookalike(chosen: Trial, trials: Sequence[Trial]) -> tuple[Candidate, ...]:
    """The pair that a single effect may be taken for, each at the place where it does best; empty if there is none.

    Args:
        chosen: the best model.
        trials: single effects, best first.
    """
    if len(chosen.effects) != 1:
        return ()
    pair = KNOWN.get(chosen.effects[0].effect, ())
    found = [next((t.effects[0] for t in trials if t.effects[0].effect == effect), None) for effect in pair]
    return tuple(c for c in found if c is not None) if all(c is not None for c in found) else ()
