"""A sine whose frequency sweeps from one value to another."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.sources.base import Source
from blocks.symbolic import choose, expm1, log, magnitude, sin
from engine.block import option, parameter

if TYPE_CHECKING:
    from engine.net import Net


class Chirp(Source):
    """Chirp: out = offset + amplitude sin(2 pi n(t) + phase) from start to start + duration, else offset.

    n counts cycles; n' = f, the frequency, goes from start_frequency f0 to end_frequency f1 in the duration T.
    With x = (t - start) / T:

        linear:      f = f0 + (f1 - f0) x,      n = T x (f0 + (f1 - f0) x / 2)
        logarithmic: f = f0 (f1 / f0)^x,        n = T f0 ((f1 / f0)^x - 1) / ln(f1 / f0)

    A logarithmic sweep spends equal times on equal ratios of frequency. The integration meets both ends exactly. The
    output has the unit of ``amplitude``.
    """

    amount = "amplitude"

    amplitude = parameter("*", 1.0, "half the peak-to-peak value, with its unit")
    start_frequency = parameter("Hz", ..., "cycles per second at the start f0", gt=0)
    end_frequency = parameter("Hz", ..., "cycles per second at the end f1", gt=0)
    duration = parameter("s", ..., "duration of the sweep T", gt=0)
    phase = parameter("rad", 0.0, "phase at the start")
    start = parameter("s", 0.0, "instant at which the sweep begins", ge=0)
    law = option(str, "linear", "how the frequency goes", choices=("linear", "logarithmic"))

    def stamp(self, net: Net) -> None:
        f0, f1, duration = self.start_frequency, self.end_frequency, self.duration
        end = self.start + duration
        phase = net.time_event("phase", lambda k: choose(k < 1, self.start, choose(k < 2, end, float("inf"))))
        x = (net.time - self.start) / duration
        if self.law == "linear":
            cycles = duration * x * (f0 + (f1 - f0) * x / 2)
        else:
            ratio = log(f1 / f0)
            flat = magnitude(ratio) < 1e-9
            cycles = duration * f0 * choose(flat, x, expm1(ratio * x) / choose(flat, 1.0, ratio))
        wave = self.amplitude * sin(2 * math.pi * cycles + self.phase)
        self.publish(net, choose(phase == 1, wave, 0.0))
