"""Geared motor that drives an inertia through a shaft that twists: voltage in; tachometer and load encoder out."""

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

COUPLING, SHAFT = "motor.shaft -> gear.input", "shaft"


class GearedTwoMass(Plant):
    """SRV02 motor in low gear, load and shaft of the size of [Gao J. n.d., Table B.3] seen from the load."""

    name = "geared-two-mass"
    title = "Geared motor with a load on an elastic shaft"
    drive = "motor.voltage"
    drive_unit = "V"
    parameters = (
        Quantity("motor.resistance", 2.6, "ohm", 0.15),
        Quantity("motor.torque_constant", 7.68e-3, "N.m/A", 0.15),
        Quantity("motor.back_emf_constant", 7.68e-3, "V.s/rad", 0.15),
        Quantity("motor.efficiency", 0.69, "1", 0.10, ceiling=1.0),
        Quantity("motor.rotor_inertia", 4.606e-7, "kg.m2", 0.10),
        Quantity("motor.viscous_friction", 1.26e-6, "N.m.s/rad", 0.30, spread=0.30),
        Quantity("gear.inertia", 5e-5, "kg.m2", 0.10),
        Quantity("shaft.stiffness", 2.55, "N.m/rad", 0.20),
        Quantity("shaft.damping", 4e-3, "N.m.s/rad", 0.30, spread=0.30),
        Quantity("load.inertia", 9.6e-3, "kg.m2", 0.10),
        Quantity("tacho.sensitivity", 0.01432, "V.s/rad", 0.05, spread=0.05),
    )
    fixed: Mapping[str, float] = MappingProxyType({"gear.ratio": 14.0})
    sensors = (
        Sensor("tacho.out", "tacho", "V", noise=5e-3),
        Sensor("load.shaft.angle", "enc", "count", counts=4096),
    )
    sites = Sites(
        input="source.out -> motor.voltage",
        shafts=(("motor.shaft", "gear.input", "gear.output", "shaft.a"), ("load.shaft", "shaft.b")),
        joints=(COUPLING,),
        springs=(SHAFT,),
        sensors={
            "sensor_bias": ("tacho.out",),
            "sensor_lag": ("tacho.out", "load.shaft.angle"),
            "rectified_sensor": ("tacho.out",),
        },
        extra={
            "viscous_friction": (),
            "gravity": ("load.shaft",),
            "stray_spring": ("load.shaft",),
            "quadratic_drag": ("load.shaft",),
            "extra_mode": ("load.shaft",),
            "outside_vibration": ("load.shaft",),
            "torque_ripple": ("motor.shaft",),
            "backlash": (SHAFT, COUPLING),
            "hysteresis": (SHAFT,),
            "hardening_spring": (SHAFT,),
            "structural_damping": (SHAFT,),
            "joint_flexibility": (COUPLING,),
        },
    )
    excitation = Excitation(amplitude=3.0, dwell=(0.12, 0.5), low=0.3, high=25.0, clock=0.03, resolution=1e-3)
    control = Control("tacho.out", kp=0.8, ki=4.0, kd=0.0, reference=1.5, limit=6.0)
    main = "load.shaft"
    inductance = 1.8e-4
    blocks = """
  source: {{type: Step, height: 1 V, stop: 1 s}}
  motor:
    type: DCMotor
    resistance: {motor.resistance} ohm
    torque_constant: {motor.torque_constant} N.m/A
    back_emf_constant: {motor.back_emf_constant} V.s/rad
    efficiency: {motor.efficiency}
    rotor_inertia: {motor.rotor_inertia} kg.m2
    viscous_friction: {motor.viscous_friction} N.m.s/rad
  gear: {{type: Gear, ratio: 14, inertia: {gear.inertia} kg.m2}}
  shaft: {{type: SpringDamper, stiffness: {shaft.stiffness} N.m/rad, damping: {shaft.damping} N.m.s/rad}}
  load: {{type: Inertia, inertia: {load.inertia} kg.m2}}
  tacho: {{type: Tachometer, sensitivity: {tacho.sensitivity} V.s/rad}}

connect:
  - [source.out, motor.voltage]
  - [motor.shaft, gear.input, tacho.shaft]
  - [gear.output, shaft.a]
  - [shaft.b, load.shaft]
"""

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates on the load side: gear, load, and the rotor if its coupling gives."""
        m = Mechanism()
        output, load = m.coordinate("gear"), m.coordinate("load")
        fast = output.geared(self.fixed["gear.ratio"])
        rotor = m.coordinate("rotor") if COUPLING in laws else fast
        m.inertia(rotor, p["motor.rotor_inertia"])
        m.spring(rotor, 0.0, p["motor.viscous_friction"])
        m.inertia(output, p["gear.inertia"])
        m.inertia(load, p["load.inertia"])
        torque = p["motor.efficiency"] * p["motor.torque_constant"]
        m.motor(rotor, p["motor.resistance"], inductance, torque, p["motor.back_emf_constant"])
        laws.get(SHAFT, plain_spring)(m, output.against(load), p["shaft.stiffness"], p["shaft.damping"])
        if COUPLING in laws:
            laws[COUPLING](m, rotor.against(fast), 0.0, 0.0)
        ports = {
            "motor.shaft": rotor,
            "gear.input": fast,
            "gear.output": output,
            "shaft.a": output,
            "load.shaft": load,
            "shaft.b": load,
        }
        tacho = {i: p["tacho.sensitivity"] * c for i, c in fast.sense.items()}
        return Body(m, ports, {"tacho.out": Readout(tacho, 1), "load.shaft.angle": Readout(load.sense)})
