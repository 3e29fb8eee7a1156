"""The directions of an arm's elements, from the encoder and the strain gauges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from engine.block import Block, option, signal_in, signal_out
from engine.ports import Port

if TYPE_CHECKING:
    from engine.net import Net


class StrainReconstruction(Block):
    """State of a lumped arm from its sensors: theta_i = theta_(i-1) + e_i, i = 1 .. n; theta_0 = angle, n = joints.

    ``angle`` is the encoder's, at the side of the link; ``strain1`` .. ``strainN`` are the bends e_i of the joints,
    from the hub. The outputs ``element1`` .. ``elementN`` are the directions of the elements against the ground, the
    state that [One-link n.d., text below eq. 4] feeds back; ``tip`` is the last.
    """

    joints = option(int, 3, "number of joints n", ge=1, le=16)

    angle = signal_in("rad", "angle of the hub, theta_0")
    tip = signal_out("rad", "direction of the last element, theta_n")

    def further_ports(self) -> Iterable[Port]:
        """A bend and a direction for each joint."""
        for i in range(1, self.joints + 1):
            yield Port(f"strain{i}", "input", f"bend of joint {i}, e_{i}", unit="rad")
            yield Port(f"element{i}", "output", f"direction of element {i}, theta_{i}", unit="rad")

    def stamp(self, net: Net) -> None:
        direction = self.angle
        for i in range(1, self.joints + 1):
            direction = direction + self.port(f"strain{i}")
            net.output(self.port(f"element{i}"), direction)
        net.output(self.tip, direction)
