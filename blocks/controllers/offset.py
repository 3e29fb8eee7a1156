"""A constant added to a signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from engine.block import parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Offset(SignalBlock):
    """Offset: out = in + offset, in the unit of the input. An amplifier's bias, a sensor's zero."""

    offset = parameter("*", ..., "what is added, with its unit", tolerance=0.5)

    input = signal_in("*", "signal", name="in")
    out = signal_out("*", "the sum")

    def stamp(self, net: Net) -> None:
        self.publish(net, self.input + self.offset)
