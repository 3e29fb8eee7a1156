"""An accelerometer, on a turning body or on a slide."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out
from engine.ports import TRANSLATIONAL

if TYPE_CHECKING:
    from engine.net import Net


class Accelerometer(Block):
    """Accelerometer on a turning body: out = radius * angular acceleration + bias, along its circle.

    Adds no inertia.
    """

    radius = parameter("m", ..., "distance from the axis", ge=0)
    bias = parameter("m/s2", 0.0, "reading at rest")

    shaft = flange("the body it sits on")
    out = signal_out("m/s2", "tangential acceleration")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.radius * self.shaft.acceleration + self.bias)


class TranslationalAccelerometer(Block):
    """Accelerometer on a slide: out = acceleration + bias. Adds no mass."""

    bias = parameter("m/s2", 0.0, "reading at rest")

    flange = flange("the slide it sits on", kind=TRANSLATIONAL)
    out = signal_out("m/s2", "acceleration")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.flange.acceleration + self.bias)
