"""A gain that another signal chooses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from blocks.controllers.lookup import check_rising, with_points
from blocks.symbolic import hats
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class GainSchedule(SignalBlock):
    """Scheduled gain: out = k(schedule) in, k straight lines through ``gains`` at ``breakpoints``.

    Beyond the ends the end's gain holds. A gain that follows a load, an arm's reach or a speed. Gains that change the
    quantity need ``unit``, the unit of the output. In linear models the derivative of k counts too, times the input at
    the operating point: nothing where that is 0.
    """

    points = option(int, 2, "how many breakpoints; as many as are given", ge=2, le=1000)
    breakpoints = parameter("*", ..., "values of the schedule, rising, with their unit", size="points")
    gains = parameter("*", ..., "gain at each breakpoint, with its unit if it has one", size="points", tolerance=0.2)
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "signal to be multiplied", name="in")
    schedule = signal_in("*", "signal that chooses the gain")
    out = signal_out("*", "the product")

    def __init__(self, **values: Any) -> None:
        super().__init__(**with_points(values))

    def check(self) -> None:
        """Breakpoints must rise."""
        super().check()
        check_rising("breakpoints", self.values["breakpoints"])

    def stamp(self, net: Net) -> None:
        weights = hats(self.schedule, [self.breakpoints[k] for k in range(self.points)])
        gain = sum((w * self.gains[k] for k, w in enumerate(weights)), 0.0)
        self.publish(net, gain * self.input, self.unit)
