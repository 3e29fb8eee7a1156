"""A screw with its nut: ball screw or sliding thread."""

from __future__ import annotations

import math

from blocks.actuators.rotation_to_translation import _RotationToTranslation
from engine.block import parameter
from engine.ports import Expression


class Screw(_RotationToTranslation):
    """Screw: position of the nut = lead * angle / (2 pi), force = 2 pi torque / lead.

    ``lead`` l is the travel per revolution: the pitch times the number of starts; negative for a left-hand thread. With
    ``stiffness`` k, that of nut, bearings and spindle in series, F = k e + d e', e = l angle / (2 pi) - position, d =
    damping; without it the nut is rigid.

    ``efficiency`` eta is that of `Gear` while rigid. Elastic, the screw takes F l / (2 pi eta) while it drives, and
    while the nut does, F eta_b l / (2 pi) arrives, eta_b = backdriving_efficiency. A ball screw has 0.9 and 0.8. A
    thread of lead angle L and friction angle r has eta = tan L / tan(L + r) and eta_b = tan(L - r) / tan L: with L < r
    eta_b is negative and the screw holds any load, exactly; about eta_b = 2 - 1 / eta. Play of the nut is a
    `TranslationalBacklash` behind it.
    """

    lead = parameter("m", ..., "travel per revolution l; negative for a left-hand thread", nonzero=True)

    def _travel(self) -> Expression:
        return self.lead / (2 * math.pi)
