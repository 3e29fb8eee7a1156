"""Rigid bodies: a rotating inertia and a sliding mass."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter

if TYPE_CHECKING:
    from engine.net import Net


class Inertia(Block):
    """Rotating inertia: J w' = sum of the torques on the shaft, J = inertia."""

    inertia = parameter("kg.m2", ..., "moment of inertia J about the axis", gt=0, tolerance=0.1)

    shaft = flange("the rotating body")

    def stamp(self, net: Net) -> None:
        net.inertia(self.shaft, self.inertia)


class Mass(Inertia, slide={"shaft": "flange"}):
    """Sliding mass: m v' = sum of the forces on the flange, m = mass."""

    mass = parameter("kg", ..., "mass m", gt=0, tolerance=0.1)
