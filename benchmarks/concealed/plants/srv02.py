"""SRV02 servo motor in high gear with a flexible link: voltage in; encoder and strain gauge out."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from benchmarks.concealed import beam
from benchmarks.concealed.mechanism import Mechanism, Port, Readout, Whirl
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

COUPLING, ROOT = "motor.shaft -> gear.input", "gear.output -> link.hub"


def flexible_link(
    mechanism: Mechanism, hub: Port, made: beam.Modes, damping_ratio: float, centrifugal: bool
) -> list[Port]:
    """Put an arm on a hub; returns its modes' coordinates."""
    mechanism.inertia(hub, made.inertia)
    amplitudes = []
    for i, frequency in enumerate(made.frequency):
        a = mechanism.coordinate(f"mode{i + 1}")
        mechanism.inertia(a, 1.0)
        mechanism.couple(hub, a, float(made.coupling[i]))
        mechanism.spring(a, float(frequency**2), 2 * damping_ratio * float(frequency))
        amplitudes.append(a)
    if centrifugal:
        mechanism.whirl = Whirl(hub, amplitudes, made.softening - made.stiffening)
    return amplitudes


def combined(hub: Port, factor: float, amplitudes: list[Port], weights: np.ndarray, order: int = 0) -> Readout:
    """factor times the hub's angle plus weighted amplitudes."""
    sense = {i: factor * c for i, c in hub.sense.items()}
    for port, weight in zip(amplitudes, weights, strict=True):
        for i, c in port.sense.items():
            sense[i] = sense.get(i, 0.0) + float(weight) * c
    return Readout(sense, order)


class Srv02Flexible(Plant):
    """Motor torque eta kt i through gear 70 with efficiency, link of 0.419 m whose clamped mode is at 3 Hz."""

    name = "srv02-flexible"
    title = "SRV02 motor in high gear with a flexible link"
    drive = "motor.voltage"
    drive_unit = "V"
    parameters = (
        Quantity("motor.resistance", 2.6, "ohm", 0.15),
        Quantity("motor.torque_constant", 7.68e-3, "N.m/A", 0.15),
        Quantity("motor.back_emf_constant", 7.68e-3, "V.s/rad", 0.15),
        Quantity("motor.efficiency", 0.69, "1", 0.10, ceiling=1.0),
        Quantity("motor.rotor_inertia", 4.606e-7, "kg.m2", 0.10),
        Quantity("gear.efficiency", 0.9, "1", 0.10, ceiling=0.99),
        Quantity("gear.inertia", 5.282e-5, "kg.m2", 0.10),
        Quantity("link.mass", 0.065, "kg", 0.10),
        Quantity("link.flexural_rigidity", 0.137422, "N.m2", 0.20),
        Quantity("link.damping_ratio", 0.02, "1", 0.50, spread=0.30),
        Quantity("gauge.sensitivity", 1.0, "V.m", 0.10),
    )
    fixed: Mapping[str, float] = MappingProxyType({"gear.ratio": 70.0, "link.length": 0.419})
    sensors = (
        Sensor("link.hub.angle", "enc", "count", counts=4096),
        Sensor("gauge.out", "strain", "V", noise=5e-3),
    )
    sites = Sites(
        input="source.out -> motor.voltage",
        shafts=(("motor.shaft", "gear.input", "gear.output", "link.hub"),),
        joints=(ROOT, COUPLING),
        links=("link",),
        sensors={
            "sensor_bias": ("gauge.out",),
            "sensor_lag": ("gauge.out", "link.hub.angle"),
            "rectified_sensor": ("gauge.out",),
        },
        extra={"viscous_friction": (), "payload": (), "extra_mode": ("link",)},
    )
    excitation = Excitation(amplitude=3.0, dwell=(0.15, 0.6), low=0.3, high=12.0, clock=0.06, resolution=1e-3)
    control = Control("link.hub.angle", kp=6.0, ki=0.0, kd=0.25, reference=0.8, limit=6.0)
    main = "link.hub"
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
  gear: {{type: Gear, ratio: 70, efficiency: {gear.efficiency}, inertia: {gear.inertia} kg.m2}}
  link:
    type: AssumedModesLink
    length: 0.419 m
    mass: {link.mass} kg
    flexural_rigidity: {link.flexural_rigidity} N.m2
    damping_ratio: {link.damping_ratio}
    modes: 1
  gauge: {{type: StrainGauge, sensitivity: {gauge.sensitivity} V.m}}

connect:
  - [source.out, motor.voltage]
  - [motor.shaft, gear.input]
  - [gear.output, link.hub]
  - [link.root.curvature, gauge.curvature]
"""

    def assemble(
        self, p: Mapping[str, float], laws: Mapping[str, JointLaw], link: LinkOptions, inductance: float
    ) -> Body:
        """Coordinates on the load side: hub, modes, and one more for each joint that gives."""
        m = Mechanism()
        hub = m.coordinate("hub")
        output = m.coordinate("gear") if ROOT in laws else hub
        fast = output.geared(self.fixed["gear.ratio"], p["gear.efficiency"])
        rotor = m.coordinate("rotor") if COUPLING in laws else fast
        m.inertia(rotor, p["motor.rotor_inertia"])
        m.inertia(output, p["gear.inertia"])
        torque = p["motor.efficiency"] * p["motor.torque_constant"]
        m.motor(rotor, p["motor.resistance"], inductance, torque, p["motor.back_emf_constant"])
        made = beam.modes(
            self.fixed["link.length"], p["link.mass"], p["link.flexural_rigidity"], link.payload, link.modes
        )
        amplitudes = flexible_link(m, hub, made, p["link.damping_ratio"], link.centrifugal)
        for place, inner, outer in ((ROOT, output, hub), (COUPLING, rotor, fast)):
            if place in laws:
                laws[place](m, inner.against(outer), 0.0, 0.0)
        ports = {"motor.shaft": rotor, "gear.input": fast, "gear.output": output, "link.hub": hub}
        signals = {
            "link.hub.angle": Readout(hub.sense),
            "gauge.out": combined(hub, 0.0, amplitudes, p["gauge.sensitivity"] * made.curvature),
        }
        return Body(m, ports, signals)
