"""A rigid arm turning about its hub in the horizontal plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class RigidLink(Block):
    """Rigid uniform arm: (Jh + m L^2 / 3 + mp L^2) theta'' = sum of the torques at the hub.

    L = length, m = mass, mp = payload, Jh = hub_inertia, theta = angle of the hub. Horizontal plane: no gravity. A
    positive torque at the hub turns the arm in the positive sense. The rigid limit of `AssumedModesLink`.
    """

    length = parameter("m", ..., "length L from the axis to the tip", gt=0)
    mass = parameter("kg", ..., "mass m, evenly spread over the length", gt=0, tolerance=0.1)
    payload = parameter("kg", 0.0, "point mass mp at the tip", ge=0, tolerance=0.1)
    hub_inertia = parameter("kg.m2", 0.0, "moment of inertia Jh of the hub", ge=0, tolerance=0.1)

    hub = flange("the axis of the arm")
    tip_position = signal_out("m", "path of the tip along its circle, L theta", name="tip.position")

    def stamp(self, net: Net) -> None:
        length = self.length
        net.inertia(self.hub, self.hub_inertia + self.mass * length**2 / 3 + self.payload * length**2)
        net.output(self.tip_position, length * self.hub.angle)
