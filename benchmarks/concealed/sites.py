"""Which effects each plant can hide, where, and how large things are there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed.bench import Bench
from benchmarks.concealed.effects import BEAM_MODE, CATALOGUE, COGGING, DRIVES, MESHING, Effect, Scales
from benchmarks.concealed.mechanism import Mechanism, Port, Readout
from benchmarks.concealed.plants.base import Body, LinkOptions, Plant
from benchmarks.concealed.simulator import Simulator
from benchmarks.concealed.truth import Truth, winding

WOUND = frozenset({"current_limit", "supply_sag", "warm_up", "dead_time"})
"""Effects whose size goes by the current of a motor."""

DRIVEN = ("motor.shaft", "drive.shaft")
"""Flanges of what drives."""


DECLARED = frozenset({"belt_slack", "end_stop", "warm_up", "friction_warm_up", "transmission_error"})
"""Effects of drives that need what few plants have: a belt, a range that ends, a motor whose losses are all counted, a
bearing of its own, an elastic gear."""

RESOLVED = 6
"""Samples for each wave of a shaft that turns as fast as it does on average."""


@dataclass(frozen=True)
class Site:
    """An effect at a place of a plant.

    Attributes:
        effect: from the catalogue.
        place: its name in the block diagram.
        same: other names of the same place: flanges that move together, or the port an input belongs to.
    """

    effect: Effect
    place: str
    same: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.effect.name}@{self.place}"


def sites(plant: Plant, extra: bool = False) -> list[Site]:
    """Every effect of the catalogue at every place of a plant where it makes sense; the usual place first.

    Args:
        plant: which.
        extra: also those on sensors that are recorded only when asked for.
    """
    found: list[Site] = []
    s = plant.sites
    groups = {group[0]: group for group in s.shafts}
    for effect in CATALOGUE.values():
        if effect.only and plant.drive_unit not in effect.only:
            continue
        places = s.extra.get(effect.name)
        if effect.name == "inductance" and places is None:
            places = ("motor",)
        elif effect.name == "structural_damping" and places is None:
            places = s.springs
        elif places is None:
            by_kind = {
                "input": (s.input,),
                "shaft": tuple(groups),
                "joint": (*s.springs, *s.joints),
                "link": s.links,
                "sensor": s.sensors.get(effect.name, ()),
            }
            places = by_kind[effect.kind]
        for place in places:
            if effect.kind == "sensor" and plant.sensor(place).extra and not extra:
                continue
            chosen = BEAM_MODE if effect.name == "extra_mode" and place in s.links else effect
            found.append(Site(chosen, place, _same(plant, effect, place)))
    return found


def drive_sites(plant: Plant) -> list[Site]:
    """Every effect of a drive at the place of a plant where it makes sense: its motor's shaft, or its input.

    Those of `DECLARED` are there only where a plant says so.
    """
    shaft = next((f for group in plant.sites.shafts for f in group if f in DRIVEN), "")
    found = []
    for effect in DRIVES.values():
        usual = plant.sites.input if effect.kind == "input" else shaft
        places = plant.sites.extra.get(effect.name, () if effect.name in DECLARED or not usual else (usual,))
        for place in places:
            if not (effect.only and plant.drive_unit not in effect.only):
                found.append(Site(effect, place, _same(plant, effect, place)))
    return found


def _same(plant: Plant, effect: Effect, place: str) -> tuple[str, ...]:
    if effect.name == "inductance":
        return ("motor.voltage", plant.sites.input)
    if place in plant.sites.same:
        return plant.sites.same[place]
    if effect.kind == "input":
        return tuple(place.split(" -> "))
    if effect.kind == "joint" and " -> " in place:
        return tuple(place.split(" -> "))
    if effect.kind == "joint":
        return (f"{place}.a", f"{place}.b")
    if effect.kind == "shaft":
        found = next((tuple(x for x in group if x != place) for group in plant.sites.shafts if place in group), ())
        if effect.name in ("torque_ripple", "gravity", "cogging"):
            # They go by the angle itself: behind a gear the same law is another one.
            found = tuple(x for x in found if plant.ratio(x) == plant.ratio(place))
        return found
    return ()


def find(plant: Plant, text: str) -> Site:
    """A site from ``effect`` or ``effect@place``; without a place the usual one.

    Raises:
        ValueError: the plant cannot hide it, or not there.
    """
    name, _, place = text.partition("@")
    able = [*sites(plant, extra=True), *drive_sites(plant)]
    mine = [s for s in able if s.effect.name == name]
    if not mine:
        known = sorted({s.effect.name for s in able})
        raise ValueError(f"{plant.name} cannot hide '{name}'; it can hide {', '.join(known)}")
    chosen = [s for s in mine if not place or place == s.place or place in s.same]
    if not chosen:
        raise ValueError(f"{plant.name} has no '{name}' at '{place}'; it has {', '.join(map(str, mine))}")
    return chosen[0]


def scales(bench: Bench, truth: Truth, site: Site) -> Scales:
    """Sizes at a site, from the bare truth on the bench's commands."""
    plant, kind = truth.plant, site.effect.kind
    command = max(float(np.abs(c).max()) for c in bench.commands)
    if kind in ("input", "link"):
        return Scales(command=command, current=_current(bench, truth) if site.effect.name in WOUND else 1.0)
    if kind == "sensor":
        k = bench.signals.index(site.place)
        values = np.concatenate([y[:, k] for y in bench.outputs(truth.bare())]) * bench.sigma[k]
        return Scales(command=command, signal=float(np.sqrt(np.mean(values**2))))
    body = plant.assemble(truth.parameters, {}, LinkOptions(), 0.0)
    if kind == "shaft":
        port = body.ports[site.place]
        angle, speed, torque = _motion(bench, body, port, _inertia(body.mechanism, port))
        seen = tuple(k for k in COGGING if _seen(k * speed, bench))
        if site.effect.name == "cogging" and not seen:
            raise ValueError(f"{site}: its waves pass faster than the recordings show")
        inertia = _inertia(body.mechanism, port)
        bearing = truth.parameters.get(f"{site.place.partition('.')[0]}.viscous_friction", 0.0)
        return Scales(command, torque, speed, angle, inertia, orders=plant.orders, cogging=seen, damping=bearing)
    return _joint(bench, truth, site, body, command)


