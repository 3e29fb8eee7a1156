"""A sensor that measures the magnitude of its input."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from blocks.symbolic import by_mode
from engine.block import option, parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class RectifiedSensor(SignalBlock):
    """Rectified sensor: out = sensitivity * |in| + bias.

    A tachometer behind a rectifier, or a recording of magnitudes. The kink at zero is located, so the integration never
    steps across it. A sensitivity that changes the quantity needs ``unit``, the unit of the output.
    """

    sensitivity = parameter("*", 1.0, "output per magnitude of the input, with its unit if it has one", tolerance=0.05)
    bias = parameter("*", 0.0, "output at zero input, in the unit of the output", tolerance=0.5)
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "what is measured", name="in")
    out = signal_out("*", "the reading, without the sign")

    def stamp(self, net: Net) -> None:
        u = self.input

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u, u, -u), by_mode(mode, -1, -u, -1)

        mode = net.switch("sign", ("negative", "zero", "positive"), guards)
        self.publish(net, self.sensitivity * by_mode(mode, -u, 0, u) + self.bias, self.unit)
