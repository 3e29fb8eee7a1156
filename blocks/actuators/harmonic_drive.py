"""A strain-wave gear with its torsional compliance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.actuators import kinematic_error
from blocks.actuators.directed_loss import directed_loss
from engine.block import Block, flange, option, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class HarmonicDrive(Block):
    """Harmonic drive: tau = K e + D e', e = angle of the input / n - angle of the output.

    tau acts on the output and -tau / n on the input; n = ratio, K = stiffness and D = damping, on the output side. The
    input is the wave generator, |n| times as fast as the output. n < 0 where the output turns in the opposite sense:
    the circular spline is held and the flexspline drives the load. The block has no inertia: connect the rotor to the
    input and the load to the output. As K grows, rotor Jr and load Jl approach
    (n^2 Jr + Jl) q'' = n (torque at the input): the difference falls as 1 / K, and the frequency at which they swing
    against each other grows as sqrt(K).

    With an ``efficiency`` eta below 1, ``loss: constant`` takes tau / (eta n) from the input, whichever way power
    flows, as `Gear` does; it gains power while the load drives. ``loss: directed`` takes tau / (eta n) while the input
    drives and eta tau / n while the load does: the difference from tau / n is a dry friction at the input whose level
    follows |tau|, and so it holds the input still, exactly, below that level. With efficiency = 1 neither is in the
    equations. [One-link n.d., eqs. 1, 2], with the reaction divided by n (docs/errata.md).

    Transmission error: with ``error_waves`` above 0, e = theta / n + sum a (sin(k theta + phi) - sin(phi)) - angle of
    the output, theta = angle of the input, a = error_amplitude, k = error_order, phi = error_phase, a value per wave:
    angles are counted from where nothing is twisted. Harmonic drives have k = 2 and 4, the meshing of both sides of the
    wave generator, of some 0.1 mrad. The torque on the input follows from the power, -tau (1 / n + sum a k cos(...)):
    the error is lossless, and shakes a fast motor.
    """

    cut_after = ("output",)
    loads = ("input",)

    loss = option(str, "constant", "how the efficiency counts when the load drives", choices=("constant", "directed"))
    ratio = parameter("1", 100.0, "reduction n, input speed / output speed; negative if it reverses", nonzero=True)
    stiffness = parameter("N.m/rad", ..., "torque at the output per twist K", gt=0, tolerance=0.2)
    damping = parameter("N.m.s/rad", 0.0, "torque at the output per rate of twist D", ge=0, tolerance=0.5)
    efficiency = parameter("1", 1.0, "share eta of the driving power that arrives", gt=0, le=1, tolerance=0.1)
    error_waves = kinematic_error.waves()
    error_amplitude = kinematic_error.amplitude()
    error_order = kinematic_error.order()
    error_phase = kinematic_error.phase()

    input = flange("the wave generator, the fast shaft")
    output = flange("the slow shaft")
    twist = signal_out("rad", "twist e on the output side")
    torque = signal_out("N.m", "torque tau on the output")

    def stamp(self, net: Net) -> None:
        a, b, n, eta = self.input, self.output, self.ratio, self.efficiency
        lossy = self.differs("efficiency", 1)
        angle, share = kinematic_error.meshed(self, a)
        twist, rate = angle - b.angle, share * a.speed - b.speed
        torque = self.stiffness * twist + self.damping * rate
        net.force(b, torque)
        net.twist({a: 1 / n, b: -1})
        net.store(self.stiffness * twist**2 / 2)
        net.dissipate(self.damping * rate**2)
        net.output(self.twist, twist)
        net.output(self.torque, torque)
        if not lossy:
            net.force(a, -torque * share)
        elif self.loss == "constant":
            net.force(a, -torque * share / eta)
            net.dissipate(torque * share * a.speed * (1 / eta - 1))
        else:
            net.force(a, -torque * share)
            directed_loss(net, a, torque * share, eta, eta)
