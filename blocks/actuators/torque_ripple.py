"""Torque that depends on the angle of a shaft."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from blocks.symbolic import sin
from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class TorqueRipple(Block):
    """Torque ripple: torque on the shaft = A sin(n angle + phase), A = amplitude, n = order.

    n counts the waves of one revolution: the least common multiple of poles and slots for the cogging of a motor, 2 for
    the wave generator of a harmonic drive. A torque of the angle alone is conservative: over a whole wave it does no
    work, and its potential counts as stored. Several orders are several blocks on one shaft.
    """

    amplitude = parameter("N.m", ..., "greatest torque A", ge=0, tolerance=0.5)
    order = parameter("1", ..., "waves per revolution n", gt=0)
    phase = parameter("rad", 0.0, "phase at angle zero")

    shaft = flange("the shaft that feels the ripple")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        wave = self.order * self.shaft.angle + self.phase
        net.potential([self.shaft], -2 * self.amplitude / self.order * sin(wave / 2) ** 2)
        net.output(self.torque, self.amplitude * sin(wave))


class ForceRipple(TorqueRipple, slide={"order": None}, keeps=("phase",)):
    """Force ripple: force on the slide = A sin(2 pi position / pitch + phase), A = amplitude.

    Cogging of a linear motor: ``pitch`` is the length of a wave, for the first order that of a pole. A force of the
    position alone is conservative; its potential counts as stored.
    """

    pitch = parameter("m", ..., "length of a wave", gt=0)

    @property
    def order(self) -> Any:
        """Waves per metre, in radians."""
        return 2 * math.pi / self.pitch
