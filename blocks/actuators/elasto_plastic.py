"""Elasto-plastic friction: bristles that are purely elastic until they begin to slip."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.actuators.presliding import _Bristle, slow_slide, stribeck
from blocks.symbolic import choose, greatest, sin
from engine.block import flange, parameter
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class _ElastoPlastic(_Bristle):
    elastic_share = parameter(
        "1", 0.7, "share of Fc that the bristle carries without slipping", gt=0, lt=1, tolerance=0.3
    )

    def _bend_rate(self, bend: Expression, velocity: Expression) -> Expression:
        full = stribeck(self, velocity) / self.bristle_stiffness
        begin = self.elastic_share * self.coulomb_friction / self.bristle_stiffness
        size = greatest(bend, -bend)
        rise = (1 + sin(math.pi * (size - (full + begin) / 2) / (full - begin))) / 2
        slipping = choose(size <= begin, 0, choose(size >= full, 1, rise))
        return velocity * (1 - choose(bend * velocity > 0, slipping * size / full, 0))


class ElastoPlasticFriction(_ElastoPlastic):
    """Elasto-plastic friction of a shaft: torque -F, F = s0 z + s1 z' + B v, z' = v (1 - alpha |z| / zs), v its speed.

    zs = g(v) / s0, g(v) = Fc + (Fs - Fc) exp(-(v / vs)^2). alpha = 0 while |z| <= zb = elastic_share Fc / s0, and
    whenever the bristle straightens (z v <= 0); alpha = 1 for |z| >= zs; between them half a sine wave. Names are those
    of `LuGreFriction`, and so are the internal step to give and the steady sliding friction.

    Below zb the bristle is a spring: a load that swings below elastic_share Fc leaves no creep, unlike with LuGre.
    [Dupont 2002]
    """

    shaft = flange("the shaft that turns in the bearing")

    def stamp(self, net: Net) -> None:
        self._between(net, self.shaft, None)


class ElastoPlasticJointFriction(_ElastoPlastic):
    """Elasto-plastic friction between two shafts: torque -F on a and F on b, v = speed of a - speed of b.

    F is that of `ElastoPlasticFriction`.
    """

    a = flange("first shaft")
    b = flange("second shaft")

    def stamp(self, net: Net) -> None:
        self._between(net, self.a, self.b)


class TranslationalElastoPlasticFriction(ElastoPlasticFriction, slide={}):
    """Elasto-plastic friction of a slide: force -F, v = speed of the slide; F as in `ElastoPlasticFriction`."""

    stribeck_velocity = slow_slide()


class TranslationalElastoPlasticJointFriction(ElastoPlasticJointFriction, slide={}):
    """Elasto-plastic friction between two slides: force -F on a and F on b, v = speed of a - speed of b.

    F is that of `ElastoPlasticFriction`.
    """

    stribeck_velocity = slow_slide()
