"""A linear spring with a damper beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from engine.block import Block, flange, parameter, signal_out
from engine.ports import TRANSLATIONAL, Expression

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class _SpringDamper(Block):
    """The law; subclasses declare parameters in their units, flanges and outputs."""

    stiffness: Any
    damping: Any

    def _between(self, net: Net, a: Motion, b: Motion, rest: Expression) -> tuple[Expression, Expression]:
        """Stamp spring and damper between ``a`` and ``b``; returns (stretch, effort on b)."""
        stretch = a.angle - b.angle - rest
        rate = a.speed - b.speed
        effort = self.stiffness * stretch + self.damping * rate
        net.pair(a, b, -effort)
        net.store(self.stiffness * stretch**2 / 2)
        net.dissipate(self.damping * rate**2)
        return stretch, effort


class SpringDamper(_SpringDamper):
    """Torsion spring and damper: tau = k e + d e', e = angle of a - angle of b - rest_angle.

    k = stiffness, d = damping. tau acts on b and -tau on a: the spring drives b after a. Linear for any twist.
    """

    spring_parameters = ("stiffness", "damping", "rest_angle")
    slide_twin = "TranslationalSpringDamper"
    slide_names = (("rest_angle", "rest_distance"),)

    stiffness = parameter("N.m/rad", ..., "torque per twist k", gt=0, tolerance=0.2)
    damping = parameter("N.m.s/rad", 0.0, "torque per rate of twist d", ge=0, tolerance=0.3)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b at which the spring is slack")

    a = flange("driving shaft")
    b = flange("driven shaft")
    twist = signal_out("rad", "twist of the spring e")
    torque = signal_out("N.m", "torque on b, tau")

    def stamp(self, net: Net) -> None:
        twist, torque = self._between(net, self.a, self.b, self.rest_angle)
        net.output(self.twist, twist)
        net.output(self.torque, torque)


class TranslationalSpringDamper(_SpringDamper):
    """Spring and damper: F = k e + d e', e = position of a - position of b - rest_distance.

    k = stiffness, d = damping. F acts on b and -F on a: the spring drives b after a. Linear for any compression.
    """

    spring_parameters = ("stiffness", "damping", "rest_distance")

    stiffness = parameter("N/m", ..., "force per compression k", gt=0, tolerance=0.2)
    damping = parameter("N.s/m", 0.0, "force per rate of compression d", ge=0, tolerance=0.3)
    rest_distance = parameter("m", 0.0, "position of a - position of b at which the spring is slack")

    a = flange("driving end", kind=TRANSLATIONAL)
    b = flange("driven end", kind=TRANSLATIONAL)
    compression = signal_out("m", "compression of the spring e")
    force = signal_out("N", "force on b, F")

    def stamp(self, net: Net) -> None:
        compression, force = self._between(net, self.a, self.b, self.rest_distance)
        net.output(self.compression, compression)
        net.output(self.force, force)
