"""Pendulum on a small gear: torque in, also none (free decay); encoder on the arm, and a gyroscope if wanted."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from benchmarks.concealed import native
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
)

CLAMP = "gear.output -> arm.shaft"
G = 9.81


class Pendulum(Plant):
    """Arm of the size of [Mohan 2010, Table 1], driven by belt, undamped as the simplest model has it."""

    name = "pendulum"
    title = "Pendulum driven by belt"
    drive = "drive.torque"
    drive_unit = "N.m"
    parameters = (
        Quantity("rotor.inertia", 8e-6, "kg.m2", 0.10),
        Quantity("arm.inertia", 6.5e-3, "kg.m2", 0.10),
        Quantity("weight.mass", 0.18, "kg", 0.10),
        Quantity("weight.radius", 0.165, "m", 0.10),
    )
    fixed: Mapping[str, float] = MappingProxyType({"gear.ratio": 10.0})
    sensors = (
        Sensor("arm.shaft.angle", "enc", "count", counts=4096),
        Sensor("arm.shaft.speed", "gyro", "rad/s", noise=2e-2, extra=True),
    )
    sites = Sites(
        input="source.out -> drive.torque",
        shafts=(("arm.shaft", "weight.shaft", "gear.output", "gear.input", "rotor.shaft", "drive.shaft"),),
        joints=(CLAMP,),
        sensors={
            "sensor_bias": ("arm.shaft.speed",),
            "sensor_scale": ("arm.shaft.angle",),
            "sensor_lag": ("arm.shaft.angle", "arm.shaft.speed"),
            "rectified_sensor": ("arm.shaft.speed",),
        },
        extra={"gravity": (), "inductance": ()},
    )
    excitation = Excitation(
        amplitude=1.2e-2, dwell=(0.25, 0.8), low=0.3, high=6.0, clock=0.12, resolution=1e-6, reach=1.8
    )
    control = Control("arm.shaft.angle", kp=0.05, ki=0.0, kd=4e-3, reference=0.7, limit=0.06)
    orders = (2, 3, 6)
    swings = True
    main = "arm.shaft"
    blocks = """
  source: {{type: Step, height: 10 mN.m, stop: 1 s}}
  drive: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {rotor.inertia} kg.m2}}
  gear: {{type: Gear, ratio: 10}}
  arm: {{type: Inertia, inertia: {arm.inertia} kg.m2}}
  weight: {{type: GravityTorque, mass: {weight.mass} kg, radius: {weight.radius} m}}

connect:
  - [source.out, drive.torque]
  - [drive.shaft, rotor.shaft, gear.input]
  - [gear.output, arm.shaft, weight.shaft]
"""

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates on the load side: the arm, and the gear if it gives."""
        m = Mechanism()
        arm = m.coordinate("arm")
        output = m.coordinate("gear") if CLAMP in laws else arm
        rotor = output.geared(self.fixed["gear.ratio"])
        m.inertia(rotor, p["rotor.inertia"])
        m.inertia(arm, p["arm.inertia"])
        m.torque(rotor)
        m.add(native.GRAVITY, arm, p["weight.mass"] * G * p["weight.radius"], 0.0)
        if CLAMP in laws:
            laws[CLAMP](m, output.against(arm), 0.0, 0.0)
        fast = dict.fromkeys(("rotor.shaft", "drive.shaft", "gear.input"), rotor)
        ports = fast | {"gear.output": output, "arm.shaft": arm, "weight.shaft": arm}
        signals = {"arm.shaft.angle": Readout(arm.sense), "arm.shaft.speed": Readout(arm.sense, 1)}
        return Body(m, ports, signals)
