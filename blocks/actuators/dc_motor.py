"""A permanent-magnet DC motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_in, signal_out
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class DCMotor(Block):
    """DC motor: V = R i + L di/dt + km w, torque = eta kt i, J w' = torque - B w + torque at the shaft.

    R = resistance, L = inductance, kt = torque_constant, km = back_emf_constant, eta = efficiency, J = rotor_inertia,
    B = viscous_friction. A positive current accelerates the shaft in the positive sense; a positive torque at the shaft
    accelerates the rotor.

    With L = 0 the current is i = (V - km w) / R at once and is not a state; such an L cannot be tuned later.
    In SI units kt = km by energy conservation; where a data sheet differs, or eta < 1, the difference
    (km - eta kt) i w counts as lost. A constant eta gains that power when the motor brakes, a weakness of the law.
    [Gao X. n.d., text below eq. 11; Gao J. n.d., eqs. 2.1 to 2.10]
    """

    cut_after = ("shaft",)
    winding_parameters = ("resistance", "inductance")
    back_emf_parameter = "back_emf_constant"
    loads = ("shaft",)

    resistance = parameter("ohm", ..., "winding resistance R", gt=0, tolerance=0.15)
    inductance = parameter("H", 0.0, "winding inductance L; 0 eliminates the current", ge=0)
    torque_constant = parameter("N.m/A", ..., "torque per current kt", gt=0, tolerance=0.15)
    back_emf_constant = parameter(
        "V.s/rad",
        SameAs("torque_constant"),
        "voltage per speed km; that of the torque if not given",
        ge=0,
        tolerance=0.15,
    )
    efficiency = parameter("1", 1.0, "share eta of the torque kt i that reaches the shaft", gt=0, le=1, tolerance=0.1)
    rotor_inertia = parameter("kg.m2", 0.0, "moment of inertia of the rotor J", ge=0, tolerance=0.1)
    viscous_friction = parameter("N.m.s/rad", 0.0, "bearing torque per speed B", ge=0, tolerance=0.3)

    voltage = signal_in("V", "voltage at the terminals V")
    shaft = flange("the rotor")
    current = signal_out("A", "current in the winding i")
    torque = signal_out("N.m", "torque of the current on the rotor, eta kt i")

    def stamp(self, net: Net) -> None:
        speed, resistance, km = self.shaft.speed, self.resistance, self.back_emf_constant
        if not self.differs("inductance"):
            current = (self.voltage - km * speed) / resistance
        else:
            current = net.state("winding.current", "A", doc="current in the winding")
            net.derivative(current, (self.voltage - resistance * current - km * speed) / self.inductance)
            net.store(self.inductance * current**2 / 2)
        torque = self.efficiency * self.torque_constant * current
        net.inertia(self.shaft, self.rotor_inertia)
        net.force(self.shaft, torque - self.viscous_friction * speed)

        net.supply(self.voltage * current)
        net.dissipate(resistance * current**2 + self.viscous_friction * speed**2)
        net.dissipate((km * current - torque) * speed)
        net.output(self.current, current)
        net.output(self.torque, torque)
