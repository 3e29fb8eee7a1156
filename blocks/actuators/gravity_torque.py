"""Gravity on a body that turns about a horizontal axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import sin
from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class GravityTorque(Block):
    """Gravity on a turning body: torque on the shaft = -m g r sin(angle - hanging_angle), m = mass, r = radius.

    r is the distance from the axis to the centre of mass, which hangs below the axis at ``hanging_angle``. Only the
    weight: the body's moment of inertia belongs to the block that is the body, such as `Inertia` or `Payload`.
    Small swings of a body of inertia J have the frequency sqrt(m g r / J).
    """

    loads = ("shaft",)

    mass = parameter("kg", ..., "mass m of the body", ge=0, tolerance=0.1)
    radius = parameter("m", ..., "distance r from the axis to the centre of mass", ge=0, tolerance=0.1)
    gravity = parameter("m/s2", 9.81, "acceleration of gravity g", ge=0)
    hanging_angle = parameter("rad", 0.0, "angle at which the body hangs straight down")

    shaft = flange("the turning body")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        moment, angle = self.mass * self.gravity * self.radius, self.shaft.angle - self.hanging_angle
        net.potential([self.shaft], 2 * moment * sin(angle / 2) ** 2)
        net.output(self.torque, -moment * sin(angle))
