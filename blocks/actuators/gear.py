"""A gear with losses, rigid or elastic."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators import kinematic_error
from blocks.actuators.directed_loss import directed_loss
from engine.block import Block, flange, parameter, signal_out
from engine.errors import ParameterError
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class Gear(Block):
    """Gear: input angle = ratio * output angle, torque out = efficiency * ratio * torque in, J on the output shaft.

    ``ratio`` n is the reduction: the input turns n times while the output turns once, in the opposite sense if n < 0,
    as in a pair of external gears. Rigid (``stiffness: 0``), the share ``efficiency`` eta of the power that enters at
    the input arrives at the output, whichever way it flows; so an inertia Jm before the gear counts as eta n^2 Jm
    behind it (Jeq = eta_g Kg^2 Jm + gears [Gao X. n.d., text below eq. 11]). The loss is counted in the energy balance.
    A constant eta gains power when the load drives the motor, a weakness of the law. With efficiency = 1 the gear is
    lossless and eta is not in the equations, so it cannot be tuned afterwards. A lossy rigid gear cannot lie in a
    closed loop of ties.

    Elastic: tau = k e + d e', e = angle in / n - angle out, tau on the output. ``efficiency`` counts while the input
    drives, and takes tau / (n eta) from it; ``backdriving_efficiency`` eta_b while the output does, and gives the input
    eta_b tau / n. The difference from tau / n is a friction that grows with the load, |tau / n| (1 / eta - 1) or
    |tau / n| (1 - eta_b): the input sticks below it, exactly. With eta_b <= 0 the gear is self-locking; a worm of
    lead angle L and friction angle r has eta = tan L / tan(L + r), eta_b = tan(L - r) / tan L. Friction that does not
    depend on the load is a `BearingFriction` on a shaft; the two are the law of Modelica's LossyGear [Pelchen 2002].
    An elastic gear may have a transmission error as `HarmonicDrive` has it: k = 1 of an eccentric pinion, k = 1 / n of
    an eccentric wheel.
    """

    cut_after = ("output",)

    ratio = parameter("1", ..., "reduction n, input speed / output speed; negative if the gear reverses", nonzero=True)
    efficiency = parameter(
        "1", 1.0, "share eta of the power at the input that arrives at the output", gt=0, le=1, tolerance=0.1
    )
    inertia = parameter("kg.m2", 0.0, "moment of inertia J of the gear train, on the output shaft", ge=0, tolerance=0.1)
    stiffness = parameter("N.m/rad", 0.0, "torque at the output per twist k; 0 is rigid", ge=0, tolerance=0.3)
    damping = parameter(
        "N.m.s/rad", 0.0, "torque at the output per rate of twist d; for an elastic gear", ge=0, tolerance=0.5
    )
    backdriving_efficiency = parameter(
        "1",
        SameAs("efficiency"),
        "share eta_b of the output's power that arrives at the input; 0 or less is self-locking",
        le=1,
        tolerance=0.2,
    )
    error_waves = kinematic_error.waves()
    error_amplitude = kinematic_error.amplitude()
    error_order = kinematic_error.order()
    error_phase = kinematic_error.phase()

    input = flange("the fast shaft")
    output = flange("the slow shaft")
    torque = signal_out("N.m", "torque tau on the output; of a rigid gear it is not told, and 0")

    def check(self) -> None:
        """What needs elasticity must have it."""
        if not self.differs("stiffness"):
            elastic_only = ("damping", "backdriving_efficiency", "error_waves")
            given = next((name for name in elastic_only if name in self.given), "")
            if given:
                raise ParameterError(
                    f"{given} is for an elastic Gear, and stiffness is 0",
                    remedy="give the stiffness, in N.m/rad at the output; a data sheet calls it torsional rigidity",
                )

    def stamp(self, net: Net) -> None:
        a, b, n, eta = self.input, self.output, self.ratio, self.efficiency
        lossy = self.differs("efficiency", 1)
        net.inertia(b, self.inertia)
        if not self.differs("stiffness"):
            net.tie({a: 1, b: -n}, (a, b, eta) if lossy else None)
            net.output(self.torque, 0.0)
            return
        angle, share = kinematic_error.meshed(self, a)
        twist, rate = angle - b.angle, share * a.speed - b.speed
        torque = self.stiffness * twist + self.damping * rate
        net.force(b, torque)
        net.force(a, -torque * share)
        net.twist({a: 1 / n, b: -1})
        net.store(self.stiffness * twist**2 / 2)
        net.dissipate(self.damping * rate**2)
        net.output(self.torque, torque)
        if lossy or self.differs("backdriving_efficiency", 1):
            directed_loss(net, a, torque * share, eta, self.backdriving_efficiency)
