"""The topology of a random rig: a chain of nodes, what lies between them, what hangs on them, and what is measured.

A node is a rigid connection of flanges in the order in which they follow one another along the shaft, so that a cut
between two of them says on which side each body and each sensor stays. A gear or a pulley makes the nodes at its ends
one rigid body; a spring, a toothed belt or an elastic gear parts them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

DRIVES = {"V": "motor.voltage", "A": "amplifier.in", "N.m": "drive.torque", "N": "drive.force"}
"""Unit of the drive -> the input of the scenario that it is."""

TURNING = ("rotor", "hub", "load", "disc")
SLIDING = ("carriage", "table", "stage", "head")
"""Names of the bodies, from the drive on."""

PARTS = ("belt", "motor", "gear")
"""What a rig can be asked to have, for effects of drives that need it: a motor that pulls a slide by pulley and toothed
belt, a motor of which all losses are counted, an elastic gear behind the first body."""

FLANGES = {"gear": ("input", "output"), "mesh": ("input", "output"), "pulley": ("shaft", "slide")}
"""Flanges towards the drive and towards the load, by kind; else a and b."""


@dataclass(frozen=True)
class Transmission:
    """What lies between two nodes.

    Attributes:
        kind: ``gear``, ``spring``, ``mesh`` (an elastic gear), ``pulley`` or ``belt`` (a toothed one, that moves).
        name: of its block.
        ratio: reduction of a gear; of a pulley 1 / radius (1/m).
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
        pair = FLANGES.get(self.kind, ("a", "b"))
        return (f"{self.name}.{pair[0]}", f"{self.name}.{pair[1]}")

    @property
    def gives(self) -> bool:
        """Whether it is elastic."""
        return self.kind in ("spring", "mesh", "belt")


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


@dataclass(frozen=True)
class Piece:
    """What a cut leaves of a node.

    Attributes:
        flanges: in their order.
        beside: number of the piece that it was cut from; its own for the one to begin with.
        place: of the cut between them; empty for the one to begin with.
        far: whether this piece is on the cut's far side.
    """

    flanges: tuple[str, ...]
    beside: int = 0
    place: str = ""
    far: bool = False


