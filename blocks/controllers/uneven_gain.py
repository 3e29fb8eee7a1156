"""A gain that differs between the two directions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class UnevenGain(SignalBlock):
    """Uneven gain: out = forward * in for in > 0, backward * in for in < 0. The kink at zero is located.

    An amplifier whose half-bridges differ, or a sensor more sensitive to one side.
    """

    forward = parameter("1", 1.0, "gain for positive values", gt=0, tolerance=0.2)
    backward = parameter("1", 1.0, "gain for negative values", gt=0, tolerance=0.2)

    input = signal_in("*", "signal", name="in")
    out = signal_out("*", "what comes through")

    def stamp(self, net: Net) -> None:
        u = self.input

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u, u, -u), by_mode(mode, -1, -u, -1)

        side = net.switch("side", ("negative", "zero", "positive"), guards)
        self.publish(net, by_mode(side, self.backward * u, 0, self.forward * u))
