"""A tachometer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Tachometer(Block):
    """Tachometer: out = sensitivity * speed + bias. 1.5 mV/rpm is 0.01432 V.s/rad. Adds no inertia."""

    sensitivity = parameter("V.s/rad", ..., "voltage per speed", tolerance=0.05)
    bias = parameter("V", 0.0, "voltage at rest")

    shaft = flange("the shaft whose speed is read")
    out = signal_out("V", "voltage")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.sensitivity * self.shaft.speed + self.bias)


class TranslationalTachometer(Tachometer, slide={}):
    """Speed sensor of a slide: out = sensitivity * speed + bias. Adds no mass."""
