"""A linear spring with a damper beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class SpringDamper(Block):
    """Torsion spring and damper: tau = k e + d e', e = angle of a - angle of b - rest_angle.

    k = stiffness, d = damping. tau acts on b and -tau on a: the spring drives b after a. Linear for any twist.
    """

    spring_parameters = ("stiffness", "damping", "rest_angle")
    loads = ("a", "b")

    stiffness = parameter("N.m/rad", ..., "torque per twist k", gt=0, tolerance=0.2)
    damping = parameter("N.m.s/rad", 0.0, "torque per rate of twist d", ge=0, tolerance=0.3)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b at which the spring is slack")

    a = flange("driving shaft")
    b = flange("driven shaft")
    twist = signal_out("rad", "twist of the spring e")
    torque = signal_out("N.m", "torque on b, tau")

    def stamp(self, net: Net) -> None:
        twist, rate = self.a.angle - self.b.angle - self.rest_angle, self.a.speed - self.b.speed
        torque = self.stiffness * twist + self.damping * rate
        net.pair(self.a, self.b, -torque)
        net.store(self.stiffness * twist**2 / 2)
        net.dissipate(self.damping * rate**2)
        net.output(self.twist, twist)
        net.output(self.torque, torque)


class TranslationalSpringDamper(SpringDamper, slide={}):
    """Spring and damper: F = k e + d e', e = position of a - position of b - rest_distance.

    k = stiffness, d = damping. F acts on b and -F on a: the spring drives b after a. Linear for any compression.
    """
