"""A limit on how fast a signal changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, period, sample_offset
from blocks.symbolic import by_mode, greatest, least
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


MOMENT = 1e-9
"""s, in which what is passed of a held input is no distance to it."""


class RateLimiter(SignalBlock):
    """Rate limiter: y' = (u - y) / Td, held between -falling and rising; out = y. Td = time_constant.

    ``rising`` and ``falling`` are positive, in units of the signal per second; falling is as rising if not given. While
    the limits do not act, y follows u with the lag Td, that of the amplifier or drive: a law whose output follows at
    once would have to differentiate u. The kinks are located. ``start`` is y at the beginning.

    With a ``held_input``, one that jumps and is constant in between, such as a recorded or sampled command, there is no
    lag: y' = rising where y < u, -falling where y > u, and out = u where y has reached it. Td has no meaning then; a
    linear model has a gain of one, and a pole at zero that is neither moved nor seen.

    Sampled (``period`` T > 0): at each instant y+ = y + (u - y), the change held between -falling T and rising T, and
    there is no lag; out holds until the next instant. The output has the input's unit.
    """

    rising = parameter("*", ..., "greatest rate upward, in units of the signal per second", gt=0, tolerance=0.3)
    falling = parameter("*", SameAs("rising"), "greatest rate downward, a positive number", gt=0, tolerance=0.3)
    time_constant = parameter("s", 1e-3, "lag Td while the limits do not act", gt=0, tolerance=0.5)
    start = parameter("*", 0.0, "output at the beginning")
    held_input = option(bool, False, "whether u jumps and is constant in between: then y has no lag")
    period = period()
    sample_offset = sample_offset()

    input = signal_in("*", "signal u that may change fast", name="in")
    out = signal_out("*", "the signal y that does not")

    def check(self) -> None:
        """The rates must be of one kind."""
        super().check()
        units = {self.unit_of("rising"), self.unit_of("falling")} - {"*"}
        if len(units) > 1 and "falling" in self.given:
            raise ParameterError(f"rising and falling are in {' and '.join(sorted(units))}", remedy="use one unit")

    def stamp(self, net: Net) -> None:
        u, up, down = self.input, self.rising, self.falling
        if self.period > 0:
            y = net.memory("limited", "*", clock(net, self), start=self.start, held=True)
            net.update(y, y + least(greatest(u - y, -down * self.period), up * self.period))
        else:
            y = net.state("limited", "*", start=self.start, doc="the limited signal")
            y = self._reaching(net, y) if self.held_input else self._lagging(net, y)
        self.publish(net, y)

    def _lagging(self, net: Net, y: Expression) -> Expression:
        """The output that follows with a lag; its rate is held between the limits."""
        up, down, rate = self.rising, self.falling, (self.input - y) / self.time_constant

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, rate + down, rate - up, up - rate), by_mode(mode, -1, -down - rate, -1)

        mode = net.switch("limit", ("falling", "following", "rising"), guards)
        net.derivative(y, by_mode(mode, -down, rate, up))
        return y

    def _reaching(self, net: Net, y: Expression) -> Expression:
        """The output that moves at its limits until it has reached a held input, but for what is passed in a moment."""
        u, up, down = self.input, self.rising, self.falling

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u - y, u - y - up * MOMENT, y - u), by_mode(mode, -1, y - u - down * MOMENT, -1)

        mode = net.switch("limit", ("falling", "following", "rising"), guards)
        net.derivative(y, by_mode(mode, -down, 0, up))
        return by_mode(mode, y, u, y)
