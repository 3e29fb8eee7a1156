"""A factor on a signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Gain(SignalBlock):
    """Gain: out = gain * in.

    A gain that changes the quantity, such as ``0.5 V.s/rad``, needs ``unit``, the unit of the output.
    """

    gain = parameter("*", ..., "the factor, with its unit if it has one", tolerance=0.2)
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "signal to be multiplied", name="in")
    out = signal_out("*", "the product")

    def stamp(self, net: Net) -> None:
        self.publish(net, self.gain * self.input, self.unit)
