"""Harmonic drive with a flexible link: torque in; encoder on the rotor, position (or acceleration) of the tip out."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from benchmarks.concealed import beam
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
from benchmarks.concealed.plants.srv02 import ROOT, combined, flexible_link


class HarmonicArm(Plant):
    """Drive and arm of the size of [One-link n.d.]; the drive taken to be rigid and without friction."""

    name = "harmonic-arm"
    title = "Harmonic drive with a flexible link"
    drive = "drive.torque"
    drive_unit = "N.m"
    parameters = (
        Quantity("rotor.inertia", 1.0e-6, "kg.m2", 0.10),
        Quantity("gear.inertia", 2e-3, "kg.m2", 0.10),
        Quantity("link.mass", 0.234, "kg", 0.10),
        Quantity("link.flexural_rigidity", 1.42, "N.m2", 0.20),
        Quantity("link.hub_inertia", 4.9e-3, "kg.m2", 0.10),
        Quantity("link.damping_ratio", 0.02, "1", 0.50, spread=0.30),
    )
    fixed: Mapping[str, float] = MappingProxyType({"gear.ratio": 100.0, "link.length": 0.8})
    sensors = (
        Sensor("rotor.shaft.angle", "enc", "count", counts=40),
        Sensor("link.tip.position", "tip", "m", noise=1e-4),
        Sensor("link.tip.acceleration", "acc", "m/s2", noise=5e-2, extra=True),
    )
    sites = Sites(
        input="source.out -> drive.torque",
        shafts=(("rotor.shaft", "drive.shaft", "gear.input", "gear.output", "link.hub"),),
        joints=(ROOT,),
        links=("link",),
        sensors={
            "sensor_bias": ("link.tip.position",),
            "sensor_scale": ("link.tip.position",),
            "sensor_lag": ("link.tip.position", "rotor.shaft.angle"),
            "rectified_sensor": (),
        },
        extra={"extra_mode": ("link",), "inductance": ()},
    )
    excitation = Excitation(amplitude=3e-3, dwell=(0.15, 0.6), low=0.3, high=8.0, clock=0.06, resolution=1e-6)
    control = Control("rotor.shaft.angle", kp=1.6e-4, ki=0.0, kd=6e-5, reference=60.0, limit=2e-2)
    orders = (1, 2)
    main = "link.hub"
    blocks = """
  source: {{type: Step, height: 3 mN.m, stop: 1 s}}
  drive: {{type: Torque}}
  rotor: {{type: Inertia, inertia: {rotor.inertia} kg.m2}}
  gear: {{type: Gear, ratio: 100, inertia: {gear.inertia} kg.m2}}
  link:
    type: AssumedModesLink
    length: 0.8 m
    mass: {link.mass} kg
    flexural_rigidity: {link.flexural_rigidity} N.m2
    hub_inertia: {link.hub_inertia} kg.m2
    damping_ratio: {link.damping_ratio}
    modes: 1

connect:
  - [source.out, drive.torque]
  - [drive.shaft, rotor.shaft, gear.input]
  - [gear.output, link.hub]
"""

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates on the load side: hub, modes, and the gear if the drive gives."""
        m = Mechanism()
        hub = m.coordinate("hub")
        output = m.coordinate("gear") if ROOT in laws else hub
        rotor = output.geared(self.fixed["gear.ratio"])
        m.inertia(rotor, p["rotor.inertia"])
        m.inertia(output, p["gear.inertia"])
        m.inertia(hub, p["link.hub_inertia"])
        m.torque(rotor)
        length = self.fixed["link.length"]
        made = beam.modes(length, p["link.mass"], p["link.flexural_rigidity"], link.payload, link.modes)
        amplitudes = flexible_link(m, hub, made, p["link.damping_ratio"], link.centrifugal)
        if ROOT in laws:
            laws[ROOT](m, output.against(hub), 0.0, 0.0)
        fast = ("rotor.shaft", "drive.shaft", "gear.input")
        ports = dict.fromkeys(fast, rotor) | {"gear.output": output, "link.hub": hub}
        signals = {
            "rotor.shaft.angle": Readout(rotor.sense),
            "link.tip.position": combined(hub, length, amplitudes, made.tip),
            "link.tip.acceleration": combined(hub, length, amplitudes, made.tip, 2),
        }
        return Body(m, ports, signals)