@dataclass
class Topology:
    """What a rig consists of.

    Attributes:
        slides: whether its bodies slide; else they turn.
        pulled: whether the first of bodies that slide turns, and pulls the others by pulley and belt.
        lossless: whether a motor has no losses but those of its winding and its bearing, one constant, and no known
            inductance: the truth has heat in a winding whose current follows at once.
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
    pulled: bool = False
    lossless: bool = False

    def turns(self, flange: str) -> bool:
        """Whether a flange turns."""
        return not self.slides or (self.pulled and self.node_of(flange) == 0)

    def body(self, index: int) -> str:
        """The flange of a body, counted from the drive."""
        if not self.slides or (self.pulled and index == 0):
            return f"{TURNING[index]}.shaft"
        return f"{SLIDING[index]}.flange"

    def node_of(self, flange: str) -> int:
        """The node a flange belongs to."""
        return next(i for i, node in enumerate(self.nodes) if flange in node)

    def groups(self) -> list[list[int]]:
        """Nodes that are one rigid body: joined by gears."""
        found = [[0]]
        for i, part in enumerate(self.between):
            if part.gives:
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

    def far(self, index: int) -> frozenset[str]:
        """The flanges behind that cut."""
        return frozenset(self.nodes[index][self.cuts[index] :])

    def joined(self, place: str) -> int | None:
        """The node that a joint ``X -> Y`` would cut; None if its flanges are not in one."""
        ends = place.split(" -> ")
        return next((i for i, node in enumerate(self.nodes) if len(ends) == 2 and {*ends} <= {*node}), None)

    def far_sides(self, index: int, place: str) -> list[frozenset[str]]:
        """Every far side that a joint ``X -> Y`` of a node may have: Y is its first, and X stays on the near side."""
        inner, outer = place.split(" -> ")
        node = self.nodes[index]
        more = [f for f in node[node.index(outer) + 1 :] if f != inner]
        return [frozenset((outer, *chosen)) for n in range(len(more) + 1) for chosen in itertools.combinations(more, n)]

    def pieces(self, index: int, cuts: Mapping[str, frozenset[str]]) -> list[Piece]:
        """What several cuts leave of a node: first the piece of its last flange, each other one beside an earlier one.

        Pieces differ in the cuts on whose far side they are, and neighbours in one cut.

        Args:
            index: which node.
            cuts: place -> flanges on the far side.

        Raises:
            ValueError: the cuts cross, or two of them are the same.
        """
        node = self.nodes[index]
        side = {f: frozenset(place for place, far in cuts.items() if f in far) for f in node}
        sides = list(dict.fromkeys(side[f] for f in reversed(node)))
        found = {sides[0]: Piece(_alike(side, sides[0]))}
        waiting = [sides[0]]
        for k, here in enumerate(waiting):  # grows as neighbours are found
            for there in sides:
                if there not in found and len(between := here ^ there) == 1:
                    (place,) = between
                    found[there] = Piece(_alike(side, there), k, place, place in there)
                    waiting.append(there)
        if len(found) < len(sides) or sorted(piece.place for piece in found.values() if piece.place) != sorted(cuts):
            raise ValueError(f"{' and '.join(cuts)} do not part {', '.join(node)}")
        return list(found.values())


def _alike(side: Mapping[str, frozenset[str]], mine: frozenset[str]) -> tuple[str, ...]:
    return tuple(f for f, far in side.items() if far == mine)


def draw(rng: Generator, part: str = "") -> Topology:
    """Draw a topology: see the module `benchmarks.concealed.rigs` for the shares.

    Args:
        rng: of the rig; one that is asked to have something has a stream of its own.
        part: one of `PARTS`, or nothing.
    """
    slides = rng.random() < 0.25 and not part
    drive = "N" if slides else str(rng.choice(["V", "A", "N.m"], p=[0.5, 0.2, 0.3]))
    drive = "V" if part == "motor" else drive
    pulled = part == "belt"
    t = Topology(slides or pulled, drive, winding=drive == "V" and rng.random() < 0.4 and part != "motor")
    t.pulled, t.lossless = pulled, part == "motor"
    count = int(rng.choice([1, 2, 3, 4], p=[0.1, 0.4, 0.3, 0.2]))
    count = max(count, 2) if part in ("belt", "gear") else count
    t.link = not t.slides and count > 1 and rng.random() < 0.75
    _chain(t, count, rng, elastic=part == "gear")
    _bearings(t, rng)
    _probes(t, rng)
    t.cuts = [_cut(t, index, rng) for index in range(len(t.nodes))]
    return t


def _chain(t: Topology, count: int, rng: Generator, elastic: bool) -> None:
    """Drive, bodies, and what joins each to the next: rigid, a gear, a spring, or a belt (a spring and a gear).

    The first joint is a pulley with a toothed belt, or an elastic gear, where that is asked for.
    """
    gears, springs = 0, 0
    t.nodes.append(["motor.shaft"] if t.drive == "V" else ["drive.flange" if t.drive == "N" else "drive.shaft"])
    for k in range(count):
        flange = "link.hub" if t.link and k == count - 1 else t.body(k)
        if k == 0 and t.drive == "V":
            t.bodies["motor.shaft"] = "motor"
            continue
        if k == 1 and t.pulled:
            springs += 1
            _join(t, Transmission("pulley", "pulley", 1 / round(float(np.exp(rng.uniform(*np.log(RADII)))), 4)))
            _join(t, Transmission("belt", "belt"))
        elif k == 1 and elastic:
            gears, springs = 1, 1
            ratio = round(float(np.exp(rng.uniform(*np.log(ELASTIC)))), 2)
            _join(t, Transmission("mesh", "gear1", ratio, massive=bool(rng.random() < 0.5)))
        elif k:
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


RADII, ELASTIC = (0.008, 0.04), (3.0, 160.0)
"""Radius of a pulley (m), and ratio of an elastic gear: from a planetary stage to a strain-wave gear."""


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
        name = f"bearing{k}.shaft" if t.turns(beside) else f"guide{k}.slide"
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
            flange = "tacho.shaft" if kind == "tacho" else f"accelerometer.{'shaft' if t.turns(beside) else 'flange'}"
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
