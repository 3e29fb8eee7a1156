"""A scenario's wiring as a graph to draw: blocks in frames, and nets that run from one end to others."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from engine.errors import FlexarmError
from engine.system import System
from scenarios.schema import FrequencyRecording

if TYPE_CHECKING:
    from scenarios.load import Scenario

FLANGE, SIGNAL = "flange", "signal"
DRIVEN, MEASURED, RECORDED = "driven", "measured", "recorded"

_OUTWARD = ("output", "b", "tip")
_INWARD = ("input", "a", "hub")


@dataclass(frozen=True)
class End:
    """One end of a net: a block and the name of its port, or of a signal that is taken from it."""

    block: str
    port: str

    @property
    def name(self) -> str:
        """As a scenario file writes it."""
        return f"{self.block}.{self.port}"


@dataclass(frozen=True)
class Net:
    """What joins ends: a signal from its source, or flanges that share their motion, drawn from one of them."""

    kind: str
    source: End
    targets: tuple[End, ...]
    unit: str = ""

    @property
    def ends(self) -> tuple[End, ...]:
        """All ends, the source first."""
        return (self.source, *self.targets)


@dataclass(frozen=True)
class Mark:
    """A signal of a block that is recorded, measured or driven from a recording."""

    kind: str
    port: str


@dataclass
class Graph:
    """What to draw.

    Attributes:
        name: of the scenario.
        blocks: name -> type; a name with dots lies in frames.
        kinds: name -> the folder of the library that the block belongs to, such as ``sources``.
        nets: connections.
        marks: block -> what is recorded there.
    """

    name: str
    blocks: dict[str, str]
    kinds: dict[str, str] = field(default_factory=dict)
    nets: list[Net] = field(default_factory=list)
    marks: dict[str, list[Mark]] = field(default_factory=dict)


def graph(scenario: Scenario) -> Graph:
    """The graph of a scenario's blocks, connections and recorded signals."""
    system = scenario.system
    made = Graph(
        scenario.name,
        {name: type(block).__name__ for name, block in system.blocks.items()},
        {name: _kind(type(block).__module__) for name, block in system.blocks.items()},
    )
    made.nets = [*_signals(system), *_flanges(system)]
    _mark(made, scenario)
    return made


def _kind(module: str) -> str:
    parts = module.split(".")
    return parts[1] if parts[0] == "blocks" and len(parts) > 1 else parts[0]


def _end(system: System, name: str) -> End:
    return End(*system.split(name))


def _signals(system: System) -> list[Net]:
    """Signals grouped by what they come from."""
    groups: dict[str, list[str]] = {}
    for connection in system.connections:
        ends = [end for end in connection.ends if not system.is_flange(end)]
        sources = [end for end in ends if not system.is_input(end)]
        if len(ends) == len(connection.ends) and sources:
            groups.setdefault(sources[0], []).extend(end for end in ends if end != sources[0])
    nets = []
    for source, targets in groups.items():
        known = [_end(system, t) for t in dict.fromkeys(targets)]
        units = [system.blocks[e.block].ports[e.port].unit for e in known if e.port in system.blocks[e.block].ports]
        unit = next((u for u in units if u not in ("*", "")), "")
        nets.append(Net(SIGNAL, _end(system, source), tuple(known), unit))
    return nets


def _flanges(system: System) -> list[Net]:
    """Flanges that share a motion, each group drawn from the end that lies nearest to what drives the mechanism."""
    groups: list[set[str]] = []
    for connection in system.connections:
        ends = {end for end in connection.ends if system.is_flange(end)}
        if len(ends) < 2:
            continue
        touching = [g for g in groups if g & ends]
        groups = [g for g in groups if not g & ends] + [ends.union(*touching)]
    members = [[_end(system, name) for name in sorted(g)] for g in groups]
    distance = _distances(system, members)
    order = {name: i for i, name in enumerate(system.blocks)}

    def rank(end: End) -> tuple[int, int, int, str]:
        last = end.port.rpartition(".")[2]
        preference = 0 if last in _OUTWARD else 2 if last in _INWARD else 1
        return distance[end.block], preference, order[end.block], end.port

    nets = []
    for ends_ in members:
        first, *rest = sorted(ends_, key=rank)
        kind = system.blocks[first.block].ports[first.port].kind
        nets.append(Net(FLANGE, first, tuple(sorted(rest, key=lambda e: order[e.block])), kind))
    return nets


def _distances(system: System, groups: Iterable[list[End]]) -> dict[str, int]:
    """Number of connections between each block and what drives its mechanism."""
    around: dict[str, list[str]] = {name: [] for name in system.blocks}
    for ends in groups:
        for end in ends:
            around[end.block] += [other.block for other in ends if other.block != end.block]
    fed = {system.split(end)[0] for c in system.connections for end in c.ends if system.is_input(end)}
    driving = [n for n, b in system.blocks.items() if b.is_physical() and n in fed]
    found: dict[str, int] = {}
    for roots in (driving, *([name] for name in system.blocks)):
        queue = deque(name for name in roots if name not in found)
        found.update(dict.fromkeys(queue, 0))
        while queue:
            name = queue.popleft()
            for other in around[name]:
                if other not in found:
                    found[other] = found[name] + 1
                    queue.append(other)
    return found


def _mark(made: Graph, scenario: Scenario) -> None:
    """Note what recordings drive and measure; where there are none, what a simulation records."""
    rows: list[tuple[str, str]] = []
    for recording in scenario.recordings.values():
        if isinstance(recording, FrequencyRecording):
            rows.append((DRIVEN, recording.drive))
            rows += [(MEASURED, name) for name in recording.response]
        else:
            rows += [(DRIVEN, name) for name in recording.drive]
            rows += [(MEASURED, name) for name in recording.measurements]
    if not rows and scenario.simulation is not None:
        rows = [(RECORDED, name) for name in scenario.simulation.record or ()]
    for kind, name in dict.fromkeys(rows):
        try:
            end = _end(scenario.system, scenario.resolve(name))
        except FlexarmError:
            continue
        made.marks.setdefault(end.block, []).append(Mark(kind, end.port))
