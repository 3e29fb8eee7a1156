"""The topology of a random rig: a chain of nodes, what lies between them, what hangs on them, and what is measured.

A node is a rigid connection of flanges in the order in which they follow one another along the shaft, so that a cut
between two of them says on which side each body and each sensor stays. A gear makes the nodes at its ends one rigid
body; a spring parts them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

DRIVES = {"V": "motor.voltage", "A": "amplifier.in", "N.m": "drive.torque", "N": "drive.force"}
"""Unit of the drive -> the input of the scenario that it is."""

TURNING = ("rotor", "hub", "load", "disc")
SLIDING = ("carriage", "table", "stage", "head")
"""Names of the bodies, from the drive on."""


@dataclass(frozen=True)
class Transmission:
    """What lies between two nodes.

    Attributes:
        kind: ``gear`` or ``spring``.
        name: of its block.
        ratio: reduction of a gear.
        lossy: whether a gear loses power.
        massive: whether a gear has an inertia of its own, on its output.
    """

    kind: str
    name: str
    ratio: float = 1.0
    lossy: bool = False
    massive: bool = False

    @property
    def ends(self) -> tuple[str, str]:
        """Flanges towards the drive and towards the load."""
        pair = ("input", "output") if self.kind == "gear" else ("a", "b")
        return (f"{self.name}.{pair[0]}", f"{self.name}.{pair[1]}")


@dataclass(frozen=True)
class Probe:
    """A sensor.

    Attributes:
        kind: ``angle``, ``speed``, ``tacho``, ``acceleration``, ``strain``, ``tip`` or ``tip_acceleration``.
        at: flange on which it truly sits; of a sensor that is a block, its own flange.
        read: flange at which the scenario reads it.
    """

    kind: str
    at: str
    read: str


@dataclass
class Topology:
    """What a rig consists of.

    Attributes:
        slides: whether its bodies slide; else they turn.
        drive: unit of the input: V, A, N.m or N.
        nodes: flanges of each, in their order along the shaft.
        between: what lies between a node and the next.
        bodies: flange -> block that has inertia there, save gears and the link.
        bearings: flange -> block of a viscous bearing.
        link: whether a flexible link hangs on the last node.
        winding: whether the scenario knows the winding's inductance.
        cuts: for each node after how many of its flanges it may be cut, with inertia left on both sides; 0 for never.
        probes: the sensors.
    """

    slides: bool
    drive: str
    nodes: list[list[str]] = field(default_factory=list)
    between: list[Transmission] = field(default_factory=list)
    bodies: dict[str, str] = field(default_factory=dict)
    bearings: dict[str, str] = field(default_factory=dict)
    link: bool = False
    winding: bool = False
    cuts: list[int] = field(default_factory=list)
    probes: list[Probe] = field(default_factory=list)

    @property
    def flange(self) -> str:
        """What the flange of a body is called."""
        return "flange" if self.slides else "shaft"

    def node_of(self, flange: str) -> int:
        """The node a flange belongs to."""
        return next(i for i, node in enumerate(self.nodes) if flange in node)

    def groups(self) -> list[list[int]]:
        """Nodes that are one rigid body: joined by gears."""
        found = [[0]]
        for i, part in enumerate(self.between):
            if part.kind == "spring":
                found.append([])
            found[-1].append(i + 1)
        return found

    def ratio(self, flange: str) -> float:
        """How far a flange moves while the last node of its rigid body moves by one."""
        index = self.node_of(flange)
        group = next(g for g in self.groups() if index in g)
        return float(np.prod([self.between[i].ratio for i in group if i >= index and i != group[-1]]))

    def losses(self, one: str, other: str) -> bool:
        """Whether a gear between two flanges of one rigid body loses power."""
        first, last = sorted((self.node_of(one), self.node_of(other)))
        return any(part.lossy for part in self.between[first:last])

    def masses(self, flange: str) -> bool:
        """Whether something with inertia hangs on a flange."""
        gears = {part.ends[1] for part in self.between if part.massive}
        return flange in self.bodies or flange in gears or flange == "link.hub"

    def cut(self, index: int) -> str:
        """The name of the connection of a node where it may be cut."""
        node, after = self.nodes[index], self.cuts[index]
        return f"{node[after - 1]} -> {node[after]}"


def draw(rng: Generator) -> Topology:
    """Draw a topology: see the module `benchmarks.concealed.rigs` for the shares."""
    slides = rng.random() < 0.25
    drive = "N" if slides else str(rng.choice(["V", "A", "N.m"], p=[0.5, 0.2, 0.3]))
    t = Topology(slides, drive, winding=drive == "V" and rng.random() < 0.4)
    count = int(rng.choice([1, 2, 3, 4], p=[0.1, 0.4, 0.3, 0.2]))
    t.link = not slides and count > 1 and rng.random() < 0.75
    _chain(t, count, rng)
    _bearings(t, rng)
    _probes(t, rng)
    t.cuts = [_cut(t, index, rng) for index in range(len(t.nodes))]
    return t


def _chain(t: Topology, count: int, rng: Generator) -> None:
    """Drive, bodies, and what joins each to the next: rigid, a gear, a spring, or a belt (a spring and a gear)."""
    names, gears, springs = (SLIDING if t.slides else TURNING), 0, 0
    t.nodes.append(["motor.shaft"] if t.drive == "V" else [f"drive.{t.flange}"])
    for k in range(count):
        flange = "link.hub" if t.link and k == count - 1 else f"{names[k]}.{t.flange}"
        if k == 0 and t.drive == "V":
            t.bodies["motor.shaft"] = "motor"
            continue
        if k:
            ways = ["rigid", "spring"] if t.slides else ["rigid", "gear", "spring", "belt"]
            shares = np.array([0.4, 0.6] if t.slides else [0.2, 0.45 if gears == 0 else 0.1, 0.2, 0.15])
            if springs == 2:
                shares[ways.index("spring")] = 0.0
                shares[-1] = 0.0
            way = str(rng.choice(ways, p=shares / shares.sum()))
            if way in ("spring", "belt"):
                name = ("mount" if t.slides else "belt" if way == "belt" else "coupling") + str(springs + 1)
                springs += 1
                _join(t, Transmission("spring", name))
            if way in ("gear", "belt"):
                gears += 1
                steep = way == "gear" and gears == 1
                ratio = round(float(np.exp(rng.uniform(0, np.log(200 if steep else 4)))), 2)
                lossy, massive = bool(rng.random() < 0.4), bool(rng.random() < 0.5)
                _join(t, Transmission("gear", f"gear{gears}", ratio, lossy, massive))
        t.nodes[-1].append(flange)
        if flange != "link.hub":
            t.bodies[flange] = flange.partition(".")[0]


def _join(t: Topology, part: Transmission) -> None:
    t.nodes[-1].append(part.ends[0])
    t.nodes.append([part.ends[1]])
    t.between.append(part)


def _bearings(t: Topology, rng: Generator) -> None:
    """Viscous bearings; where no motor brakes, nearly always one at least."""
    carried = [flange for node in t.nodes for flange in node if t.masses(flange)]
    chosen = [flange for flange in carried if rng.random() < 0.35 and flange != "motor.shaft"]
    if not chosen and t.drive != "V" and rng.random() < 0.85:
        chosen = [carried[int(rng.integers(len(carried)))]]
    for k, beside in enumerate(chosen, 1):
        name = f"guide{k}.slide" if t.slides else f"bearing{k}.shaft"
        _insert(t, name, beside, rng)
        t.bearings[name] = name.partition(".")[0]


def _insert(t: Topology, flange: str, beside: str, rng: Generator) -> None:
    """Put a flange before or after another of its node, never before the drive."""
    node = t.nodes[t.node_of(beside)]
    index = node.index(beside)
    node.insert(index + 1 if index == 0 or rng.random() < 0.5 else index, flange)


def _probes(t: Topology, rng: Generator) -> None:
    """One sensor of motion first, then up to two further ones, on drawn bodies."""
    carried = [flange for node in t.nodes for flange in node if t.masses(flange)]
    motion = ["angle", "angle", "angle", "speed"] + ([] if t.slides else ["tacho"])
    more = ["angle", "speed", "acceleration"] + ([] if t.slides else ["tacho"])
    if t.link:
        more += ["strain", "strain", "tip", "tip_acceleration"]
    taken: set[str] = set()
    for k in range(1 + int(rng.choice([0, 1, 2], p=[0.35, 0.45, 0.2]))):
        kind = str(rng.choice(more if k else motion))
        beside = carried[int(rng.integers(len(carried)))]
        group = next(g for g in t.groups() if t.node_of(beside) in g)
        key = kind if kind in ("strain", "tip", "tip_acceleration", "tacho", "acceleration") else f"{kind} {group}"
        if key in taken:
            continue
        taken.add(key)
        if kind in ("strain", "tip", "tip_acceleration"):
            t.probes.append(Probe(kind, "link.hub", "link.hub"))
        elif kind in ("tacho", "acceleration"):
            flange = "tacho.shaft" if kind == "tacho" else f"accelerometer.{t.flange}"
            _insert(t, flange, beside, rng)
            t.probes.append(Probe(kind, flange, flange))
        else:
            node = [f for f in t.nodes[t.node_of(beside)] if f.partition(".")[0] not in ("tacho", "accelerometer")]
            read = str(rng.choice(node)) if rng.random() < 0.5 else beside
            t.probes.append(Probe(kind, beside, read))


def _cut(t: Topology, index: int, rng: Generator) -> int:
    """After how many flanges a node may be cut, with inertia on both sides in its rigid body; 0 for nowhere."""
    group = next(g for g in t.groups() if index in g)
    node = t.nodes[index]
    before = any(t.masses(f) for i in group if i < index for f in t.nodes[i])
    behind = any(t.masses(f) for i in group if i > index for f in t.nodes[i])
    able = [
        k
        for k in range(1, len(node))
        if (before or any(map(t.masses, node[:k]))) and (behind or any(map(t.masses, node[k:])))
    ]
    return int(rng.choice(able)) if able else 0
