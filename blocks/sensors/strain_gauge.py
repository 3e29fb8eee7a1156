"""A strain gauge with its bridge amplifier."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class StrainGauge(Block):
    """Strain gauge: out = sensitivity * curvature + bias.

    The surface strain of a strip of thickness h is curvature * h / 2, so a bridge of S volt per strain has
    sensitivity = S h / 2. Connect ``curvature`` to a link's ``root.curvature``.
    """

    sensitivity = parameter("V.m", ..., "voltage per curvature", tolerance=0.1)
    bias = parameter("V", 0.0, "voltage of the straight strip")

    curvature = signal_in("1/m", "curvature where the gauge sits")
    out = signal_out("V", "voltage")

    def stamp(self, net: Net) -> None:
        net.output(self.out, self.sensitivity * self.curvature + self.bias)
