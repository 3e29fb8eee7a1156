"""A torsion spring that stiffens as it is wound."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class HardeningSpring(Block):
    """Cubic torsion spring: tau = k e + k3 e^3 + d e', e = angle of a - angle of b - rest_angle.

    k = stiffness, k3 = cubic_stiffness, d = damping. tau acts on b and -tau on a: the spring drives b after a. A swing
    of amplitude A against a fixed end has about the frequency of a spring k + 3/4 k3 A^2.
    """

    loads = ("a", "b")

    stiffness = parameter("N.m/rad", ..., "torque per twist k at small twist", ge=0, tolerance=0.2)
    cubic_stiffness = parameter("N.m/rad3", ..., "torque per cubed twist k3", ge=0, tolerance=0.5)
    damping = parameter("N.m.s/rad", 0.0, "torque per rate of twist d", ge=0, tolerance=0.3)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b at which the spring is slack")

    a = flange("driving shaft")
    b = flange("driven shaft")
    twist = signal_out("rad", "twist of the spring e")
    torque = signal_out("N.m", "torque on b, tau")

    def stamp(self, net: Net) -> None:
        twist, rate = self.a.angle - self.b.angle - self.rest_angle, self.a.speed - self.b.speed
        torque = self.stiffness * twist + self.cubic_stiffness * twist**3 + self.damping * rate
        net.pair(self.a, self.b, -torque)
        net.store(self.stiffness * twist**2 / 2 + self.cubic_stiffness * twist**4 / 4)
        net.dissipate(self.damping * rate**2)
        net.output(self.twist, twist)
        net.output(self.torque, torque)


class TranslationalHardeningSpring(HardeningSpring, slide={}):
    """Cubic spring: F = k e + k3 e^3 + d e', e = position of a - position of b - rest_distance.

    k = stiffness, k3 = cubic_stiffness, d = damping. F acts on b and -F on a: the spring drives b after a.
    """
