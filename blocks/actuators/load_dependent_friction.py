"""Friction that grows with the torque that a drive carries."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import choose, exp, magnitude
from engine.block import Block, flange, parameter, signal_in
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class LoadDependentFriction(Block):
    """Load-dependent friction of a shaft: torque = -sign(v) F, F = Fc + mu |T| + q T^2, T the load, v the speed.

    Fc = coulomb_friction, the level without load. mu = coefficient where the load drives the shaft (T v > 0), and mu =
    opposing_coefficient where it holds it back; the two are equal if the second is not given. q =
    quadratic_coefficient, where a large load costs a larger share of it than a small one. Slow sliding takes
    static_ratio r times as much: F (1 + (r - 1) exp(-(v / vs)^2)), vs = stribeck_velocity. Stuck, v is exactly 0 until
    more than r F pulls at the shaft.

    ``load`` is the torque through the gear: that of the motor, of the arm's weight, or of a spring, as measured or
    calculated elsewhere; several loads are several blocks on one shaft, and their levels add up with those of
    `BearingFriction`. It may not depend on the shaft's own acceleration: for the torque behind an inertia give a
    `Gear` its stiffness and efficiencies, which is this law with T = tau / n, coefficient 1 / eta - 1 and
    opposing_coefficient 1 - eta_b. With Fc, mu and q 0 the block does nothing. [Duclusaud 2025, models M3 to M6]
    """

    coefficient = parameter("1", 0.0, "friction per load mu while the load drives the shaft", ge=0, lt=1, tolerance=0.5)
    opposing_coefficient = parameter(
        "1",
        SameAs("coefficient"),
        "friction per load while the load holds the shaft back; as while it drives if not given",
        ge=0,
        tolerance=0.5,
    )
    quadratic_coefficient = parameter("1/(N.m)", 0.0, "friction per square of the load q", ge=0, tolerance=0.5)
    coulomb_friction = parameter("N.m", 0.0, "friction without load Fc", ge=0, tolerance=0.3)
    static_ratio = parameter("1", 1.0, "friction just before slipping over that of sliding r", ge=1, tolerance=0.3)
    stribeck_velocity = parameter(
        "rad/s", 0.1, "velocity vs over which the friction falls to that of sliding", gt=0, tolerance=0.5
    )

    shaft = flange("the shaft that turns in the loaded gear")
    load = signal_in("N.m", "torque T that is carried, positive where it drives the shaft in the positive sense")

    def stamp(self, net: Net) -> None:
        size, helps = magnitude(self.load), self.load > 0
        always = self.coulomb_friction + self.quadratic_coefficient * self.load**2
        forward = always + size * choose(helps, self.coefficient, self.opposing_coefficient)
        backward = always + size * choose(helps, self.opposing_coefficient, self.coefficient)

        def rise(velocity: Expression) -> Expression:
            return 1 + (self.static_ratio - 1) * exp(-((velocity / self.stribeck_velocity) ** 2))

        net.friction(
            {self.shaft: 1},
            forward=lambda velocity: forward * rise(velocity),
            backward=lambda velocity: backward * rise(velocity),
            static_forward=forward * self.static_ratio,
            static_backward=backward * self.static_ratio,
        )


class TranslationalLoadDependentFriction(LoadDependentFriction, slide={}):
    """Load-dependent friction of a slide: force = -sign(v) (Fc + mu |F| + q F^2), F the load, v the speed of the slide.

    The law is that of `LoadDependentFriction`.
    """

    stribeck_velocity = parameter(
        "m/s", 0.01, "velocity vs over which the friction falls to that of sliding", gt=0, tolerance=0.5
    )
