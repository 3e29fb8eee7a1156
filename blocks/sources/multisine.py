"""A sum of sines at the multiples of one frequency."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

from blocks.sources.base import Source
from blocks.symbolic import cos
from engine.block import option, parameter

if TYPE_CHECKING:
    from engine.net import Net


class Multisine(Source):
    """Multisine: out = offset + sum A_k cos(2 pi n_k f t + phi_k), k = 1 ... K, n_k = first + spacing (k - 1).

    K = lines, f = base_frequency; the signal repeats after 1 / f. A_k = amplitude, one for all lines or one for each.
    Phases ``schroeder``, phi_k = -pi k (k - 1) / K, keep the peaks of equal lines low; ``random`` draws them from the
    seed; ``zero`` lines all peaks up. A spacing of 2 with an odd first line leaves the even lines free, on which only
    nonlinearity answers. The output has the unit of ``amplitude``. [Schroeder 1970]
    """

    amount = "amplitude"

    lines = option(int, 10, "number of lines K", ge=1, le=1000)
    first = option(int, 1, "multiple of the first line", ge=1, le=1_000_000)
    spacing = option(int, 1, "multiples from one line to the next", ge=1, le=1_000_000)
    phases = option(str, "schroeder", "how the phases are chosen", choices=("schroeder", "random", "zero"))
    seed = option(int, 1, "which random phases", ge=0)
    base_frequency = parameter("Hz", ..., "frequency f of which all lines are multiples", gt=0)
    amplitude = parameter("*", 1.0, "amplitude of a line A_k, with its unit", size="lines")

    def multiples(self) -> list[int]:
        """The multiples n_k."""
        return [self.first + self.spacing * k for k in range(self.lines)]

    def angles(self) -> list[float]:
        """The phases phi_k (rad)."""
        if self.phases == "random":
            draw = random.Random(self.seed)
            return [draw.uniform(-math.pi, math.pi) for _ in range(self.lines)]
        bend = math.pi / self.lines if self.phases == "schroeder" else 0.0
        return [-bend * k * (k - 1) for k in range(1, self.lines + 1)]

    def stamp(self, net: Net) -> None:
        angle = 2 * math.pi * self.base_frequency * net.time
        lines = zip(self.multiples(), self.angles(), strict=True)
        self.publish(net, sum(self.amplitude[k] * cos(n * angle + phi) for k, (n, phi) in enumerate(lines)))
