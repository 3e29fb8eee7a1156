"""Random noise that repeats with its seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from blocks.sources.base import Source
from blocks.symbolic import choose, cos, floor, log, sqrt
from engine.block import option, parameter
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net

MULTIPLIERS, MODULI = (40014, 40692), (2147483563, 2147483399)
"""Of the two generators that are combined [LEcuyer 1988]; every product is exact in a double."""


def first(seed: int) -> tuple[float, float]:
    """States of both generators for a seed: neighbouring seeds lie far apart (splitmix64's finaliser)."""
    z = (seed + 0x9E3779B97F4A7C15) & (2**64 - 1)
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & (2**64 - 1)
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & (2**64 - 1)
    z ^= z >> 31
    return float(1 + (z >> 32) % (MODULI[0] - 1)), float(1 + (z & 0xFFFFFFFF) % (MODULI[1] - 1))


class Noise(Source):
    """Noise: out = offset + deviation n, a new independent n at every instant k period, held between.

    n has mean 0 and standard deviation 1, normal or uniform as ``distribution`` says; the numbers depend on ``seed``
    alone, the same in every runtime and FMU. Held over the period T, the noise has the one-sided density
    2 deviation^2 T per hertz up to about 0.4 / T: for a sensor's density S give deviation = sqrt(S / (2 T)). The output
    has the unit of ``deviation``. In linear models it is a constant.
    """

    amount = "deviation"

    deviation = parameter("*", 1.0, "standard deviation, with its unit", ge=0, tolerance=0.5)
    period = parameter("s", ..., "time between new values", gt=0, structural=True)
    distribution = option(str, "normal", "of the values", choices=("normal", "uniform"))
    seed = option(int, 1, "chooses the sequence", ge=0, le=2**31 - 1)

    def stamp(self, net: Net) -> None:
        ticks = net.clock(self.period)
        states = [net.memory(f"generator{k + 1}", "1", ticks, start=s) for k, s in enumerate(first(self.seed))]
        after = states
        draws = []
        for _ in range(2):
            after, share = draw(after)
            draws.append(share)
        for memory, value in zip(states, after, strict=True):
            net.update(memory, value)
        if self.distribution == "normal":
            drawn = sqrt(-2 * log(draws[0])) * cos(2 * math.pi * draws[1])
        else:
            drawn = math.sqrt(12) * (draws[0] - 0.5)
        value = net.memory("value", "1", ticks, held=True)
        net.update(value, drawn)
        self.publish(net, self.deviation * value)


def draw(states: Sequence[Expression]) -> tuple[list[Expression], Expression]:
    """The states of both generators after the next number, and that number, even in 0 ... 1 and never 0."""
    after = [_next(s, a, m) for s, a, m in zip(states, MULTIPLIERS, MODULI, strict=True)]
    difference = after[0] - after[1]
    return after, choose(difference < 1, difference + MODULI[0] - 1, difference) / MODULI[0]


def _next(state: Expression, multiplier: int, modulus: int) -> Expression:
    """The product modulo the modulus, exact: the quotient is never closer to a whole number than 2^-47 of it."""
    product = multiplier * state
    return product - modulus * floor(product / modulus)
