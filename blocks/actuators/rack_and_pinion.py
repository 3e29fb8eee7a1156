"""A rack with its pinion."""

from __future__ import annotations

from blocks.actuators.rotation_to_translation import _RotationToTranslation
from engine.block import parameter
from engine.ports import Expression


class RackAndPinion(_RotationToTranslation):
    """Rack and pinion: position of the rack = pitch_radius * angle of the pinion, force = torque / pitch_radius.

    A pinion of z teeth and module m has the pitch radius m z / 2; on a helical rack m is the transverse module. It is
    negative where the rack runs the other way. With ``stiffness`` k of the meshing teeth F = k e + d e', e =
    pitch_radius * angle - position, d = damping; without it the teeth are rigid. Play of the teeth is a
    `TranslationalBacklash` behind the rack.

    ``efficiency`` eta is that of `Gear` while rigid. Elastic, it takes F pitch_radius / eta while the pinion drives,
    and ``backdriving_efficiency`` counts while the rack does.
    """

    pitch_radius = parameter("m", ..., "radius of the pitch circle; negative if the rack reverses", nonzero=True)

    def _travel(self) -> Expression:
        return self.pitch_radius
