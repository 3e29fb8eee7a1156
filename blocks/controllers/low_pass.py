"""A first-order low-pass filter, continuous or sampled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.symbolic import exp
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class LowPass(SignalBlock):
    """First-order low-pass: y' = w (u - y), transfer function w / (s + w), w = corner_frequency.

    Gain 1 at rest, -3 dB and -45 degrees at w, -20 dB per decade above. ``corner_frequency`` is in rad/s; ``10 Hz`` is
    62.83 rad/s.

    Sampled (``period`` T > 0): at each instant y+ = y + (1 - exp(-w T)) (u - y), the exact response to an input that
    holds u over one period; the new value holds until the next instant. The output has the input's unit. With
    ``active: false`` the signal passes unfiltered, to see what the filter does.
    """

    corner_frequency = parameter("rad/s", ..., "angular corner frequency w", gt=0, tolerance=0.2)
    start = parameter("*", 0.0, "output at the beginning")
    period = period()
    sample_offset = sample_offset()
    active = option(bool, True, "false passes the signal unfiltered")

    input = signal_in("*", "signal to be filtered u", name="in")
    out = signal_out("*", "filtered signal y")

    def stamp(self, net: Net) -> None:
        u, w = self.input, self.corner_frequency
        if not self.active:
            y = u
        elif self.period == 0:
            y = net.state("filtered", "*", start=self.start, doc="filtered signal")
            net.derivative(y, w * (u - y))
        else:
            y = net.memory("filtered", "*", clock(net, self), start=self.start, held=True)
            net.update(y, y + (1 - exp(-w * self.period)) * (u - y))
        self.publish(net, y)
