"""Feed-forward by the inverse dynamics of a motor with one, two or three masses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.symbolic import by_mode
from engine.block import Block, option, parameter, signal_in, signal_out
from engine.errors import ParameterError
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class FeedForward(Block):
    """Inverse dynamics: V = R / (eta kt) [Jm pm'' + Bm pm' + Tc sgn(pm') + tau / n] + km pm', tau = the load's torque.

    The reference p is that of the last mass, with its derivatives; the motor turns n = ratio times while the load turns
    once. The load's values are those on its own side of the gear.

        masses 1: pm = n p, tau = (Ja + Jl) p'' + (Ba + Bl) p'
        masses 2: pm = n (p + e), da e' + ka e = tau, tau as above
        masses 3: pa = p + q, dl q' + kl q = Jl p'' + Bl p'; pm = n (pa + e), da e' + ka e = tau = Ja pa'' + Ba pa'
                  + Jl p'' + Bl p'
        masses 0: pm = n p and V = 0, for a comparison without feed-forward

    e and q are the twists of the springs; their rates are first-order states that start at 0. Masses 2 needs the jerk,
    and without damping the snap; masses 3 needs the snap, and damping in both springs. sgn is 0 while the motor's
    reference is slower than rest_speed, so nothing pushes while it stands; switching is located.

    Paper 002, (2.16) and (2.21), whose misprints are repaired: the numerator is da s + ka, tau is divided by n, the
    bracket is a torque, and the back-emf is missing there (referee's notes, 3.3).
    """

    masses = option(int, 2, "number of masses the inverse model has, 0 to 3", ge=0, le=3)
    ratio = parameter("1", 1.0, "turns of the motor for one of the load n", gt=0)
    resistance = parameter("ohm", ..., "motor's winding resistance R", gt=0)
    torque_constant = parameter("N.m/A", ..., "motor's torque per current kt", gt=0)
    back_emf_constant = parameter("V.s/rad", SameAs("torque_constant"), "motor's voltage per speed km", ge=0)
    efficiency = parameter("1", 1.0, "share eta of the motor's torque that reaches its shaft", gt=0, le=1)
    rotor_inertia = parameter("kg.m2", 0.0, "moment of inertia of the rotor Jm", ge=0)
    viscous_friction = parameter("N.m.s/rad", 0.0, "torque per speed at the motor Bm", ge=0)
    coulomb_friction = parameter("N.m", 0.0, "dry friction at the motor Tc; 0 leaves it out", ge=0)
    rest_speed = parameter("rad/s", 1e-3, "speed of the motor's reference below which it counts as standing", gt=0)
    load_inertia = parameter("kg.m2", 0.0, "moment of inertia of the load Ja", ge=0)
    load_viscous_friction = parameter("N.m.s/rad", 0.0, "torque per speed at the load Ba", ge=0)
    stiffness = parameter("N.m/rad", 0.0, "stiffness between motor and load ka", ge=0)
    damping = parameter("N.m.s/rad", 0.0, "damping between motor and load da", ge=0)
    link_inertia = parameter("kg.m2", 0.0, "moment of inertia of the third mass Jl", ge=0)
    link_viscous_friction = parameter("N.m.s/rad", 0.0, "torque per speed at the third mass Bl", ge=0)
    link_stiffness = parameter("N.m/rad", 0.0, "stiffness between load and third mass kl", ge=0)
    link_damping = parameter("N.m.s/rad", 0.0, "damping between load and third mass dl", ge=0)

    position = signal_in("rad", "reference of the last mass p")
    velocity = signal_in("rad/s", "its first derivative")
    acceleration = signal_in("rad/s2", "its second derivative")
    jerk = signal_in("rad/s3", "its third derivative")
    snap = signal_in("rad/s4", "its fourth derivative")
    voltage = signal_out("V", "voltage that moves the motor so")
    angle = signal_out("rad", "reference of the motor pm", name="motor.angle")
    speed = signal_out("rad/s", "its first derivative", name="motor.speed")
    motor_acceleration = signal_out("rad/s2", "its second derivative", name="motor.acceleration")

    def check(self) -> None:
        """An elastic model needs its springs, and a third mass needs damping."""
        needed = {2: ["stiffness"], 3: ["stiffness", "damping", "link_stiffness", "link_damping"]}.get(self.masses, [])
        for name in needed:
            if self.values[name] == 0:
                raise ParameterError(
                    f"{name} is 0, but masses = {self.masses} needs it above 0",
                    remedy="give it, or use fewer masses; without damping three masses need derivatives beyond snap",
                )

    def stamp(self, net: Net) -> None:
        motion = [self.position, self.velocity, self.acceleration, self.jerk, self.snap]
        torque, motion = self._load(net, motion)
        n = self.ratio
        angle, speed, acceleration = (n * value for value in motion[:3])
        voltage: Expression = 0.0
        if self.masses > 0:
            torque = torque / n + self.rotor_inertia * acceleration + self.viscous_friction * speed
            if self.values["coulomb_friction"] > 0:
                torque += self.coulomb_friction * self._direction(net, speed)
            voltage = self.resistance / (self.efficiency * self.torque_constant) * torque
            voltage += self.back_emf_constant * speed
        net.output(self.voltage, voltage)
        net.output(self.angle, angle)
        net.output(self.speed, speed)
        net.output(self.motor_acceleration, acceleration)

    def _load(self, net: Net, p: list[Expression]) -> tuple[Expression, list[Expression]]:
        """Torque at the gear's slow side and motion there, from the motion of the last mass."""
        Ja, Ba, Jl, Bl = self.load_inertia, self.load_viscous_friction, self.link_inertia, self.link_viscous_friction
        if self.masses < 3:
            torques = [(Ja + Jl) * p[k + 2] + (Ba + Bl) * p[k + 1] for k in range(3)]
            if self.masses < 2:
                return torques[0], p
            return torques[0], self._before(net, "twist_rate", p, torques, self.stiffness, self.damping)
        link = [Jl * p[k + 2] + Bl * p[k + 1] for k in range(3)]
        a = self._before(net, "link.twist_rate", p, link, self.link_stiffness, self.link_damping)
        torques = [Ja * a[k + 2] + Ba * a[k + 1] + link[k] for k in range(2)]
        return torques[0], self._before(net, "twist_rate", a, torques, self.stiffness, self.damping)

    def _before(
        self, net: Net, name: str, p: list[Expression], torque: list[Expression], k: Expression, d: Expression
    ) -> list[Expression]:
        """Motion before a spring that transmits a torque, from the motion behind it; each with its derivatives."""
        if self.values["damping"] == 0 and self.masses == 2:
            twist = [t / k for t in torque]
        else:
            rate = net.state(name, "rad/s", doc="rate of the reference's twist")
            twist = [(torque[0] - d * rate) / k, rate]
            for t in torque[1:]:
                twist.append((t - k * twist[-1]) / d)
            net.derivative(rate, twist[2])
        return [x + e for x, e in zip(p, twist, strict=False)]

    def _direction(self, net: Net, speed: Expression) -> Expression:
        """Sign of the motor's reference speed, 0 at rest."""
        low = self.rest_speed

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, speed + low, speed - low, low - speed), by_mode(mode, -1, -low - speed, -1)

        return net.switch("direction", ("backward", "standing", "forward"), guards)
