"""A torsion spring with structural damping: a loss factor that does not depend on frequency."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from blocks.symbolic import log
from engine.block import Block, flange, option, parameter, signal_out
from engine.errors import ParameterError
from engine.relations import Relation

if TYPE_CHECKING:
    from engine.net import Net


class StructuralSpring(Block):
    """Spring with structural damping: torque / twist = k (1 + i eta) at frequencies within a band, k = stiffness.

    A loss factor eta = loss_factor that is constant over all frequencies is not causal, so it has no law in time.
    Within a band there is one: tau = k0 e + g sum (e - x_j), x_j' = w_j (e - x_j), with ``elements`` Maxwell elements
    at w_j spread evenly in the logarithm from ``lowest_frequency`` to ``highest_frequency``, ln s apart from one to the
    next, g = 2 eta k ln s / pi, k0 = k - g elements / 2. e = angle of a - angle of b - rest_angle; tau acts on b and
    -tau on a. The elements begin relaxed at the twist -rest_angle, that of shafts which start at zero.

    With two elements per decade the loss factor is eta at the middle of a wide band, 4 % less a decade inside its ends
    and two thirds of eta at them; a body on the spring swings with half of it as its damping ratio. The stiffness is k
    at the middle and rises by 2 eta k / pi per unit of ln frequency, as causality asks. Passive for any motion.
    """

    loads = ("a", "b")

    elements = option(int, 8, "number of Maxwell elements", ge=2, le=40)
    stiffness = parameter("N.m/rad", ..., "torque per twist k at the middle of the band", gt=0, tolerance=0.2)
    loss_factor = parameter("1", ..., "loss factor eta, twice the damping ratio", ge=0, lt=1, tolerance=0.5)
    lowest_frequency = parameter("rad/s", ..., "angular frequency of the slowest element", gt=0)
    highest_frequency = parameter("rad/s", ..., "angular frequency of the fastest element", gt=0)
    rest_angle = parameter("rad", 0.0, "angle of a - angle of b at which the spring is slack")

    a = flange("driving shaft")
    b = flange("driven shaft")
    twist = signal_out("rad", "twist of the spring e")
    torque = signal_out("N.m", "torque on b, tau")

    def relations(self) -> Iterable[Relation]:
        """The band must not be empty."""
        return [Relation("highest_frequency", "is not above", "lowest_frequency")]

    def check(self) -> None:
        """The stiffness at rest must be positive."""
        low, high = self.values["lowest_frequency"], self.values["highest_frequency"]
        share = self.elements / (self.elements - 1) * math.log(high / low) / math.pi
        loss = self.values["loss_factor"]
        if loss * share >= 1:
            raise ParameterError(
                f"loss_factor = {loss:g} from {low:g} to {high:g} rad/s leaves no stiffness at rest",
                remedy=f"give a loss factor below {1 / share:.3g}, or a narrower band",
            )

    def stamp(self, net: Net) -> None:
        last = self.elements - 1
        apart = log(self.highest_frequency / self.lowest_frequency) / last
        part = 2 * self.loss_factor * self.stiffness * apart / math.pi
        twist = self.a.angle - self.b.angle - self.rest_angle
        at_rest = self.stiffness - part * self.elements / 2
        torque = at_rest * twist
        net.store(at_rest * twist**2 / 2)
        for j in range(self.elements):
            rate = self.lowest_frequency ** (1 - j / last) * self.highest_frequency ** (j / last)
            x = net.state(
                f"element{j + 1}", self.here("rad"), start=-self.rest_angle, doc=f"flow of Maxwell element {j + 1}"
            )
            net.derivative(x, rate * (twist - x))
            torque = torque + part * (twist - x)
            net.store(part * (twist - x) ** 2 / 2)
            net.dissipate(part * rate * (twist - x) ** 2)
        net.pair(self.a, self.b, -torque)
        net.output(self.twist, twist)
        net.output(self.torque, torque)


class TranslationalStructuralSpring(StructuralSpring, slide={}, keeps=("lowest_frequency", "highest_frequency")):
    """Spring with structural damping: force / compression = k (1 + i eta) at frequencies within a band.

    The law is that of `StructuralSpring`, e = position of a - position of b - rest_distance; F acts on b and -F on a.
    """
