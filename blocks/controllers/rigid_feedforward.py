"""Feed-forward by the inverse dynamics of a geared motor with a rigid load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from blocks.controllers.inverse_dynamics import InverseDynamics, inertia, viscous
from engine.block import signal_in
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class RigidFeedForward(InverseDynamics):
    """Inverse dynamics, rigid load: V = R / (eta kt) [Jm pm'' + Bm pm' + Tc sgn(pm') + tau / n] + km pm'.

        pm = n p,  tau = Ja p'' + Ba p'

    The reference p is that of the load, with its derivatives. The motor turns n = ratio times while the load turns
    once; a negative ratio reverses. The load's values are those on its own side of the gear. sgn is 0 while the motor's
    reference is slower than rest_speed, so nothing pushes while it stands; switching is located. jerk and snap are not
    used: the ports are here so that the block can be exchanged for `TwoMassFeedForward` without rewiring.

    Sign: positive V and positive motor torque turn the motor in its positive sense.

    [Gao J. n.d., eq. 2.16] without a spring; its misprints are repaired (docs/errata.md).
    """

    load_inertia = inertia("the load Ja")
    load_viscous_friction = viscous("the load Ba")

    jerk = signal_in("rad/s3", "its third derivative; not used", default=0.0)
    snap = signal_in("rad/s4", "its fourth derivative; not used", default=0.0)

    def load(self, net: Net, p: Sequence[Expression]) -> tuple[Expression, Sequence[Expression]]:
        return self.load_inertia * p[2] + self.load_viscous_friction * p[1], p
