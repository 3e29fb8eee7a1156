"""The current limit of an amplifier that gives a voltage."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.symbolic import by_mode
from engine.block import parameter, signal_in, signal_out
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class CurrentLimiter(SignalBlock):
    """Current limiter: out = the command u, held between km w - R I and km w + R I; I = current_limit.

    It stands between a controller and a `DCMotor`, with the motor's R and km (back_emf_constant) and the speed w of its
    shaft: the current (u - km w) / R of a motor without inductance then stays within +-I. The two kinks are located.
    The input ``enable`` e scales the limit, I e: with 0 the amplifier is off, no current flows, and the motor turns
    freely. A limit that is never reached does nothing.
    """

    current_limit = parameter("A", ..., "greatest current I", gt=0, tolerance=0.3)
    resistance = parameter("ohm", ..., "winding resistance R of the motor", gt=0, tolerance=0.15)
    back_emf_constant = parameter("V.s/rad", ..., "voltage per speed km of the motor", ge=0, tolerance=0.15)

    input = signal_in("V", "voltage that the controller commands u", name="in")
    speed = signal_in("rad/s", "speed of the motor's shaft w")
    enable = signal_in("1", "share of the limit that is allowed e; 0 switches off", default=1.0)
    out = signal_out("V", "voltage at the motor")

    def stamp(self, net: Net) -> None:
        u, room = self.input, self.resistance * self.current_limit * self.enable
        middle = self.back_emf_constant * self.speed
        upper, lower = middle + room, middle - room

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, u - lower, u - upper, upper - u), by_mode(mode, -1, lower - u, -1)

        mode = net.switch("limit", ("below", "inside", "above"), guards)
        self.publish(net, by_mode(mode, lower, u, upper), "V")
