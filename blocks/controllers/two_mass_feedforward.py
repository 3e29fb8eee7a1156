"""Feed-forward by the inverse dynamics of a geared motor that drives a load through a spring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from blocks.controllers.inverse_dynamics import InverseDynamics, before_spring, inertia, viscous
from engine.block import parameter
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class TwoMassFeedForward(InverseDynamics):
    """Inverse dynamics, elastic drive: V = R / (eta kt) [Jm pm'' + Bm pm' + Tc sgn(pm') + tau / n] + km pm'.

        da e' + ka e = tau = Ja p'' + Ba p',  pm = n (p + e)

    The reference p is that of the load, with its derivatives; e is the twist of the spring between gear and load. The
    twist's rate is a state that starts at 0, so the jerk is needed; without damping there is no state and the snap is
    needed. The motor turns n = ratio times while the load turns once; a negative ratio reverses. Load and spring values
    are those on the load's side of the gear. sgn is 0 while the motor's reference is slower than rest_speed, so nothing
    pushes while it stands; switching is located.

    Sign: positive V and positive motor torque turn the motor in its positive sense; e > 0 turns the gear ahead of the
    load.

    [Gao J. n.d., eq. 2.16]; its misprints are repaired (docs/errata.md).
    """

    load_inertia = inertia("the load Ja")
    load_viscous_friction = viscous("the load Ba")
    stiffness = parameter("N.m/rad", ..., "stiffness between gear and load ka", gt=0)
    damping = parameter("N.m.s/rad", 0.0, "damping between gear and load da", ge=0)

    def load(self, net: Net, p: Sequence[Expression]) -> tuple[Expression, Sequence[Expression]]:
        torques = [self.load_inertia * p[k + 2] + self.load_viscous_friction * p[k + 1] for k in range(3)]
        if not self.differs("damping"):
            return torques[0], [p[k] + torques[k] / self.stiffness for k in range(3)]
        return torques[0], before_spring(net, "twist_rate", p, torques, self.stiffness, self.damping)
