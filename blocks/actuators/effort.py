"""A commanded torque or force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, signal_in

if TYPE_CHECKING:
    from engine.net import Net


class Torque(Block):
    """Ideal torque source: torque on the shaft = torque.

    A positive torque accelerates the shaft in the positive sense. Its reaction acts on the ground. The power
    torque * speed enters from outside.
    """

    cut_after = ("shaft",)
    loads = ("shaft",)

    torque = signal_in("N.m", "torque on the shaft")
    shaft = flange("what the torque acts on")

    def stamp(self, net: Net) -> None:
        net.force(self.shaft, self.torque)
        net.supply(self.torque * self.shaft.speed)


class Force(Torque, slide={"shaft": "flange"}):
    """Ideal force source: force on the flange = force.

    A positive force accelerates the flange in the positive sense. Its reaction acts on the ground. The power
    force * speed enters from outside.
    """
