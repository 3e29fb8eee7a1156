"""Sample and hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, sample_offset
from engine.block import parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class SampleHold(SignalBlock):
    """Sample and hold: out(t) = in(k period + sample_offset), k the last instant passed.

    A zero-order hold: it adds half a period of delay on average. Before the first instant out is ``start``. The output
    has the input's unit.
    """

    period = parameter("s", ..., "sample period", gt=0, structural=True)
    sample_offset = sample_offset()
    start = parameter("*", 0.0, "output before the first instant")

    input = signal_in("*", "signal to be sampled", name="in")
    out = signal_out("*", "the last sample")

    def stamp(self, net: Net) -> None:
        held = net.memory("sample", "*", clock(net, self), start=self.start, held=True)
        net.update(held, self.input)
        self.publish(net, held)
