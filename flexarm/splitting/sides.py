"""The blocks that stand on either side of a cut: one keeps the motion, the other follows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from engine.block import Block, flange, signal_in, signal_out
from engine.ports import TRANSLATIONAL
from fmu.coupling import NEVER, elapsed, motion

if TYPE_CHECKING:
    from engine.net import Net


class Follower(Block):
    """A cut shaft on the side that follows: its motion comes from outside, its torque goes there.

    Between communication points the motion goes on: with s = time - sent, by
    angle + speed s + acceleration s^2 / 2 + jerk s^3 / 6.
    """

    angle = signal_in("rad", "angle of the shaft")
    speed = signal_in("rad/s", "speed of the shaft")
    acceleration = signal_in("rad/s2", "acceleration of the shaft", default=0.0)
    jerk = signal_in("rad/s3", "its rate of change", default=0.0)
    sent = signal_in("s", "when the motion held", default=NEVER)
    shaft = flange("where the cut is")
    torque = signal_out("N.m", "torque on the other side of the cut")
    now = signal_out("s", "when the torque holds")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.torque, -_imposed(net, self.shaft, self.angle, self))


class TranslationalFollower(Block):
    """The same for a translational flange."""

    position = signal_in("m", "position of the flange")
    speed = signal_in("m/s", "speed of the flange")
    acceleration = signal_in("m/s2", "acceleration of the flange", default=0.0)
    jerk = signal_in("m/s3", "its rate of change", default=0.0)
    sent = signal_in("s", "when the motion held", default=NEVER)
    flange = flange("where the cut is", kind=TRANSLATIONAL)
    force = signal_out("N", "force on the other side of the cut")
    now = signal_out("s", "when the force holds")

    def stamp(self, net: Net) -> None:
        """Impose the motion and give its reaction."""
        net.output(self.force, -_imposed(net, self.flange, self.position, self))


def _imposed(net: Net, flange: Any, angle: Any, block: Any) -> Any:
    s = elapsed(net.time, block.sent)
    net.output(block.now, net.time)
    return net.prescribe(flange, *motion(angle, block.speed, block.acceleration, block.jerk, s))


class Owner(Block):
    """A cut shaft on the side that keeps the motion: the torque of the other side, and how it answers the motion.

    torque on the shaft = torque + offset + rate s - stiffness angle - damping speed - inertia acceleration, with
    s = time - sent.
    """

    torque = signal_in("N.m", "torque on the shaft")
    rate = signal_in("N.m/s", "its rate of change by itself", default=0.0)
    offset = signal_in("N.m", "stiffness angle + damping speed where the torque holds", default=0.0)
    stiffness = signal_in("N.m/rad", "how it falls with the angle", default=0.0)
    damping = signal_in("N.m.s/rad", "how it falls with the speed", default=0.0)
    inertia = signal_in("kg.m2", "inertia behind the cut", default=0.0)
    sent = signal_in("s", "when the torque held", default=NEVER)
    shaft = flange("where the cut is")
    now = signal_out("s", "when the motion holds")

    def stamp(self, net: Net) -> None:
        """Act on the shaft."""
        _act(net, self.shaft, self.shaft.angle, self.torque, self)


class TranslationalOwner(Block):
    """The same for a translational flange."""

    force = signal_in("N", "force on the flange")
    rate = signal_in("N/s", "its rate of change by itself", default=0.0)
    offset = signal_in("N", "stiffness position + damping speed where the force holds", default=0.0)
    stiffness = signal_in("N/m", "how it falls with the position", default=0.0)
    damping = signal_in("N.s/m", "how it falls with the speed", default=0.0)
    inertia = signal_in("kg", "mass behind the cut", default=0.0)
    sent = signal_in("s", "when the force held", default=NEVER)
    flange = flange("where the cut is", kind=TRANSLATIONAL)
    now = signal_out("s", "when the motion holds")

    def stamp(self, net: Net) -> None:
        """Act on the flange."""
        _act(net, self.flange, self.flange.position, self.force, self)


def _act(net: Net, motion: Any, angle: Any, effort: Any, block: Any) -> None:
    net.inertia(motion, block.inertia)
    net.output(block.now, net.time)
    effort = (
        effort
        + block.offset
        + block.rate * elapsed(net.time, block.sent)
        - block.stiffness * angle
        - block.damping * motion.speed
    )
    net.force(motion, effort)
    net.supply(effort * motion.speed)
