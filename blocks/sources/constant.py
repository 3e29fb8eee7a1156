"""A constant signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Constant(Block):
    """Constant signal: out = value.

    The output has the unit the value is given in (``12 V``); a bare number fits any input.
    """

    value = parameter("*", ..., "value of the signal, with its unit")

    out = signal_out("*", "the constant value")

    def stamp(self, net: Net) -> None:
        net.output("out", self.value, self.unit_of("value"), type(self).ports["out"].doc)
