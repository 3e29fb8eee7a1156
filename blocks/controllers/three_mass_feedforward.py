"""Feed-forward by the inverse dynamics of a geared motor that drives a load and a flexible link through two springs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from blocks.controllers.inverse_dynamics import InverseDynamics, before_spring, inertia, viscous
from engine.block import parameter
from engine.ports import Expression

if TYPE_CHECKING:
    from engine.net import Net


class ThreeMassFeedForward(InverseDynamics):
    """Inverse dynamics, flexible link: V = R / (eta kt) [Jm pm'' + Bm pm' + Tc sgn(pm') + tau / n] + km pm'.

        dl q' + kl q = Jl p'' + Bl p',  pa = p + q
        da e' + ka e = tau = Ja pa'' + Ba pa' + Jl p'' + Bl p',  pm = n (pa + e)

    The reference p is that of the link, with its derivatives up to the snap; pa is the angle of the load, q the twist
    between load and link, e that between gear and load. The rates of both twists are states that start at 0. Both
    springs need damping: without it the model would need derivatives beyond the snap. The motor turns n = ratio times
    while the load turns once; a negative ratio reverses. Load, link and spring values are those on the load's side of
    the gear. sgn is 0 while the motor's reference is slower than rest_speed, so nothing pushes while it stands;
    switching is located.

    Sign: positive V and positive motor torque turn the motor in its positive sense; e > 0 turns the gear ahead of the
    load, q > 0 the load ahead of the link.

    [Gao J. n.d., eq. 2.21]; its misprints are repaired (docs/errata.md).
    """

    load_inertia = inertia("the load Ja")
    load_viscous_friction = viscous("the load Ba")
    stiffness = parameter("N.m/rad", ..., "stiffness between gear and load ka", gt=0)
    damping = parameter("N.m.s/rad", ..., "damping between gear and load da", gt=0)
    link_inertia = inertia("the link Jl")
    link_viscous_friction = viscous("the link Bl")
    link_stiffness = parameter("N.m/rad", ..., "stiffness between load and link kl", gt=0)
    link_damping = parameter("N.m.s/rad", ..., "damping between load and link dl", gt=0)

    def load(self, net: Net, p: Sequence[Expression]) -> tuple[Expression, Sequence[Expression]]:
        link = [self.link_inertia * p[k + 2] + self.link_viscous_friction * p[k + 1] for k in range(3)]
        a = before_spring(net, "link.twist_rate", p, link, self.link_stiffness, self.link_damping)
        torques = [self.load_inertia * a[k + 2] + self.load_viscous_friction * a[k + 1] + link[k] for k in range(2)]
        return torques[0], before_spring(net, "twist_rate", a, torques, self.stiffness, self.damping)
