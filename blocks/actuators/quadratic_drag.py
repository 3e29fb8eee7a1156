"""Drag that grows with the square of the speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import greatest
from engine.block import Block, flange, parameter

if TYPE_CHECKING:
    from engine.net import Net


class QuadraticDrag(Block):
    """Quadratic drag of a shaft: torque on the shaft = -c |w| w, c = drag, w = speed of the shaft.

    Air drag of an arm, churning of a lubricant. A blade of height h and length L across still air has about
    c = Cd rho h L^4 / 8.
    """

    drag = parameter("N.m.s2/rad2", ..., "torque per squared speed c", ge=0, tolerance=0.5)

    shaft = flange("the shaft that is slowed")

    def stamp(self, net: Net) -> None:
        speed = self.shaft.speed
        effort = self.drag * greatest(speed, -speed) * speed
        net.force(self.shaft, -effort)
        net.dissipate(effort * speed)


class TranslationalQuadraticDrag(QuadraticDrag, slide={}):
    """Quadratic drag of a slide: force on the slide = -c |v| v, c = drag, v = speed of the slide."""
