"""Product or quotient of two signals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from engine.block import option, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Product(SignalBlock):
    """Product: out = a b, or with ``operation: divide`` out = a / b, in SI units.

    Two signals of different units make a third: ``unit`` says which, such as ``W`` for a torque and a speed. A divisor
    that passes through zero makes the run diverge.
    """

    operation = option(str, "multiply", "what is done with a and b", choices=("multiply", "divide"))
    unit = option(str, "*", "coherent SI unit of the output; * takes that of a")

    a = signal_in("*", "first signal")
    b = signal_in("*", "second signal")
    out = signal_out("*", "product or quotient")

    def stamp(self, net: Net) -> None:
        self.publish(net, self.a * self.b if self.operation == "multiply" else self.a / self.b, self.unit)
