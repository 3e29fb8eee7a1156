"""Torque motor: a direct drive whose iron saturates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm import Block, flange, parameter, signal_in, signal_out
from flexarm.symbolic import sqrt

if TYPE_CHECKING:
    from flexarm import Net


class TorqueMotor(Block):
    """Torque motor: J w' = kt i / sqrt(1 + (i / is)^2) + torque at the shaft, w = speed of the shaft, i = current.

    kt = torque_constant at small current, is = saturation_current, J = rotor_inertia. A positive current turns the
    shaft in the positive sense; the torque never exceeds kt is.
    """

    cut_after = ("shaft",)  # what the motor drives may hang on a joint that gives way or has play

    torque_constant = parameter("N.m/A", ..., "torque per current kt at small current", gt=0, tolerance=0.1)
    saturation_current = parameter("A", ..., "current is at which kt i is 1.41 times the torque", gt=0, tolerance=0.1)
    rotor_inertia = parameter("kg.m2", ..., "moment of inertia J of the rotor", gt=0, tolerance=0.1)

    current = signal_in("A", "current of the winding i")
    shaft = flange("the rotor")
    torque = signal_out("N.m", "torque of the winding on the rotor")

    def stamp(self, net: Net) -> None:
        """Write the law into the net: the rotor, the torque on it, and the power that it takes from the supply."""
        torque = self.torque_constant * self.current / sqrt(1 + (self.current / self.saturation_current) ** 2)
        net.inertia(self.shaft, self.rotor_inertia)
        net.force(self.shaft, torque)
        net.supply(torque * self.shaft.speed)
        net.output(self.torque, torque)
