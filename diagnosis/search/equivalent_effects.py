"""Pairs of effects that are known to do what a single one does.

While something moves, Coulomb friction with a constant force beside it is friction that differs between the
directions; driven in one direction only, it is a dead zone. A further body on a spring and damper is, at low
frequencies, a spring and a damper to the ground. Where the single effect is the best, the pair is fitted
too, so that the verdict can say whether the recordings tell them apart. And two effects are one and the same law: a
torque that goes once round with the shaft is the weight of something out of balance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from diagnosis.effects.effect import Candidate
from diagnosis.search.partial_fit import ended
from diagnosis.search.scored_model import ScoredModel

KNOWN = {
    "direction_dependent_friction": ("coulomb_friction", "offset"),
    "dead_zone": ("coulomb_friction", "offset"),
    "extra_mode": ("stray_spring", "viscous_friction"),
}
"""Effect: the pair that it may be taken for."""

GRAVITY = 9.81
"""m/s2, as in `blocks.actuators.gravity_torque`."""


def lookalike(chosen: ScoredModel, trials: Sequence[ScoredModel]) -> tuple[Candidate, ...]:
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


def same_laws(chosen: ScoredModel, listed: Sequence[Candidate]) -> list[tuple[Candidate, ...]]:
    """The models in which one effect of the chosen one is another that is the same law, to start where it ended.

    Gravity, -m g r sin(angle - hanging_angle) with r = 1 m, is a ripple A sin(angle + phase) of order one.

    Args:
        chosen: the best model.
        listed: all effects that are tried.
    """
    rows = []
    for k, effect in enumerate(chosen.effects):
        fitted = chosen.fit.parameters()
        values = {key: fitted.get(f"{effect.name}.{key}", size) for key, size in chosen.sizes[k].items()}
        if effect.effect == "gravity":
            phase = math.pi - values["hanging_angle"]
            other, start = "torque_ripple", {"order": 1.0, "amplitude": GRAVITY * values["mass"], "phase": phase}
        elif effect.effect == "torque_ripple" and values["order"] == 1.0:
            hanging = math.pi - values["phase"]
            other, start = "gravity", {"mass": values["amplitude"] / GRAVITY, "hanging_angle": hanging}
        else:
            continue
        found = next((c for c in listed if (c.effect, c.place) == (other, effect.place)), None)
        if found:
            twin = replace(found, starts=(start,))
            rows.append(tuple(twin if j == k else ended(chosen, c) for j, c in enumerate(chosen.effects)))
    return rows
