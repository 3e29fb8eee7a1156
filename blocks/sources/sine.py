"""A sine wave."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.sources.base import Source
from blocks.symbolic import choose, sin
from engine.block import parameter

if TYPE_CHECKING:
    from engine.net import Net


class Sine(Source):
    """Sine wave: out = offset + amplitude sin(2 pi frequency (t - start) + phase) from start on, before it offset.

    The integration meets the start exactly. The output has the unit of ``amplitude``.
    """

    amount = "amplitude"

    amplitude = parameter("*", 1.0, "half the peak-to-peak value, with its unit")
    frequency = parameter("Hz", ..., "cycles per second", gt=0)
    phase = parameter("rad", 0.0, "phase at the start")
    start = parameter("s", 0.0, "instant at which the wave begins")

    def stamp(self, net: Net) -> None:
        begun = net.time_event("begun", lambda n: choose(n + (self.start <= 0) < 1, self.start, float("inf")))
        wave = self.amplitude * sin(2 * math.pi * self.frequency * (net.time - self.start) + self.phase)
        self.publish(net, choose(begun + (self.start <= 0) > 0, wave, 0.0))
