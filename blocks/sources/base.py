"""Base of the sources that switch at given instants."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from engine.block import Block, parameter, signal_out
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import compatible

if TYPE_CHECKING:
    from engine.net import Net

NEVER = 1e9
"""An instant (s) no simulation reaches: the default of times that may be left out, since parameters are finite."""


class Source(Block):
    """A signal made of a value that switches on and off and a constant ``offset``, both in one unit.

    Subclasses name the parameter that gives the unit in ``amount``.
    """

    amount: ClassVar[str] = ""

    offset = parameter("*", 0.0, "value added throughout")

    out = signal_out("*", "the signal")

    def check(self) -> None:
        """Both parts must measure the same thing."""
        units = self.unit_of(self.amount), self.unit_of("offset")
        if not compatible(*units):
            raise ParameterError(f"{self.amount} is in {units[0]} but offset in {units[1]}", remedy="use one unit")

    def publish(self, net: Net, value: Expression) -> None:
        """Give the output its value, in the unit the amount or the offset was given in."""
        units = [unit for unit in (self.unit_of(self.amount), self.unit_of("offset")) if unit != "*"]
        net.output("out", value + self.offset, units[0] if units else "*", type(self).ports["out"].doc)
