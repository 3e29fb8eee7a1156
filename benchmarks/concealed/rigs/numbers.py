"""Numbers for a topology: inertias that matter beside one another, springs that ring, motors of a sensible pace."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.rigs.topology import Topology

CLAMPED = 3.5160152685
"""(beta L)^2 of the first mode of a clamped uniform beam."""


def log_uniform(rng: Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def rounded(value: float) -> float:
    """Four significant digits, as on a data sheet."""
    return float(f"{value:.4g}")


@dataclass
class Numbers:
    """Values of the nominal parameters (SI) with their units, and values without a tolerance."""

    values: dict[str, float] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)

    def put(self, name: str, value: float, unit: str) -> None:
        """A parameter with a tolerance."""
        self.values[name], self.units[name] = rounded(value), unit

    def times(self, name: str, factor: float) -> None:
        """Scale one."""
        self.values[name] = rounded(self.values[name] * factor)


def draw(t: Topology, rng: Generator) -> Numbers:
    """Numbers for a topology; the size of its electrical units is left for later."""
    n = Numbers()
    speeds = _speeds(t)
    felt = _inertias(t, n, rng, speeds)
    _springs(t, n, rng, felt)
    total = sum(felt)
    for flange, name in t.bearings.items():
        at = total / speeds[t.node_of(flange)] ** 2
        pace = log_uniform(rng, 0.3, 3.0) * len(t.bearings)
        n.put(f"{name}.viscous_friction", at / pace, "N.m.s/rad" if t.turns(flange) else "N.s/m")
    if t.drive == "V":
        _motor(t, n, rng, total / speeds[0] ** 2)
    if t.drive == "A":
        n.put("amplifier.gain", 1.0, "N.m/A")
    for probe in t.probes:
        if probe.kind == "tacho":
            n.put("tacho.sensitivity", log_uniform(rng, 0.005, 0.2), "V.s/rad")
        elif probe.kind == "strain":
            n.put("gauge.sensitivity", log_uniform(rng, 0.3, 3.0), "V.m")
        elif probe.kind == "acceleration" and t.turns(probe.at):
            n.fixed["accelerometer.radius"] = round(float(rng.uniform(0.03, 0.3)), 3)
    return n


def _speeds(t: Topology) -> list[float]:
    """How fast each node is, in units of the last."""
    speeds = [1.0]
    for part in reversed(t.between):
        speeds.insert(0, speeds[0] * part.ratio)
    return speeds


def _inertias(t: Topology, n: Numbers, rng: Generator, speeds: list[float]) -> list[float]:
    """Inertias; returns those of all rigid bodies as the last node feels them, from the drive on."""
    base = log_uniform(rng, 0.3, 20.0) if t.slides else log_uniform(rng, 3e-5, 0.1)
    felt = [0.0] * len(t.nodes)
    for flange, body in t.bodies.items():
        index = t.node_of(flange)
        share = log_uniform(rng, 0.15, 1.5)
        felt[index] += base * share
        turns = t.turns(flange)
        key = "motor.rotor_inertia" if body == "motor" else f"{body}.{'inertia' if turns else 'mass'}"
        n.put(key, base * share / speeds[index] ** 2, "kg.m2" if turns else "kg")
    for index, part in enumerate(t.between, 1):
        if part.massive:
            share = log_uniform(rng, 0.02, 0.3)
            felt[index] += base * share
            n.put(f"{part.name}.inertia", base * share / speeds[index] ** 2, "kg.m2")
        if part.kind == "gear" and part.lossy:
            n.put(f"{part.name}.efficiency", rng.uniform(0.6, 0.95), "1")
    if t.link:
        arm, hub = base * log_uniform(rng, 0.5, 2.0), base * log_uniform(rng, 0.05, 0.5)
        length = round(float(rng.uniform(0.2, 0.9)), 3)
        mass, lowest = 3 * arm / length**2, log_uniform(rng, 1.5, 12.0)
        n.fixed["link.length"] = length
        n.put("link.mass", mass, "kg")
        n.put("link.flexural_rigidity", (2 * math.pi * lowest / CLAMPED) ** 2 * mass * length**3, "N.m2")
        n.put("link.hub_inertia", hub, "kg.m2")
        n.put("link.damping_ratio", log_uniform(rng, 0.005, 0.04), "1")
        felt[-1] += arm + hub
    return [sum(felt[i] for i in group) for group in t.groups()]


def _springs(t: Topology, n: Numbers, rng: Generator, felt: list[float]) -> None:
    """Each spring with the inertia on its two sides rings between 3 and 50 Hz; that of a gear sits at its output."""
    springs = [(index, part) for index, part in enumerate(t.between, 1) if part.gives]
    speeds = _speeds(t)
    for k, (index, part) in enumerate(springs):
        before, behind = sum(felt[: k + 1]), sum(felt[k + 1 :])
        inertia = before * behind / (before + behind) / speeds[index] ** 2
        stiffness = inertia * (2 * math.pi * log_uniform(rng, 3.0, 50.0)) ** 2
        n.put(f"{part.name}.stiffness", stiffness, "N/m" if t.slides else "N.m/rad")
        damping = 2 * rng.uniform(0.01, 0.08) * math.sqrt(stiffness * inertia)
        n.put(f"{part.name}.damping", damping, "N.s/m" if t.slides else "N.m.s/rad")


def _motor(t: Topology, n: Numbers, rng: Generator, inertia: float) -> None:
    """A motor that reaches its speed within 0.05 to 0.6 s; ``inertia`` is all that its shaft feels."""
    constant, efficiency = 0.02, 1.0 if t.lossless else float(rng.uniform(0.6, 0.95))
    resistance = log_uniform(rng, 0.05, 0.6) * efficiency * constant**2 / inertia
    n.put("motor.resistance", resistance, "ohm")
    n.put("motor.torque_constant", constant, "N.m/A")
    if not t.lossless:
        n.put("motor.back_emf_constant", constant, "V.s/rad")
        n.put("motor.efficiency", efficiency, "1")
    friction = efficiency * constant**2 / resistance * log_uniform(rng, 0.02, 0.2)
    n.put("motor.viscous_friction", friction, "N.m.s/rad")
    if t.winding:
        n.fixed["motor.inductance"] = rounded(resistance * log_uniform(rng, 3e-4, 4e-3))


def electrical(t: Topology, n: Numbers, factor: float) -> None:
    """Give the drive's unit another size: the same motion takes ``factor`` times the command."""
    if t.drive == "A":
        n.times("amplifier.gain", 1 / factor)
    if t.drive == "V":
        n.times("motor.torque_constant", factor)
        if not t.lossless:
            n.times("motor.back_emf_constant", factor)
        n.times("motor.resistance", factor**2)
        if t.winding:
            n.fixed["motor.inductance"] = rounded(n.fixed["motor.inductance"] * factor**2)


def far_off(n: Numbers, rng: Generator, tolerance: dict[str, float]) -> dict[str, float]:
    """In two rigs of five, one parameter whose data sheet is off by up to 30 %: of those that are known badly."""
    able = [name for name in n.values if 0.15 <= tolerance[name] < 0.25]
    return {str(rng.choice(able)): 0.30} if able and rng.random() < 0.4 else {}


def significant(rng: Generator, low: float, high: float) -> float:
    """A log-uniform number of two digits."""
    return float(np.format_float_positional(log_uniform(rng, low, high), precision=2, fractional=False))
