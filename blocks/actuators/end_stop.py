"""Stops at the ends of a range of motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators.contact import LAW, LAWS, contact
from engine.block import Block, flange, option, parameter, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net


class EndStop(Block):
    """End stops of a shaft: torque on the shaft = -(k p + d p') beyond upper or lower, p = how far beyond; else 0.

    k = stiffness, d = damping, p = angle - upper above, angle - lower below. With ``law: push_only`` a stop never
    pulls; with ``two_sided`` its damper may, until the shaft is back in the range. Touching and parting are located; a
    stop that is left still compressed loses what its spring holds, as `Backlash` does. The reaction acts on the ground;
    for a stop between two shafts use `Backlash`.

    A body of inertia J that comes with speed w goes w sqrt(J / k) beyond, without damping. A stop that should be hard
    gets a stiffness that keeps this small; a very stiff one needs short steps.
    """

    lower = parameter("rad", ..., "angle of the lower stop")
    upper = parameter("rad", ..., "angle of the upper stop")
    stiffness = parameter("N.m/rad", ..., "torque per angle beyond a stop k", gt=0, tolerance=0.5)
    damping = parameter("N.m.s/rad", 0.0, "torque per speed at a stop d", ge=0, tolerance=0.5)
    law = option(str, "push_only", LAW, choices=LAWS)

    shaft = flange("what is stopped")
    torque = signal_out("N.m", "torque on the shaft")
    contact = signal_out("1", "stop in contact: 1 the upper, -1 the lower, 0 none")

    def check(self) -> None:
        """The stops must leave room."""
        if self.lower >= self.upper:
            raise ParameterError(f"lower = {self.lower:g} is not below upper = {self.upper:g}")

    def stamp(self, net: Net) -> None:
        offset, half = self.shaft.angle - (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
        effort, touching = contact(net, offset, self.shaft.speed, self.stiffness, self.damping, half, self.law)
        net.force(self.shaft, -effort)
        net.output(self.torque, -effort)
        net.output(self.contact, touching)


class TranslationalEndStop(EndStop, slide={}):
    """End stops of a slide: force on the slide = -(k p + d p') beyond upper or lower, p = how far beyond; else 0.

    The law is that of `EndStop`.
    """
