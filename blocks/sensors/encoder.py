"""Incremental encoders, of a shaft and along a scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from engine.block import Block, flange, option, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Encoder(Block):
    """Encoder: count = floor(N angle / (2 pi)), out = 2 pi count / N; N = counts_per_revolution.

    ``rounding: floor`` counts edges passed, ``round`` gives the nearest count, ``none`` an ideal sensor. ``period`` > 0
    reads the angle at sample instants and holds it. N counts every edge: 4096 for 1024 lines read fourfold. Adds no
    inertia. In linear models the rounding counts as a gain of 1; beside recordings the motion is told by the line
    through its steps, and these count as noise.
    """

    counts_per_revolution = parameter("1", ..., "counts per revolution N", gt=0)
    rounding = option(str, "floor", "how the angle becomes a count", choices=("floor", "round", "none"))
    period = parameter("s", 0.0, "sample period; 0 reads continuously", ge=0, structural=True)
    sample_offset = parameter("s", 0.0, "instant of the first sample, when sampled", ge=0, structural=True)

    shaft = flange("the shaft whose angle is read")
    out = signal_out("rad", "angle as the encoder tells it")
    count = signal_out("1", "the counter")

    @property
    def _scale(self) -> Any:
        """Counts per angle."""
        return self.counts_per_revolution / (2 * math.pi)

    def stamp(self, net: Net) -> None:
        scale = self._scale
        count = self.shaft.angle * scale
        if self.rounding != "none":
            count = net.rounded(count + (0.5 if self.rounding == "round" else 0.0))
        if self.period > 0:
            reading = net.memory("reading", "1", net.clock(self.period, self.sample_offset), held=True)
            net.update(reading, count)
            count = reading
        net.output(self.count, count)
        net.output(self.out, count / scale)


class LinearEncoder(Encoder, slide={"counts_per_revolution": None}):
    """Linear encoder on a scale: count = floor(position / resolution), out = count * resolution.

    ``resolution`` is the length of a count: a quarter of the scale's period where its lines are read fourfold, less
    where they are interpolated. Rounding and sampling are those of `Encoder`. Adds no mass.
    """

    resolution = parameter("m", ..., "length of a count", gt=0)

    @property
    def _scale(self) -> Any:
        return 1 / self.resolution
