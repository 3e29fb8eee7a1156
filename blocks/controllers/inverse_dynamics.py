"""Base of the feed-forward blocks: the voltage of a geared DC motor from the motion and torque of its load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from blocks.symbolic import by_mode
from engine.block import Block, option, parameter, signal_in, signal_out
from engine.ports import Expression
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


def inertia(doc: str) -> Any:
    """The declaration of a mass behind the gear."""
    return parameter("kg.m2", ..., f"moment of inertia of {doc}", gt=0, tolerance=0.1)


def viscous(doc: str) -> Any:
    """The declaration of a viscous friction behind the gear."""
    return parameter("N.m.s/rad", 0.0, f"torque per speed at {doc}", ge=0)


class InverseDynamics(Block):
    """The motor's side: V = R / (eta kt) [Jm pm'' + Bm pm' + Tc sgn(pm') + tau / n] + km pm', pm = n a.

    ``a`` is the angle at the slow side of the gear and ``tau`` the torque that the load takes there; both come from
    the subclass. The motor turns n = ratio times while the load turns once; a negative ratio reverses. sgn is 0 while
    the motor's reference is slower than rest_speed; switching is located.
    """

    active = option(bool, True, "false gives V = 0 and pm = n p, for a comparison without feed-forward")
    ratio = parameter("1", 1.0, "turns of the motor for one of the load n; negative if the gear reverses", nonzero=True)
    resistance = parameter("ohm", ..., "motor's winding resistance R", gt=0)
    torque_constant = parameter("N.m/A", ..., "motor's torque per current kt", gt=0)
    back_emf_constant = parameter("V.s/rad", SameAs("torque_constant"), "motor's voltage per speed km", ge=0)
    efficiency = parameter("1", 1.0, "share eta of the motor's torque that reaches its shaft", gt=0, le=1)
    rotor_inertia = parameter("kg.m2", 0.0, "moment of inertia of the rotor Jm", ge=0)
    viscous_friction = parameter("N.m.s/rad", 0.0, "torque per speed at the motor Bm", ge=0)
    coulomb_friction = parameter("N.m", 0.0, "dry friction at the motor Tc; 0 leaves it out", ge=0)
    rest_speed = parameter("rad/s", 1e-3, "speed of the motor's reference below which it counts as standing", gt=0)

    position = signal_in("rad", "reference of the last mass p")
    velocity = signal_in("rad/s", "its first derivative")
    acceleration = signal_in("rad/s2", "its second derivative")
    jerk = signal_in("rad/s3", "its third derivative")
    snap = signal_in("rad/s4", "its fourth derivative")
    voltage = signal_out("V", "voltage that moves the motor so")
    angle = signal_out("rad", "reference of the motor pm", name="motor.angle")
    speed = signal_out("rad/s", "its first derivative", name="motor.speed")
    motor_acceleration = signal_out("rad/s2", "its second derivative", name="motor.acceleration")

    def load(self, net: Net, p: Sequence[Expression]) -> tuple[Expression, Sequence[Expression]]:
        """Torque at the gear's slow side (N.m), and the angle there with at least two derivatives.

        Args:
            net: takes the states of springs.
            p: motion of the last mass, from the angle to the snap.

        Raises:
            NotImplementedError: the subclass has no load.
        """
        raise NotImplementedError

    def stamp(self, net: Net) -> None:
        motion: Sequence[Expression] = [self.position, self.velocity, self.acceleration, self.jerk, self.snap]
        voltage: Expression = 0.0
        n = self.ratio
        if not self.active:
            angle, speed, acceleration = (n * value for value in motion[:3])
        else:
            torque, motion = self.load(net, motion)
            angle, speed, acceleration = (n * value for value in motion[:3])
            torque = torque / n + self.rotor_inertia * acceleration + self.viscous_friction * speed
            if self.differs("coulomb_friction"):
                torque += self.coulomb_friction * self._direction(net, speed)
            voltage = self.resistance / (self.efficiency * self.torque_constant) * torque
            voltage += self.back_emf_constant * speed
        net.output(self.voltage, voltage)
        net.output(self.angle, angle)
        net.output(self.speed, speed)
        net.output(self.motor_acceleration, acceleration)

    def _direction(self, net: Net, speed: Expression) -> Expression:
        """Sign of the motor's reference speed, 0 at rest."""
        low = self.rest_speed

        def guards(mode: Expression) -> tuple[Expression, Expression]:
            return by_mode(mode, speed + low, speed - low, low - speed), by_mode(mode, -1, -low - speed, -1)

        return net.switch("direction", ("backward", "standing", "forward"), guards)


def before_spring(
    net: Net, name: str, p: Sequence[Expression], torque: Sequence[Expression], k: Expression, d: Expression
) -> list[Expression]:
    """Motion before a damped spring, from the motion behind it: a = p + e, d e' + k e = torque.

    The twist's rate e' is a state, which starts at 0.

    Args:
        net: takes the state.
        name: of the state.
        p: angle behind the spring and its derivatives.
        torque: what the spring transmits, and its derivatives.
        k: stiffness (N.m/rad).
        d: damping (N.m.s/rad), not 0.

    Returns:
        The angle before the spring and its derivatives, as many as ``torque`` has entries and one more.
    """
    rate = net.state(name, "rad/s", doc="rate of the reference's twist")
    twist = [(torque[0] - d * rate) / k, rate]
    for t in torque[1:]:
        twist.append((t - k * twist[-1]) / d)
    net.derivative(rate, twist[2])
    return [x + e for x, e in zip(p, twist, strict=False)]
