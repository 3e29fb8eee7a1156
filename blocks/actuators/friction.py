"""Viscous, Coulomb and Stribeck friction with true stick, to the ground or between two flanges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from blocks.symbolic import exp, greatest
from engine.block import Block, flange, parameter
from engine.ports import Expression
from engine.quantity import SameAs
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion

_COULOMB = "sliding friction Fc in the positive direction"
_COULOMB_BACK = "sliding friction in the negative direction, a positive number; that of the positive if not given"
_STATIC = "friction Fs just before slipping forward; the sliding friction if not given"
_STATIC_BACK = "friction just before slipping backward, a positive number; as forward if not given"
STRIBECK = "velocity vs over which the friction falls from Fs to Fc"
_VISCOUS = "friction per velocity B"

_AS_FORWARD = SameAs("static_friction", instead=("static_friction", "coulomb_friction_backward"))


def static_not_below_sliding(direction: str = "") -> Relation:
    """The relation between the levels of one direction."""
    remedy = "leave the static friction out where it equals the sliding friction"
    return Relation(f"static_friction{direction}", "is less than", f"coulomb_friction{direction}", remedy)


class _Friction(Block):
    """The law; subclasses declare flanges."""

    coulomb_friction = parameter("N.m", 0.0, _COULOMB, ge=0, tolerance=0.3)
    coulomb_friction_backward = parameter("N.m", SameAs("coulomb_friction"), _COULOMB_BACK, ge=0, tolerance=0.3)
    static_friction = parameter("N.m", SameAs("coulomb_friction"), _STATIC, ge=0, tolerance=0.3)
    static_friction_backward = parameter("N.m", _AS_FORWARD, _STATIC_BACK, ge=0, tolerance=0.3)
    stribeck_velocity = parameter("rad/s", 0.1, STRIBECK, gt=0, tolerance=0.5)
    viscous_friction = parameter("N.m.s/rad", 0.0, _VISCOUS, ge=0, tolerance=0.3)

    def relations(self) -> Iterable[Relation]:
        """The static level must not be below the sliding level."""
        return [static_not_below_sliding(direction) for direction in ("", "_backward")]

    def _between(self, net: Net, a: Motion, b: Motion | None) -> None:
        """Stamp the friction of ``a`` against ``b`` (None is the ground)."""
        velocity = a.speed if b is None else a.speed - b.speed
        viscous = self._c("viscous_friction") * velocity
        net.pair(a, b, -viscous)
        net.dissipate(viscous * velocity)
        if not self._sticks():
            return
        forward, static_forward = self._level("")
        backward, static_backward = self._level("_backward")
        net.friction(
            {a: 1} if b is None else {a: 1, b: -1},
            forward=forward,
            backward=backward,
            static_forward=static_forward,
            static_backward=static_backward,
        )

    def _sticks(self) -> bool:
        """Whether any level is given: with all of them 0 nothing ever sticks."""
        return any(self.differs(name) for name in self.values if name.startswith(("coulomb", "static")))

    def _level(self, direction: str) -> tuple[Any, Expression]:
        """Sliding friction as a function of velocity, and the static level, of one direction."""
        sliding, static = self._c(f"coulomb_friction{direction}"), self._c(f"static_friction{direction}")
        if static is sliding:
            return (lambda velocity: sliding), sliding
        static = greatest(static, sliding)
        width = self._c("stribeck_velocity")
        return (lambda velocity: sliding + (static - sliding) * exp(-((velocity / width) ** 2))), static

    def _c(self, name: str) -> Expression:
        return getattr(self, name)


class BearingFriction(_Friction):
    """Friction of a shaft in its bearing: torque on the shaft = -F(v), v = speed of the shaft.

    Sliding at v > 0: F = Fc + (Fs - Fc) exp(-(v / vs)^2) + B v. Sliding at v < 0: the same with the levels
    ``..._backward``, pointing the other way. Stuck: v is exactly 0 and F is whatever keeps it there, until it exceeds
    the static level of a direction. Fc = coulomb_friction, Fs = static_friction, vs = stribeck_velocity,
    B = viscous_friction.

    Sticking and slipping happen at located instants and a stuck joint does not creep. Levels that are not given follow
    the others: static as sliding, backward as forward. Where a fit moves Fs below Fc, the law uses Fc. Several
    frictions on one shaft add up; a friction that closes a loop of frictions is refused. With every level 0 the block
    is a viscous damper that never sticks, and its levels cannot be tuned afterwards. [Armstrong 1994]; switching
    without chatter: docs/explanation/switching.md.
    """

    shaft = flange("the shaft that turns in the bearing")

    def stamp(self, net: Net) -> None:
        self._between(net, self.shaft, None)


class JointFriction(_Friction):
    """Friction between two shafts: torque -F(v) on a and F(v) on b, v = speed of a - speed of b.

    F(v), its sticking and its defaults are those of `BearingFriction`.
    """

    a = flange("first shaft")
    b = flange("second shaft")

    def stamp(self, net: Net) -> None:
        self._between(net, self.a, self.b)


class TranslationalBearingFriction(BearingFriction, slide={}):
    """Friction of a slide in its guide: force on the slide = -F(v), v = speed of the slide.

    F(v), its sticking and its defaults are those of `BearingFriction`.
    """

    stribeck_velocity = parameter("m/s", 0.01, STRIBECK, gt=0, tolerance=0.5)


class TranslationalJointFriction(JointFriction, slide={}):
    """Friction between two slides: force -F(v) on a and F(v) on b, v = speed of a - speed of b.

    F(v), its sticking and its defaults are those of `BearingFriction`.
    """

    stribeck_velocity = parameter("m/s", 0.01, STRIBECK, gt=0, tolerance=0.5)
