"""A mass that swings on a shaft."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Resonator(Block):
    """Resonator: J w' = tau, tau = J (W^2 e + 2 z W e'), e = angle of the shaft - angle of the resonator.

    J = inertia of what swings, W = frequency it swings with while the shaft is held, z = damping_ratio; the shaft feels
    -tau. A loose panel, a cable, a further mode of a load: one more degree of freedom that a rigid shaft has not. Held
    at rest it adds the inertia J to the shaft.
    """

    inertia = parameter("kg.m2", ..., "inertia of what swings J", gt=0, tolerance=0.3)
    frequency = parameter("rad/s", ..., "angular frequency with the shaft held W", gt=0, tolerance=0.2)
    damping_ratio = parameter("1", 0.0, "damping ratio with the shaft held z", ge=0, tolerance=0.5)

    shaft = flange("the shaft that carries the resonator")
    twist = signal_out("rad", "angle of the shaft - angle of the resonator, e")

    def stamp(self, net: Net) -> None:
        inner = net.coordinate("body")
        twist, rate = self.shaft.angle - inner.angle, self.shaft.speed - inner.speed
        stiffness = self.inertia * self.frequency**2
        damping = 2 * self.damping_ratio * self.inertia * self.frequency
        net.inertia(inner, self.inertia)
        net.pair(inner, self.shaft, stiffness * twist + damping * rate)
        net.store(stiffness * twist**2 / 2)
        net.dissipate(damping * rate**2)
        net.output(self.twist, twist)
