"""A relay: two values, with hysteresis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import OUTPUT_UNIT, SignalBlock
from blocks.symbolic import choose
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import compatible

if TYPE_CHECKING:
    from engine.net import Net


class Relay(SignalBlock):
    """Relay: out = upper_value from in > switch_on until in < switch_off, else lower_value; switch_off <= switch_on.

    The instants of switching are located. It begins on where in > switch_on at the start, else off. In a loop whose
    plant answers at once, a relay without hysteresis chatters, and the run says so; with hysteresis 2 h = switch_on -
    switch_off it swings. In linear models it is a constant, that of the mode named.
    """

    switch_on = parameter("*", 0.0, "input above which it goes on, with its unit")
    switch_off = parameter("*", 0.0, "input below which it goes off, with its unit")
    upper_value = parameter("*", 1.0, "output while on, with its unit")
    lower_value = parameter("*", 0.0, "output while off, with its unit")
    unit = option(str, "*", OUTPUT_UNIT)

    input = signal_in("*", "signal that decides", name="in")
    out = signal_out("*", "one of the two values")

    def check(self) -> None:
        """Levels in their order, and values in one unit."""
        super().check()
        if self.switch_off > self.switch_on:
            raise ParameterError(f"switch_off = {self.switch_off:g} is above switch_on = {self.switch_on:g}")
        for pair in (("switch_on", "switch_off"), ("upper_value", "lower_value")):
            units = [self.unit_of(name) for name in pair]
            if not compatible(*units):
                raise ParameterError(f"{pair[0]} is in {units[0]} but {pair[1]} in {units[1]}", remedy="use one unit")

    def stamp(self, net: Net) -> None:
        u = self.input

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return choose(mode > 0, self.switch_off - u, u - self.switch_on), -1

        mode = net.switch("contact", ("none", "off", "on"), guards)
        given = [self.unit_of(name) for name in ("upper_value", "lower_value") if self.unit_of(name) != "*"]
        unit = self.unit if self.unit != "*" or not given else given[0]
        self.publish(net, choose(mode > 0, self.upper_value, self.lower_value), unit)
