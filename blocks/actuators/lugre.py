"""LuGre friction: bristles that bend before they slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators.presliding import _Bristle, slow_slide, stribeck
from blocks.symbolic import greatest
from engine.block import flange
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class _LuGre(_Bristle):
    def _bend_rate(self, bend: Expression, velocity: Expression) -> Expression:
        slip = self.bristle_stiffness * greatest(velocity, -velocity) / stribeck(self, velocity)
        return velocity - slip * bend


class LuGreFriction(_LuGre):
    """LuGre friction of a shaft: torque -F, F = s0 z + s1 z' + B v, z' = v - s0 |v| z / g(v), v = speed of the shaft.

    g(v) = Fc + (Fs - Fc) exp(-(v / vs)^2); s0 = bristle_stiffness, s1 = bristle_damping, Fc = coulomb_friction,
    Fs = static_friction, vs = stribeck_velocity, B = viscous_friction; z is a state. Steady sliding gives g(v) + B v,
    small motion the spring s0, g / s0 wide.

    Use it for data that show presliding. The law has no stick: an oscillating load below Fs makes the shaft creep.
    `ElastoPlasticFriction` avoids that, and `BearingFriction` sticks exactly. Passive where s1 < 4 s0 g / |v|. The
    bristle relaxes at s0 |v| / g: give an internal_step below 2 g / (s0 |v|) for the greatest speed. [Canudas 1995]
    """

    shaft = flange("the shaft that turns in the bearing")

    def stamp(self, net: Net) -> None:
        self._between(net, self.shaft, None)


class LuGreJointFriction(_LuGre):
    """LuGre friction between two shafts: torque -F on a and F on b, v = speed of a - speed of b.

    F is that of `LuGreFriction`.
    """

    a = flange("first shaft")
    b = flange("second shaft")

    def stamp(self, net: Net) -> None:
        self._between(net, self.a, self.b)


class TranslationalLuGreFriction(LuGreFriction, slide={}):
    """LuGre friction of a slide: force -F, F = s0 z + s1 z' + B v, v = speed of the slide; F as in `LuGreFriction`."""

    stribeck_velocity = slow_slide()


class TranslationalLuGreJointFriction(LuGreJointFriction, slide={}):
    """LuGre friction between two slides: force -F on a and F on b, v = speed of a - speed of b.

    F is that of `LuGreFriction`.
    """

    stribeck_velocity = slow_slide()
