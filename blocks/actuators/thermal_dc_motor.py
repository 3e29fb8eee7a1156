"""A DC motor whose winding and magnets grow warm."""

from __future__ import annotations

from typing import TYPE_CHECKING

from engine.block import Block, flange, parameter, signal_in, signal_out
from engine.quantity import SameAs

if TYPE_CHECKING:
    from engine.net import Net


class ThermalDCMotor(Block):
    """DC motor with heat: V = R i + L i' + k w, torque = k i, R = R0 (1 + a (Tw - T0)), k = k0 (1 + b (Th - T0)).

    Winding: Cw Tw' = R i^2 - (Tw - Th) / Gw. Housing with magnets: Ch Th' = (Tw - Th) / Gw - (Th - Ta) / Gh. T are
    temperatures in kelvin, Gw = winding_thermal_resistance to the housing, Gh = housing_thermal_resistance to the
    ambient Ta, Cw and Ch the heat capacities. R0 and k0 are those at T0 = reference_temperature. Copper has a = 0.0039
    1/K; magnets of ferrite lose b = -0.002 1/K, of NdFeB -0.001, of SmCo -0.0004. Both start at start_temperature.

    The rest is that of `DCMotor` with kt = km = k and efficiency 1: with L = 0 the current is not a state. A data sheet
    gives a thermal time constant of each part: C = time constant / resistance. With a = b = 0 heat does nothing.
    """

    cut_after = ("shaft",)
    winding_parameters = ("resistance", "inductance")
    back_emf_parameter = "torque_constant"
    loads = ("shaft",)

    resistance = parameter("ohm", ..., "winding resistance R0 at the reference temperature", gt=0, tolerance=0.15)
    inductance = parameter("H", 0.0, "winding inductance L; 0 eliminates the current", ge=0)
    torque_constant = parameter("N.m/A", ..., "torque per current k0 at the reference", gt=0, tolerance=0.15)
    rotor_inertia = parameter("kg.m2", 0.0, "moment of inertia of the rotor J", ge=0, tolerance=0.1)
    viscous_friction = parameter("N.m.s/rad", 0.0, "bearing torque per speed B", ge=0, tolerance=0.3)
    resistance_coefficient = parameter("1/K", 0.0039, "rise of the resistance per kelvin a", ge=0, tolerance=0.3)
    magnet_coefficient = parameter("1/K", -0.001, "change of the torque constant per kelvin b", le=0, tolerance=0.5)
    winding_heat_capacity = parameter("J/K", ..., "heat capacity of the winding Cw", gt=0, tolerance=0.5)
    housing_heat_capacity = parameter("J/K", ..., "heat capacity of housing and magnets Ch", gt=0, tolerance=0.5)
    winding_thermal_resistance = parameter("K/W", ..., "from winding to housing Gw", gt=0, tolerance=0.5)
    housing_thermal_resistance = parameter("K/W", ..., "from housing to ambient Gh", gt=0, tolerance=0.5)
    ambient_temperature = parameter("K", 293.15, "temperature around Ta", gt=0)
    reference_temperature = parameter("K", 293.15, "temperature T0 of the values given", gt=0)
    start_temperature = parameter("K", SameAs("ambient_temperature"), "of both at the beginning", gt=0)

    voltage = signal_in("V", "voltage at the terminals V")
    shaft = flange("the rotor")
    current = signal_out("A", "current in the winding i")
    torque = signal_out("N.m", "torque of the current on the rotor k i")
    winding_temperature = signal_out("K", "temperature of the winding Tw")
    housing_temperature = signal_out("K", "temperature of housing and magnets Th")

    def stamp(self, net: Net) -> None:
        speed, t0 = self.shaft.speed, self.reference_temperature
        winding = net.state("winding.temperature", "K", start=self.start_temperature, doc="temperature of the winding")
        housing = net.state("housing.temperature", "K", start=self.start_temperature, doc="temperature of the housing")
        resistance = self.resistance * (1 + self.resistance_coefficient * (winding - t0))
        k = self.torque_constant * (1 + self.magnet_coefficient * (housing - t0))
        if not self.differs("inductance"):
            current = (self.voltage - k * speed) / resistance
        else:
            current = net.state("winding.current", "A", doc="current in the winding")
            net.derivative(current, (self.voltage - resistance * current - k * speed) / self.inductance)
            net.store(self.inductance * current**2 / 2)
        heat = resistance * current**2
        inward = (winding - housing) / self.winding_thermal_resistance
        outward = (housing - self.ambient_temperature) / self.housing_thermal_resistance
        net.derivative(winding, (heat - inward) / self.winding_heat_capacity)
        net.derivative(housing, (inward - outward) / self.housing_heat_capacity)
        net.inertia(self.shaft, self.rotor_inertia)
        net.force(self.shaft, k * current - self.viscous_friction * speed)

        # The books are those of electrical and mechanical energy: heat has left them.
        net.supply(self.voltage * current)
        net.dissipate(heat + self.viscous_friction * speed**2)
        net.output(self.current, current)
        net.output(self.torque, k * current)
        net.output(self.winding_temperature, winding)
        net.output(self.housing_temperature, housing)
