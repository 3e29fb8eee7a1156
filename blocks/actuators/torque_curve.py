"""A measured torque on a shaft."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.symbolic import polyline
from engine.block import Block, flange, option, parameter, signal_out
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class TorqueCurve(Block):
    """Torque by a curve: torque on the shaft = f(x), x its speed (rad/s) or its angle (rad), as ``of`` says.

    f is piecewise linear through ``heights`` at equal distances from lower to upper, and constant beyond: a law that
    was measured and has no formula. A jump, such as dry friction's, needs narrow steps; such a law creeps at
    rest where `BearingFriction` sticks. The power torque * speed counts as coming from outside.
    """

    of = option(str, "speed", "what the torque depends on", choices=("speed", "angle"))
    points = option(int, 9, "how many heights", ge=2, le=200)
    lower = parameter("1", ..., "abscissa of the first height, in rad/s or rad")
    upper = parameter("1", ..., "abscissa of the last height, in rad/s or rad")
    heights = parameter("N.m", 0.0, "torque at each abscissa", size="points")

    shaft = flange("the shaft that feels the torque")
    torque = signal_out("N.m", "torque on the shaft")

    def relations(self) -> Iterable[Relation]:
        """The abscissas must rise."""
        return [Relation("lower", "is not below", "upper")]

    def stamp(self, net: Net) -> None:
        x = self.shaft.speed if self.of == "speed" else self.shaft.angle
        torque = polyline(x, self.lower, self.upper, [self.heights[k] for k in range(self.points)])
        net.force(self.shaft, torque)
        net.supply(torque * self.shaft.speed)
        net.output(self.torque, torque)


class ForceCurve(TorqueCurve, slide={}):
    """Force by a curve: force on the slide = f(x), x its speed (m/s) or its position (m), as ``of`` says.

    f is that of `TorqueCurve`.
    """

    of = option(str, "speed", "what the force depends on", choices=("speed", "position"))
