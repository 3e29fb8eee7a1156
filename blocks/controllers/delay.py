"""Transport delay."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, sample_offset
from engine.block import parameter, signal_in, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net

LONGEST = 20_000
"""Most samples in a delay line."""


class Delay(SignalBlock):
    """Transport delay: out(t) = in(t - delay), sampled: in is read at each instant and given out ``delay`` later.

    A delay line of delay / period values; what is left of the delay beyond whole periods shifts the instants at which
    out changes. out holds in between and is ``start`` until the line is full. There is no delay of a continuous signal
    as such: it would not be a state of finite size. Give a period short against the signal; holding the samples adds
    half a period to the delay on average. A delay of 0 is a sample and hold. The output has the input's unit.
    """

    delay = parameter("s", ..., "time by which the signal is late", ge=0, structural=True)
    period = parameter("s", ..., "sample period", gt=0, structural=True)
    sample_offset = sample_offset()
    start = parameter("*", 0.0, "output until the first sample has passed through")

    input = signal_in("*", "signal to be delayed", name="in")
    out = signal_out("*", "delayed signal")

    def check(self) -> None:
        """The delay line must not be too long."""
        super().check()
        self.count = math.floor(self.delay / self.period + 1e-6)
        self.rest = max(self.delay - self.count * self.period, 0.0)
        if self.rest < 1e-6 * self.period:
            self.rest = 0.0
        if self.count > LONGEST:
            raise ParameterError(
                f"a delay of {self.count} samples is too long", remedy=f"give a period above {self.delay / LONGEST:g} s"
            )

    def stamp(self, net: Net) -> None:
        ticks, late = clock(net, self), self.input
        stages = self.count + (self.rest > 0)
        if stages:
            late = net.line("*", ticks, self.input, [stages], start=self.start)[stages]
        given = ticks
        if self.rest:
            given = net.clock(self.period, math.fmod(self.sample_offset + self.rest, self.period))
        out = net.memory("delayed", "*", given, start=self.start, held=True)
        net.update(out, late)
        self.publish(net, out)
