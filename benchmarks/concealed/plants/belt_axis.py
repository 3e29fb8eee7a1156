"""Motor, pulley, belt and carriage: voltage in; encoder of the motor and scale of the carriage out."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from benchmarks.concealed.mechanism import Mechanism, Readout
from benchmarks.concealed.plants.base import (
    Body,
    Control,
    Excitation,
    JointLaw,
    LinkOptions,
    Plant,
    Quantity,
    Sensor,
    Sites,
    plain_spring,
)

BELT, CARRIAGE = "belt", "carriage.flange"


class BeltAxis(Plant):
    """A motor of 24 V whose torque and back-emf constants are one, a light belt, and a carriage of 1.5 kg.

    It belongs to the suite of drives alone: what the other suites draw follows from the order of the plants they know.
    """

    name = "belt-axis"
    title = "Belt axis with a DC motor"
    drive = "motor.voltage"
    drive_unit = "V"
    parameters = (
        Quantity("motor.resistance", 1.2, "ohm", 0.15),
        Quantity("motor.torque_constant", 0.06, "N.m/A", 0.15),
        Quantity("motor.rotor_inertia", 3e-5, "kg.m2", 0.10),
        Quantity("motor.viscous_friction", 2e-5, "N.m.s/rad", 0.30, spread=0.30),
        Quantity("belt.stiffness", 5e3, "N/m", 0.20),
        Quantity("belt.damping", 4.0, "N.s/m", 0.50, spread=0.30),
        Quantity("carriage.mass", 1.5, "kg", 0.10),
        Quantity("guide.viscous_friction", 4.0, "N.s/m", 0.30, spread=0.30),
    )
    fixed: Mapping[str, float] = MappingProxyType({"pulley.radius": 0.015})
    sensors = (
        Sensor("carriage.flange.position", "scale", "m", step=2e-5),
        Sensor("motor.shaft.angle", "enc", "count", counts=2000),
    )
    sites = Sites(
        input="source.out -> motor.voltage",
        shafts=(("motor.shaft", "pulley.shaft", "pulley.slide", "belt.a"), (CARRIAGE, "belt.b", "guide.slide")),
        springs=(BELT,),
        extra={
            "belt_slack": (BELT,),
            "end_stop": (CARRIAGE,),
            "warm_up": ("motor",),
            "friction_warm_up": ("guide.slide",),
            "inductance": (),
        },
        same={"motor": ("motor.voltage", "source.out -> motor.voltage"), "guide.slide": ("guide",)},
    )
    excitation = Excitation(
        amplitude=9.0, dwell=(0.12, 0.5), low=0.3, high=25.0, clock=0.04, resolution=1e-3, reach=1.5
    )
    control = Control(CARRIAGE + ".position", kp=60.0, ki=0.0, kd=3.0, reference=0.3, limit=24.0)
    main = CARRIAGE
    blocks = """
  source: {{type: Step, height: 1 V, stop: 1 s}}
  motor:
    type: DCMotor
    resistance: {motor.resistance} ohm
    torque_constant: {motor.torque_constant} N.m/A
    rotor_inertia: {motor.rotor_inertia} kg.m2
    viscous_friction: {motor.viscous_friction} N.m.s/rad
  pulley: {{type: Pulley, radius: 15 mm}}
  belt: {{type: Belt, stiffness: {belt.stiffness} N/m, damping: {belt.damping} N.s/m}}
  carriage: {{type: Mass, mass: {carriage.mass} kg}}
  guide: {{type: TranslationalBearingFriction, viscous_friction: {guide.viscous_friction} N.s/m}}

connect:
  - [source.out, motor.voltage]
  - [motor.shaft, pulley.shaft]
  - [pulley.slide, belt.a]
  - [belt.b, carriage.flange, guide.slide]
"""

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates in metres: the rim of the pulley, and the carriage."""
        m = Mechanism()
        rim, carriage = m.coordinate("rim"), m.coordinate("carriage")
        shaft = rim.geared(1 / self.fixed["pulley.radius"])
        m.inertia(shaft, p["motor.rotor_inertia"])
        m.spring(shaft, 0.0, p["motor.viscous_friction"])
        m.inertia(carriage, p["carriage.mass"])
        m.spring(carriage, 0.0, p["guide.viscous_friction"])
        m.motor(shaft, p["motor.resistance"], inductance, p["motor.torque_constant"], p["motor.torque_constant"])
        laws.get(BELT, plain_spring)(m, rim.against(carriage), p["belt.stiffness"], p["belt.damping"])
        ports = dict.fromkeys(("motor.shaft", "pulley.shaft"), shaft) | dict.fromkeys(("pulley.slide", "belt.a"), rim)
        ports |= dict.fromkeys((CARRIAGE, "belt.b", "guide.slide"), carriage)
        signals = {CARRIAGE + ".position": Readout(carriage.sense), "motor.shaft.angle": Readout(shaft.sense)}
        return Body(m, ports, signals)
