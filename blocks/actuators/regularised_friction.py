"""Friction as an equivalent viscous coefficient, smoothed at rest."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.actuators.friction import static_not_below_sliding
from blocks.actuators.presliding import slow_slide, stribeck
from blocks.symbolic import greatest
from engine.block import Block, flange, parameter, signal_out
from engine.quantity import SameAs
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class RegularisedFriction(Block):
    """Smoothed friction of a shaft: torque -c(v) v, c(v) = [Fc + (Fs - Fc) exp(-(v / vs)^2)] / max(|v|, v0) + B.

    Fc = coulomb_friction, Fs = static_friction, vs = stribeck_velocity, B = viscous_friction, v0 = creep_velocity, v
    the speed of the shaft. A state-dependent viscous coefficient [One-link n.d., text below eq. 4].

    Use it to compare with models that have it, and `BearingFriction` otherwise. Under a load T below Fs the shaft never
    stops but creeps at about v0 T / Fs, and near rest it relaxes at Fs / (J v0): a small v0 needs short steps.
    """

    coulomb_friction = parameter("N.m", ..., "sliding friction Fc", gt=0, tolerance=0.3)
    static_friction = parameter(
        "N.m", SameAs("coulomb_friction"), "friction Fs at the slowest sliding; Fc if not given", gt=0, tolerance=0.3
    )
    stribeck_velocity = parameter(
        "rad/s", 0.1, "velocity vs over which the friction falls from Fs to Fc", gt=0, tolerance=0.5
    )
    viscous_friction = parameter("N.m.s/rad", 0.0, "friction per velocity B", ge=0, tolerance=0.3)
    creep_velocity = parameter("rad/s", ..., "velocity v0 below which the friction falls to zero", gt=0)

    shaft = flange("the shaft that turns in the bearing")
    friction = signal_out("N.m", "friction c(v) v")

    def relations(self) -> Iterable[Relation]:
        """The static level must not be below the sliding level."""
        return [static_not_below_sliding()]

    def stamp(self, net: Net) -> None:
        velocity = self.shaft.speed
        size = greatest(greatest(velocity, -velocity), self.creep_velocity)
        friction = (stribeck(self, velocity) / size + self.viscous_friction) * velocity
        net.force(self.shaft, -friction)
        net.dissipate(friction * velocity)
        net.output(self.friction, friction)


class TranslationalRegularisedFriction(RegularisedFriction, slide={}):
    """Smoothed friction of a slide: force -c(v) v, v = speed of the slide; c(v) as in `RegularisedFriction`."""

    stribeck_velocity = slow_slide()
