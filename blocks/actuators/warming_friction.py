"""Friction of a bearing, gear or guide whose oil or grease warms up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators.friction import STRIBECK, BearingFriction
from blocks.symbolic import choose, exp, magnitude
from engine.block import parameter, signal_out
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class WarmingFriction(BearingFriction):
    """Friction that falls as it warms up: torque on the shaft = -(D(v) exp(-c (T - T0)) + B v exp(-b (T - T0))).

    D(v) is the dry friction of `BearingFriction` (levels, velocity vs, both directions, true stick), B =
    viscous_friction, all as they are at T0 = reference_temperature. b = temperature_coefficient is the share of the
    viscosity that a kelvin takes: an oil that is half as thick 20 K warmer has 0.035 1/K. c =
    dry_temperature_coefficient is that of the dry friction, about which less is known; it follows b if it is not given.

    All that is lost becomes heat: C T' = |torque v| - (T - Ta) / G. T = temperature of the joint in kelvin, C =
    heat_capacity of what warms with the oil, G = thermal_resistance to the ambient Ta, so that C G is the time constant
    with which the joint warms up and cools. T begins at start_temperature. The static levels fall with the sliding
    ones: a load that a cold joint holds may move a warm one. With b = c = 0 this is `BearingFriction`; with every level
    0 it never sticks. The law is that of one temperature, over some tens of kelvins. [Bittencourt 2010; Simoni 2017]
    """

    temperature_coefficient = parameter(
        "1/K", 0.03, "share of the viscous friction that a kelvin takes b", ge=0, tolerance=0.5
    )
    dry_temperature_coefficient = parameter(
        "1/K",
        SameAs("temperature_coefficient"),
        "share of the dry friction that a kelvin takes c; as of the viscous one if not given",
        ge=0,
        tolerance=0.5,
    )
    heat_capacity = parameter("J/K", ..., "heat capacity of what warms with the oil C", gt=0, tolerance=0.5)
    thermal_resistance = parameter("K/W", ..., "from the joint to the ambient G", gt=0, tolerance=0.5)
    ambient_temperature = parameter("K", 293.15, "temperature around Ta", gt=0)
    reference_temperature = parameter("K", 293.15, "temperature T0 of the values given", gt=0)
    start_temperature = parameter("K", SameAs("ambient_temperature"), "of the joint at the beginning", gt=0)

    temperature = signal_out("K", "temperature of the joint T")

    def stamp(self, net: Net) -> None:
        velocity = self.shaft.speed
        joint = net.state("joint.temperature", "K", start=self.start_temperature, doc="temperature of the joint")
        rise = joint - self.reference_temperature
        viscous = self.viscous_friction * exp(-self.temperature_coefficient * rise) * velocity
        heat = viscous * velocity
        net.pair(self.shaft, None, -viscous)
        # The books are those of mechanical energy: heat has left them. The dry part is booked with its friction.
        net.dissipate(heat)
        if self._sticks():
            heat = heat + self._rub(net, exp(-self.dry_temperature_coefficient * rise))
        outward = (joint - self.ambient_temperature) / self.thermal_resistance
        net.derivative(joint, (heat - outward) / self.heat_capacity)
        net.output(self.temperature, joint)

    def _rub(self, net: Net, dry: Expression) -> Expression:
        """Stamp the dry friction, of which the share ``dry`` is left, and give the power that sliding takes."""
        velocity = self.shaft.speed
        forward, static_forward = self._level("")
        backward, static_backward = self._level("_backward")

        net.friction(
            {self.shaft: 1},
            forward=lambda speed: dry * forward(speed),
            backward=lambda speed: dry * backward(speed),
            static_forward=dry * static_forward,
            static_backward=dry * static_backward,
        )
        return dry * choose(velocity > 0, forward(velocity), backward(velocity)) * magnitude(velocity)


class TranslationalWarmingFriction(WarmingFriction, slide={}):
    """Friction of a slide that falls as it warms up: force = -(D(v) exp(-c (T - T0)) + B v exp(-b (T - T0))).

    The law, its heat and its defaults are those of `WarmingFriction`.
    """

    stribeck_velocity = parameter("m/s", 0.01, STRIBECK, gt=0, tolerance=0.5)
