"""A dead zone of a signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class DeadZone(SignalBlock):
    """Dead zone: out = in - upper above upper, 0 inside, in - lower below lower; lower <= 0 <= upper.

    The output is continuous. The kinks are located, so the integration never steps across one. [Gao X. n.d.,
    eq. 12] with b_r = lower and b_i = upper; its third branch is misprinted as V_m + b_r. The output has the input's
    unit.
    """

    lower = parameter("*", ..., "lower threshold b_r, with its unit", le=0, tolerance=0.3)
    upper = parameter("*", ..., "upper threshold b_i, with its unit", ge=0, tolerance=0.3)

    input = signal_in("*", "signal to pass through", name="in")
    out = signal_out("*", "what comes through")

    def stamp(self, net: Net) -> None:
        u, lower, upper = self.input, self.lower, self.upper

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u - lower, u - upper, upper - u), by_mode(mode, -1, lower - u, -1)

        mode = net.switch("zone", ("below", "inside", "above"), guards)
        self.publish(net, by_mode(mode, u - lower, 0, u - upper))
