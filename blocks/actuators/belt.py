"""A belt of two strands that can go slack."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode
from engine.block import Block, flange, parameter, signal_out
from engine.ports import TRANSLATIONAL, Expression

if TYPE_CHECKING:
    from engine.net import Net

NEVER = 1e9
"""A pretension with which no strand goes slack: the default."""


class Belt(Block):
    """Belt: F = F1 - F2, F1 = F0 + (k e + d e') / 2 and F2 = F0 - (k e + d e') / 2, a strand 0 while it is slack.

    e = position of a - position of b, F on b and -F on a; k = stiffness and d = damping of both strands together, F0 =
    pretension of each. While both are taut, F = k e + d e' whatever F0. From k |e| = 2 F0 on, one strand hangs and
    carries nothing: the stiffness falls to k / 2. With F0 = 0 there is never more than one strand. The instants are
    located; in a slack strand nothing is stored or lost.

    The ends are the rims of two pulleys, or one and a carriage: rotation becomes translation in a rigid `Pulley` at
    each side. A strand of length l, specific stiffness c (force per strain) has c / l, and k is the sum of both; k of
    an axis changes with the place of its carriage. Play between belt and teeth is a `TranslationalBacklash`.
    """

    spring_parameters = ("stiffness", "damping", "")
    spring_when = (("pretension", NEVER),)

    stiffness = parameter("N/m", ..., "force per stretch k while both strands are taut", gt=0, tolerance=0.2)
    damping = parameter("N.s/m", 0.0, "force per rate of stretch d while both are taut", ge=0, tolerance=0.5)
    pretension = parameter("N", NEVER, "force F0 in each strand at rest; 1e9 is never slack", ge=0, tolerance=0.3)

    a = flange("rim that drives", kind=TRANSLATIONAL)
    b = flange("rim or carriage that is driven", kind=TRANSLATIONAL)
    stretch = signal_out("m", "stretch e")
    force = signal_out("N", "force F on b")
    slack = signal_out("1", "strand that is slack: 1 the one behind b, -1 the one that pulls back, 0 none")

    def stamp(self, net: Net) -> None:
        k, d, pre = self.stiffness, self.damping, self.pretension
        e, rate = self.a.position - self.b.position, self.a.speed - self.b.speed
        half = k * e / 2

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, pre + half, half - pre, pre - half), by_mode(mode, -1, -half - pre, -1)

        mode = net.switch("slack", ("front strand slack", "taut", "rear strand slack"), guards)
        one = half + d * rate / 2
        force = by_mode(mode, one - pre, k * e + d * rate, one + pre)
        net.pair(self.a, self.b, -force)
        # What the pretension stores while both strands hang in balance is not counted.
        net.store(
            by_mode(mode, (pre - half) ** 2 / k - 2 * pre**2 / k, k * e**2 / 2, (pre + half) ** 2 / k - 2 * pre**2 / k)
        )
        net.dissipate(by_mode(mode, d / 2, d, d / 2) * rate**2)
        net.output(self.stretch, e)
        net.output(self.force, force)
        net.output(self.slack, mode)