def _seen(rate: float, bench: Bench) -> bool:
    """Whether samples show a wave (rad/s)."""
    return rate * bench.interval < 2 * math.pi / RESOLVED


def _current(bench: Bench, truth: Truth) -> float:
    """The largest current that the commands draw through the motor's winding."""
    body = truth.plant.assemble(truth.parameters, {}, LinkOptions(), 0.0)
    readout = Readout(body.ports["motor.shaft"].sense, 1)
    made = Simulator(body.mechanism, [readout], bench.interval, _substeps(bench.interval))
    resistance, back_emf = winding(truth)
    drops = [command - back_emf * made.run(command).clean[:, 0] for command in bench.commands]
    return max(float(np.abs(drop).max()) for drop in drops) / resistance


def _joint(bench: Bench, truth: Truth, site: Site, body: Body, command: float) -> Scales:
    """A spring that is there, or a connection that is rigid: then the torque that it carries to its far side."""
    plant, place = truth.plant, site.place
    held: list[tuple[Port, float, float]] = []

    def note(mechanism: Mechanism, port: Port, stiffness: float, damping: float) -> None:
        held.append((port, stiffness, damping))

    split = plant.assemble(truth.parameters, {place: note}, LinkOptions(), 0.0)
    port, stiffness, damping = held[0]
    lighter = _inertia(split.mechanism, port)
    if stiffness:
        split.mechanism.spring(port, stiffness, damping)
        twist, _, _ = _motion(bench, split, port, lighter, spread=False)
        made = Scales(
            command, stiffness * twist, 1.0, twist, lighter, stiffness=stiffness, damping=damping, orders=plant.orders
        )
        if plant.habits.hidden and site.effect.name == "belt_slack":
            made = replace(made, largest=stiffness * _largest(bench, split, port))
        return replace(made, meshing=_meshing(bench, body, site)) if place in body.meshes else made
    inner, outer = place.split(" -> ")
    far = _inertia(split.mechanism, split.ports[outer])
    angle, speed, torque = _motion(bench, body, body.ports[inner], far)
    return Scales(command, torque, speed, angle, lighter, orders=plant.orders)


def _meshing(bench: Bench, body: Body, site: Site) -> tuple[int, ...]:
    """Orders of a gear's error whose waves the recordings show."""
    _, speed, _ = _motion(bench, body, body.meshes[site.place][0], 0.0)
    seen = tuple(k for k in MESHING if _seen(k * speed, bench))
    if not seen:
        raise ValueError(f"{site}: its waves pass faster than the recordings show")
    return seen


def _inertia(mechanism: Mechanism, port: Port) -> float:
    """Inertia felt at a port: torque over acceleration."""
    size = len(mechanism.names)
    act, sense = np.zeros(size), np.zeros(size)
    for i, c in port.act.items():
        act[i] += c
    for i, c in port.sense.items():
        sense[i] += c
    return float(1 / (sense @ np.linalg.solve(mechanism.mass_matrix(), act)))


def _motion(bench: Bench, body: Body, port: Port, inertia: float, spread: bool = True) -> tuple[float, float, float]:
    """Range (or root mean square) of the angle, and root mean square of speed and inertial torque, at a port."""
    made = Simulator(
        body.mechanism, [Readout(port.sense, order) for order in range(3)], bench.interval, _substeps(bench.interval)
    )
    y = np.concatenate([made.run(command).clean for command in bench.commands])
    rms = np.sqrt(np.mean(y**2, axis=0))
    size = float(np.ptp(y[:, 0])) if spread else float(rms[0])
    return size, float(rms[1]), inertia * float(rms[2])


def _largest(bench: Bench, body: Body, port: Port) -> float:
    """Largest angle at a port, from where each recording begins."""
    made = Simulator(body.mechanism, [Readout(port.sense)], bench.interval, _substeps(bench.interval))
    runs = zip(bench.commands, bench.released, strict=True)
    return max(float(np.abs(made.run(u, initial=made.at(angle)).clean).max()) for u, angle in runs)


def _substeps(interval: float) -> int:
    return max(1, math.ceil(interval / 2.5e-4))
