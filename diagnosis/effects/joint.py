"""What may be missing in a joint: compliance, play, hardening and hysteresis between a drive and its load."""

from __future__ import annotations

import math
from collections.abc import Iterator

from diagnosis.effects.effect import Candidate, EffectParameter, shares
from diagnosis.effects.insertion import in_joint
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales

TWISTS = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1)
"""Starting sizes of what a joint gives way by, as shares of the range of its angle."""


def at_joint(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """The effects of a joint where the shaft can be cut, with inertia left on both sides."""
    torque, angle = place.torque, place.angle
    springs = []
    for twist in shares(angle, *TWISTS):
        stiffness = torque / twist
        springs.append({"stiffness": stiffness, "damping": 0.1 * math.sqrt(stiffness * place.inertia)})
    stiff = EffectParameter("stiffness", springs[3]["stiffness"], usual=1.0)
    loss = EffectParameter("damping", springs[3]["damping"], usual=1.0)
    yield from in_joint(place, "joint_flexibility", "SpringDamper", springs, stiff, loss)
    plays = [{"half_gap": gap, **s} for gap in shares(angle, *TWISTS[:-1]) for s in springs[1:5:2]]
    gap = EffectParameter("half_gap", angle)
    yield from in_joint(place, "backlash", "Backlash", plays, gap, stiff, loss, law="push_only")
    cubic = [
        {"cubic_stiffness": share * s["stiffness"] ** 3 / torque**2, **s} for s in springs for share in (0.1, 10.0)
    ]
    harder = EffectParameter("cubic_stiffness", stiff.reference**3 / torque**2, usual=1.0)
    soft = [{"cubic_stiffness": s["stiffness"] ** 3 / torque**2, **s} for s in springs[4:6]]
    yield from in_joint(place, "hardening_spring", "HardeningSpring", [*cubic, *soft], stiff, harder, loss)
    loops = [{"yield_twist": 0.3 * torque / s["stiffness"], "residual_share": 0.5, **s} for s in springs[:-1]]
    yields, stays = EffectParameter("yield_twist", angle), EffectParameter("residual_share", 0.5, usual=1.0)
    shape = ("sharpness", "unloading_share")
    yield from in_joint(place, "hysteresis", "BoucWenSpring", loops, stiff, yields, stays, loss, held=shape)
