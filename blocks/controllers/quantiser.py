"""A signal in steps, as behind a converter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.symbolic import floor
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Quantiser(SignalBlock):
    """Quantiser: out = q round(in / q), q = step; with ``rounding: floor`` the step below.

    An analogue-to-digital converter of n bits over a range has q = range / 2^n. Sampled (``period`` > 0) it reads at
    its instants and holds. Unsampled it jumps within the integration's steps, as `Encoder` does; give a period where a
    loop is closed through it. The error lies within q / 2, with variance q^2 / 12 where the signal crosses many steps
    [Widrow 2008]. In linear models it counts as a gain of 1. The output has the input's unit.
    """

    step = parameter("*", ..., "height q of a step, with its unit", gt=0)
    rounding = option(str, "round", "to which step", choices=("round", "floor"))
    period = period()
    sample_offset = sample_offset()

    input = signal_in("*", "signal", name="in")
    out = signal_out("*", "the signal in steps")

    def stamp(self, net: Net) -> None:
        value = self.step * floor(self.input / self.step + (0.5 if self.rounding == "round" else 0.0))
        if self.period > 0:
            held = net.memory("reading", "*", clock(net, self), held=True)
            net.update(held, value)
            value = held
        self.publish(net, value)
