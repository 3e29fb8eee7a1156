"""A torque from outside that swings in time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import sin
from engine.block import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Vibration(Block):
    """Outside vibration: torque on the shaft = A sin(W t + phase), A = amplitude, W = frequency.

    It stands for the disturbance by a neighbouring machine, a fan or the mains. It depends on the model's time t alone.
    """

    amplitude = parameter("N.m", ..., "greatest torque A", ge=0, tolerance=0.5)
    frequency = parameter("rad/s", ..., "angular frequency W", gt=0, tolerance=0.05)
    phase = parameter("rad", 0.0, "phase at time zero")

    shaft = flange("the shaft that is shaken")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        torque = self.amplitude * sin(self.frequency * net.time + self.phase)
        net.force(self.shaft, torque)
        net.supply(torque * self.shaft.speed)
        net.output(self.torque, torque)


class TranslationalVibration(Vibration, slide={}, keeps=("frequency", "phase")):
    """Outside vibration: force on the slide = A sin(W t + phase), A = amplitude, W = frequency."""
