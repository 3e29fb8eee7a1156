"""Sum or difference of two signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from engine.block import option, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Sum(SignalBlock):
    """Sum: out = a + b, or with other ``signs`` a - b, -a + b, -a - b. All three have one unit."""

    signs = option(str, "++", "sign of a, then sign of b", choices=("++", "+-", "-+", "--"))

    a = signal_in("*", "first signal")
    b = signal_in("*", "second signal", like="a")
    out = signal_out("*", "the sum")

    def stamp(self, net: Net) -> None:
        first, second = (1 if sign == "+" else -1 for sign in self.signs)
        self.publish(net, first * self.a + second * self.b)
