"""A stray spring to the ground, from a shaft or from a slide."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class GroundSpring(Block):
    """Spring to the ground: torque on the shaft = -k (angle - rest_angle) - d w, k = stiffness, d = damping, w = speed.

    It stands for a cable or a hose at a joint. It lifts the pole at zero of a free shaft to sqrt(k / J).
    """

    stiffness = parameter("N.m/rad", ..., "torque per angle k", ge=0, tolerance=0.5)
    damping = parameter("N.m.s/rad", 0.0, "torque per speed d", ge=0, tolerance=0.5)
    rest_angle = parameter("rad", 0.0, "angle at which the spring is slack")

    shaft = flange("the shaft that is held back")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        stretch, speed = self.shaft.angle - self.rest_angle, self.shaft.speed
        torque = -self.stiffness * stretch - self.damping * speed
        net.force(self.shaft, torque)
        net.store(self.stiffness * stretch**2 / 2)
        net.dissipate(self.damping * speed**2)
        net.output(self.torque, torque)


class TranslationalGroundSpring(GroundSpring, slide={"rest_angle": "rest_position"}):
    """Spring to the ground: force on the slide = -k (position - rest_position) - d v, k = stiffness, d = damping.

    It stands for an energy chain at a carriage. It lifts the pole at zero of a free slide to sqrt(k / m).
    """
