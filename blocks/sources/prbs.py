"""A pseudo-random binary sequence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.sources.base import Source
from engine.block import option, parameter
from engine.errors import ParameterError
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net

TAPS = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7),
    11: (11, 9), 12: (12, 6, 4, 1), 13: (13, 4, 3, 1), 14: (14, 5, 3, 1), 15: (15, 14), 16: (16, 15, 13, 4),
    17: (17, 14), 18: (18, 11), 19: (19, 6, 2, 1), 20: (20, 17), 21: (21, 19), 22: (22, 21), 23: (23, 18),
    24: (24, 23, 22, 17),
}  # fmt: skip
"""Register length -> stages whose sum modulo 2 is fed back; each gives the longest sequence."""


class PRBS(Source):
    """Pseudo-random binary sequence: out = offset +- amplitude, a new value every bit, repeating after 2^n - 1 bits.

    A shift register of n = order stages; the sum modulo 2 of some of them is fed back, so that every state but zero
    occurs once in a period. The sequence is +1 in 2^(n - 1) bits and -1 in one less; its periodic autocorrelation is 1
    at lag zero and -1 / (2^n - 1) at every other. ``seed`` is the register's first content, 1 to 2^n - 1, and shifts
    the sequence; the first value is the seed's lowest bit. Power is even up to about 0.44 / bit, in hertz. The register
    is a part of the model's memory. The output has the unit of ``amplitude``. [Golomb 1967]
    """

    amount = "amplitude"

    amplitude = parameter("*", 1.0, "half the difference of the two levels, with its unit")
    bit = parameter("s", ..., "duration of a bit", gt=0, structural=True)
    order = option(int, 10, "number of stages n", ge=min(TAPS), le=max(TAPS))
    seed = option(int, 1, "first content of the register", ge=1)

    def check(self) -> None:
        """The seed must fit the register."""
        super().check()
        if self.seed >= 2**self.order:
            raise ParameterError(
                f"seed = {self.seed} does not fit {self.order} stages", remedy=f"give 1 to {2**self.order - 1}"
            )

    def stamp(self, net: Net) -> None:
        ticks, n = net.clock(self.bit), self.order
        # Stage n is the output and is dropped; stage 1 takes the sum of the taps.
        content = [(self.seed >> (n - k)) & 1 for k in range(1, n + 1)]
        stages = [net.memory(f"stage{k + 1}", "1", ticks, start=float(bit)) for k, bit in enumerate(content)]
        fed: Expression = 0.0
        for tap in TAPS[n]:
            fed = fed + stages[tap - 1] - 2 * fed * stages[tap - 1]
        for k, stage in enumerate(stages):
            net.update(stage, stages[k - 1] if k else fed)
        value = net.memory("value", "1", ticks, start=float(content[-1]), held=True)
        net.update(value, stages[-1])
        self.publish(net, self.amplitude * (2 * value - 1))
