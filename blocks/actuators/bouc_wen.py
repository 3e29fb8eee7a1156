"""A torsion spring with hysteresis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import greatest, least
from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class BoucWenSpring(Block):
    """Hysteretic torsion spring: tau = r k e + (1 - r) k z + d e', z' = e' - h.

    e = angle of a - angle of b - rest_angle.

    h = (b |e'| z |z|^(p-1) + (c - b) e' |z|^p) / zy^p: z follows small e, and is held at +-zy while the twist goes on.
    k = stiffness at small twist, r = residual_share of it that stays at large twist, zy = yield_twist, p = sharpness of
    the knee, b = unloading_share, c = loading_share, d = damping. tau acts on b and -tau on a: the spring drives b
    after a. z begins at -rest_angle, the twist of a spring that was wound before its shafts start at zero, or at +-zy
    where that is more.

    Without d the loop does not depend on the rate. With b = 1/2 the spring unloads with its full stiffness; a greater b
    makes the loop wider, and from 1/2 on the law never gives out more than it took in. With c below 1 the yield is
    farther off, zy / c^(1/p), and below 0 there is none: the spring stiffens while it is loaded [Noel 2016]. Energy is
    counted as stored by (r e^2 + (1 - r) z^2) k / 2 whatever c: below 0 what is lost is right for whole cycles only.
    [Bouc 1967; Wen 1976]
    """

    loads = ("a", "b")

    stiffness = parameter("N.m/rad", ..., "torque per twist k at small twist", gt=0, tolerance=0.2)
    residual_share = parameter(
        "1", 0.0, "share r of the stiffness that stays at large twist", ge=0, le=1, tolerance=0.3
    )
    yield_twist = parameter("rad", ..., "twist zy at which the hysteretic part is full", gt=0, tolerance=0.3)
    sharpness = parameter("1", 1.0, "exponent p of the knee", ge=1, tolerance=0.3)
    unloading_share = parameter("1", 0.5, "share b of the yield law that |e'| drives", ge=0.5, le=1, tolerance=0.3)
    loading_share = parameter(
        "1", 1.0, "share c of the yield law that loading shows; below 0 it stiffens", ge=-10, le=1
    )
    damping = parameter("N.m.s/rad", 0.0, "torque per rate of twist d", ge=0, tolerance=0.3)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b at which the spring is slack")

    a = flange("driving shaft")
    b = flange("driven shaft")
    twist = signal_out("rad", "twist of the spring e")
    torque = signal_out("N.m", "torque on b, tau")

    def stamp(self, net: Net) -> None:
        a, b, k, share, load = self.a, self.b, self.stiffness, self.unloading_share, self.loading_share
        twist, rate = a.angle - b.angle - self.rest_angle, a.speed - b.speed
        wound = least(greatest(-self.rest_angle, -self.yield_twist), self.yield_twist)
        z = net.state("hysteresis", self.here("rad"), start=wound, doc="hysteretic part z of the twist")
        size, speed = greatest(z, -z) / self.yield_twist, greatest(rate, -rate)
        knee = greatest(size, 1e-12) ** (self.sharpness - 1)
        lost = knee * (share * speed * z / self.yield_twist + (load - share) * rate * size)
        net.derivative(z, rate - lost)

        elastic, hysteretic = self.residual_share * k * twist, (1 - self.residual_share) * k * z
        torque = elastic + hysteretic + self.damping * rate
        net.pair(a, b, -torque)
        net.store(elastic * twist / 2 + hysteretic * z / 2)
        net.dissipate(hysteretic * lost + self.damping * rate**2)
        net.output(self.twist, twist)
        net.output(self.torque, torque)


class TranslationalBoucWenSpring(BoucWenSpring, slide={}):
    """Hysteretic spring: F = r k e + (1 - r) k z + d e', z' = e' - h, with e, z and h as in `BoucWenSpring`.

    e = position of a - position of b - rest_distance; F acts on b and -F on a. Wire rope isolators, rubber mounts.
    """
