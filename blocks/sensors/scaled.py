"""A sensor of any signal, with scale and bias."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class ScaledSensor(SignalBlock):
    """Sensor with scale and bias: out = sensitivity * in + bias.

    A sensitivity that changes the quantity, such as ``2 V/rad`` of a potentiometer, needs ``unit``, the unit of the
    output. Connect ``in`` to any signal, or to the motion of a flange such as ``link.hub.angle``.
    """

    sensitivity = parameter("*", 1.0, "output per input, with its unit if it has one", tolerance=0.05)
    bias = parameter("*", 0.0, "output at zero input, in the unit of the output", tolerance=0.5)
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "what is measured", name="in")
    out = signal_out("*", "the reading")

    def stamp(self, net: Net) -> None:
        self.publish(net, self.sensitivity * self.input + self.bias, self.unit)
