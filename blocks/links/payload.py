"""A body carried at a distance from a shaft's axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter

if TYPE_CHECKING:
    from engine.net import Net


class Payload(Block):
    """Payload: (m r^2 + Jc) w' = torque on the shaft, m = mass, r = radius, Jc = inertia about its own centre.

    Turns with the shaft in the horizontal plane; beside it on the same shaft, `GravityTorque` gives it weight.
    """

    mass = parameter("kg", ..., "mass m", ge=0, tolerance=0.1)
    radius = parameter("m", ..., "distance r from the axis to its centre of mass", ge=0, tolerance=0.1)
    inertia = parameter("kg.m2", 0.0, "moment of inertia Jc about its centre of mass", ge=0, tolerance=0.1)

    shaft = flange("what carries it")

    def stamp(self, net: Net) -> None:
        net.inertia(self.shaft, self.mass * self.radius**2 + self.inertia)
