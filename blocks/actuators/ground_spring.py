"""A stray spring to the ground, from a shaft or from a slide."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from engine.block import Block, flange, parameter, signal_out
from engine.ports import TRANSLATIONAL, Expression

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class _GroundSpring(Block):
    """The law; subclasses declare parameters in their units, and the flange."""

    stiffness: Any
    damping: Any

    def _hold(self, net: Net, motion: Motion, rest: Expression) -> Expression:
        """Stamp the spring on a motion; returns the effort on it."""
        stretch, speed = motion.angle - rest, motion.speed
        effort = -self.stiffness * stretch - self.damping * speed
        net.force(motion, effort)
        net.store(self.stiffness * stretch**2 / 2)
        net.dissipate(self.damping * speed**2)
        return effort


class GroundSpring(_GroundSpring):
    """Spring to the ground: torque on the shaft = -k (angle - rest_angle) - d w, k = stiffness, d = damping, w = speed.

    It stands for a cable or a hose at a joint. It lifts the pole at zero of a free shaft to sqrt(k / J).
    """

    slide_twin = "TranslationalGroundSpring"
    slide_names = (("rest_angle", "rest_position"),)

    stiffness = parameter("N.m/rad", ..., "torque per angle k", ge=0, tolerance=0.5)
    damping = parameter("N.m.s/rad", 0.0, "torque per speed d", ge=0, tolerance=0.5)
    rest_angle = parameter("rad", 0.0, "angle at which the spring is slack")

    shaft = flange("the shaft that is held back")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        net.output(self.torque, self._hold(net, self.shaft, self.rest_angle))


class TranslationalGroundSpring(_GroundSpring):
    """Spring to the ground: force on the slide = -k (position - rest_position) - d v, k = stiffness, d = damping.

    It stands for an energy chain at a carriage. It lifts the pole at zero of a free slide to sqrt(k / m).
    """

    stiffness = parameter("N/m", ..., "force per distance k", ge=0, tolerance=0.5)
    damping = parameter("N.s/m", 0.0, "force per speed d", ge=0, tolerance=0.5)
    rest_position = parameter("m", 0.0, "position at which the spring is slack")

    slide = flange("the slide that is held back", kind=TRANSLATIONAL)
    force = signal_out("N", "force on the slide")

    def stamp(self, net: Net) -> None:
        net.output(self.force, self._hold(net, self.slide, self.rest_position))
