"""A brake that grips when its shaft passes a position."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode
from engine.block import Block, flange, option, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Brake(Block):
    """Brake: torque on the shaft = -T sign(w) from the instant its angle passes reference, T = torque, w = its speed.

    Before, the brake takes no torque. Gripping, it slows the shaft, and where w reaches 0 the shaft sticks: w is
    exactly 0 until more than T pulls at it. The shaft comes to rest J w^2 / (2 T) behind the reference, J its inertia;
    what hangs on it elastically rings on. With ``approach: rising`` the brake grips when the angle rises past the
    reference, or at once where it starts beyond it; with ``falling`` when it falls past it. It does not let go again.
    [Mohan 2010, sec. 4.1.3]
    """

    torque = parameter("N.m", ..., "torque T with which the brake grips", gt=0, tolerance=0.3)
    reference = parameter("rad", 0.0, "angle at which it grips")
    approach = option(str, "rising", "side from which the shaft comes", choices=("rising", "falling"))

    shaft = flange("the shaft that is braked")
    grip = signal_out("1", "1 while the brake grips, 0 before")

    def stamp(self, net: Net) -> None:
        beyond = self.shaft.angle - self.reference
        if self.approach == "falling":
            beyond = -beyond
        mode = net.switch("grip", ("none", "open", "gripping"), lambda mode: (by_mode(mode, -1, beyond, -1), -1))
        grip = mode > 0
        level = self.torque * grip
        net.friction(
            {self.shaft: 1},
            forward=lambda velocity: level,
            backward=lambda velocity: level,
            static_forward=level,
            static_backward=level,
        )
        net.output(self.grip, grip)


class TranslationalBrake(Brake, slide={}):
    """Brake of a slide: force on the slide = -T sign(v) from the instant its position passes reference, T = force.

    It sticks as `Brake` does, m v^2 / (2 T) behind the reference, m its mass. Clamps of a linear axis.
    """
