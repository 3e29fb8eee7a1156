"""Limits on a signal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class Saturation(SignalBlock):
    """Saturation: out = upper above upper, in between the limits, lower below lower; lower < upper.

    The kinks are located, so the integration never steps across one. The output has the input's unit.
    """

    lower = parameter("*", ..., "lower limit, with its unit")
    upper = parameter("*", ..., "upper limit, with its unit")

    input = signal_in("*", "signal to be limited", name="in")
    out = signal_out("*", "the limited signal")

    def relations(self) -> Iterable[Relation]:
        """The limits must leave room."""
        return [Relation("lower", "is not below", "upper")]

    def stamp(self, net: Net) -> None:
        u, lower, upper = self.input, self.lower, self.upper

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u - lower, u - upper, upper - u), by_mode(mode, -1, lower - u, -1)

        mode = net.switch("limit", ("below", "inside", "above"), guards)
        self.publish(net, by_mode(mode, lower, u, upper))
