"""Play between two parts that touch through a spring and damper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators.contact import LAW, LAWS, contact
from engine.block import Block, flange, option, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Backlash(Block):
    """Backlash between two shafts: tau = k (e -+ g) + d e' at the faces e = +-g, 0 between them.

    e = angle of a - angle of b - rest_angle, k = stiffness, d = damping, g = half_gap. tau acts on b and -tau on a: a
    drives b.
    ``law: push_only`` closes a face when its penetration p and its force k p + d p' are both positive, and opens it
    when the force would pull. ``law: two_sided`` is in contact while p > 0 and lets the damper pull. With half_gap = 0
    two_sided is exactly the plain spring-damper; push_only is then another law, since its damping never pulls.

    Openings and closings are located and do not chatter. A pushing contact opens while still compressed: what its
    spring then holds is lost as the faces withdraw, and so it stands in the energy balance.
    Law and gap change the fit to [Gao J. n.d., Table A.2] from 6.06 to 2.81 and 1.30 dB.
    """

    spring_parameters = ("stiffness", "damping", "rest_angle")
    spring_when = (("law", "two_sided"), ("half_gap", 0.0))
    loads = ("a", "b")

    stiffness = parameter("N.m/rad", ..., "contact torque per penetration k", gt=0, tolerance=0.2)
    damping = parameter("N.m.s/rad", 0.0, "contact torque per rate of penetration d", ge=0, tolerance=0.3)
    half_gap = parameter("rad", ..., "play from the middle to either face g", ge=0, tolerance=0.3)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b in the middle of the play")
    law = option(str, "push_only", LAW, choices=LAWS)

    a = flange("driving shaft")
    b = flange("driven shaft")
    offset = signal_out("rad", "distance from the middle of the play e")
    torque = signal_out("N.m", "torque on b, tau")
    contact = signal_out("1", "face in contact: 1 the positive, -1 the negative, 0 none")

    def stamp(self, net: Net) -> None:
        k, d, g = self.stiffness, self.damping, self.half_gap
        a, b = self.a, self.b
        e, rate = a.angle - b.angle - self.rest_angle, a.speed - b.speed
        effort, touching = contact(net, e, rate, k, d, g, self.law)
        net.pair(a, b, -effort)
        net.output(self.offset, e)
        net.output(self.torque, effort)
        net.output(self.contact, touching)


class TranslationalBacklash(Backlash, slide={}):
    """Play between two slides: F = k (e -+ g) + d e' at the faces e = +-g, 0 between them.

    e = position of a - position of b - rest_distance, k = stiffness, d = damping, g = half_gap. F acts on b and -F on
    a. The two laws are those of `Backlash`.
    """
