"""A notch filter, continuous or sampled."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.controllers.second_order import held_response
from engine.block import parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Notch(SignalBlock):
    """Notch filter: out = (s^2 + 2 z w s + w^2) / (s^2 + 2 d w s + w^2) in, w = frequency.

    z = depth_ratio damps the zeros, d = damping_ratio the poles: gain 1 at rest and far above w, z / d at w. For z = 0,
    which removes w altogether, the band in which the gain is below -3 dB is 2 d w wide. ``frequency`` is in rad/s;
    ``10 Hz`` is 62.83 rad/s. State: x1'' + 2 d w x1' + w^2 x1 = in, out = in + 2 (z - d) w x1'.

    Sampled (``period`` > 0): out is taken at each instant and held; x1 and x1' go on by the exact response to an input
    held over one period. The output has the input's unit. With w = 68 rad/s: [Gao J. n.d., sec. 3.5.2].
    """

    frequency = parameter("rad/s", ..., "angular frequency w that is stopped", gt=0, tolerance=0.2)
    damping_ratio = parameter("1", 0.7, "damping ratio d of the poles, which makes the band wide", gt=0)
    depth_ratio = parameter("1", 0.0, "damping ratio z of the zeros", ge=0)
    period = period()
    sample_offset = sample_offset()

    input = signal_in("*", "signal to be filtered", name="in")
    out = signal_out("*", "filtered signal")

    def stamp(self, net: Net) -> None:
        u, w, d = self.input, self.frequency, self.damping_ratio
        shape = 2 * (self.depth_ratio - d) * w
        if self.period == 0:
            x1 = net.state("position", "*", doc="state x1 of the filter")
            x2 = net.state("rate", "*", doc="state x1' of the filter")
            net.derivative(x1, x2)
            net.derivative(x2, u - 2 * d * w * x2 - w**2 * x1)
            self.publish(net, u + shape * x2)
            return
        ticks = clock(net, self)
        x1, x2 = net.memory("position", "*", ticks), net.memory("rate", "*", ticks)
        y = net.memory("filtered", "*", ticks, held=True)
        (a11, a12), (a21, a22), (b1, b2) = held_response(w, d, self.period)
        net.update(x1, a11 * x1 + a12 * x2 + b1 * u)
        net.update(x2, a21 * x1 + a22 * x2 + b2 * u)
        net.update(y, u + shape * x2)
        self.publish(net, y)
