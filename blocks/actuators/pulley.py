"""A pulley with its belt or rope."""

from __future__ import annotations

from blocks.actuators.rotation_to_translation import _RotationToTranslation
from engine.block import parameter
from engine.ports import Expression


class Pulley(_RotationToTranslation):
    """Pulley: position = radius * angle, force at the slide = torque / radius; toothed belt, rope or drum without slip.

    A positive angle moves the slide in the positive sense; with a negative radius in the other, as the lower strand of
    a belt does. A toothed pulley of z teeth and pitch p has the radius z p / (2 pi). With ``stiffness`` k, as of the
    belt's strands, F = k e + d e' at the slide, e = radius * angle - position, d = damping; else the belt is rigid.

    ``efficiency`` eta is that of `Gear` while rigid. Elastic, it takes F radius / eta while the pulley drives, and
    ``backdriving_efficiency`` counts while the slide does. With a mass m at the slide, an inertia J at the shaft counts
    as J + m radius^2.
    """

    radius = parameter("m", ..., "radius at which the belt runs; negative if it reverses", nonzero=True)

    def _travel(self) -> Expression:
        return self.radius
