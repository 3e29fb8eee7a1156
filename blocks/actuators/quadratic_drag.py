"""Drag that grows with the square of the speed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.symbolic import greatest
from engine.block import Block, flange, parameter
from engine.ports import TRANSLATIONAL

if TYPE_CHECKING:
    from engine.net import Net
    from engine.stamps import Motion


class _QuadraticDrag(Block):
    """The law; subclasses declare the parameter in its unit, and the flange."""

    drag: Any

    def _slow(self, net: Net, motion: Motion) -> None:
        speed = motion.speed
        effort = self.drag * greatest(speed, -speed) * speed
        net.force(motion, -effort)
        net.dissipate(effort * speed)


class QuadraticDrag(_QuadraticDrag):
    """Quadratic drag of a shaft: torque on the shaft = -c |w| w, c = drag, w = speed of the shaft.

    Air drag of an arm, churning of a lubricant. A blade of height h and length L across still air has about
    c = Cd rho h L^4 / 8.
    """

    slide_twin = "TranslationalQuadraticDrag"

    drag = parameter("N.m.s2/rad2", ..., "torque per squared speed c", ge=0, tolerance=0.5)

    shaft = flange("the shaft that is slowed")

    def stamp(self, net: Net) -> None:
        self._slow(net, self.shaft)


class TranslationalQuadraticDrag(_QuadraticDrag):
    """Quadratic drag of a slide: force on the slide = -c |v| v, c = drag, v = speed of the slide."""

    drag = parameter("N.s2/m2", ..., "force per squared speed c", ge=0, tolerance=0.5)

    slide = flange("the slide that is slowed", kind=TRANSLATIONAL)

    def stamp(self, net: Net) -> None:
        self._slow(net, self.slide)
