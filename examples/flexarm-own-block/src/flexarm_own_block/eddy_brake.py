"""Eddy-current brake: a conducting disc that turns between magnets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm import Block, flange, parameter, signal_out

if TYPE_CHECKING:
    from flexarm import Net


class EddyBrake(Block):
    """Eddy-current brake: torque on the shaft = -2 Tm u / (1 + u^2), u = w / wc, w = speed of the shaft.

    Tm = greatest_torque, which it reaches at the critical speed wc = critical_speed. Far below it the brake is a
    viscous damper of 2 Tm / wc; far above, the currents push the field out of the disc and the torque falls as 1/w.
    [Wouterse 1991]
    """

    greatest_torque = parameter("N.m", ..., "greatest torque Tm", gt=0, tolerance=0.2)
    critical_speed = parameter("rad/s", ..., "speed wc of the greatest torque", gt=0, tolerance=0.3)

    shaft = flange("the shaft with the disc")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        """Write the law into the net: the torque, where its power goes, and the output."""
        ratio = self.shaft.speed / self.critical_speed
        torque = -2 * self.greatest_torque * ratio / (1 + ratio**2)
        net.force(self.shaft, torque)
        net.dissipate(-torque * self.shaft.speed)
        net.output(self.torque, torque)
