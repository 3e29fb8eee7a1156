"""A sensor with a first-order lag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class SensorLag(SignalBlock):
    """Sensor with lag: T y' = sensitivity * in - y, out = y + bias, T = time_constant.

    For a thermal or fluid sensor, or an amplifier with a first-order filter of corner 1 / T. It starts at y = start.
    A sensitivity that changes the quantity needs ``unit``, the unit of the output.
    """

    time_constant = parameter("s", ..., "time constant T", gt=0, tolerance=0.3)
    sensitivity = parameter("*", 1.0, "output per input at rest, with its unit if it has one", tolerance=0.05)
    bias = parameter("*", 0.0, "output at zero input, in the unit of the output", tolerance=0.5)
    start = parameter("*", 0.0, "output without bias at the beginning")
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "what is measured", name="in")
    out = signal_out("*", "the reading")

    def stamp(self, net: Net) -> None:
        y = net.state("reading", "*", start=self.start, doc="reading without bias")
        net.derivative(y, (self.sensitivity * self.input - y) / self.time_constant)
        self.publish(net, y + self.bias, self.unit)
