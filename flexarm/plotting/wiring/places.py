"""Places of a diagnosis on the block diagram: which block, port or connection the words mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from flexarm.plotting.wiring.graph import End, Graph, Net

Key = TypeVar("Key", str, End)

LEAST = 0.005
"""Odds below this light nothing."""


@dataclass
class Lit:
    """What to light up, with the odds.

    Attributes:
        blocks, ports, nets: odds by block, by end, and by one end of a net.
        notes: block -> (what of it, odds), for the lines in its box.
        unknown: places that the diagram does not have.
    """

    blocks: dict[str, float] = field(default_factory=dict)
    ports: dict[End, float] = field(default_factory=dict)
    nets: dict[End, float] = field(default_factory=dict)
    notes: dict[str, list[tuple[str, float]]] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)

    def block(self, name: str) -> str:
        """Kind of light of a block; empty for none."""
        return _kind(self.blocks.get(name, 0.0))

    def port(self, block: str, port: str) -> str:
        """Kind of light of a port."""
        return _kind(self.ports.get(End(block, port), 0.0))

    def net(self, net: Net) -> str:
        """Kind of light of a net."""
        return _kind(max((self.nets.get(end, 0.0) for end in net.ends), default=0.0))


def _kind(odds: float) -> str:
    return "" if odds < LEAST else "hot1" if odds >= 0.5 else "hot2" if odds >= 0.05 else "hot3"


def share(odds: float) -> str:
    """Odds in per cent, without claiming certainty."""
    return "> 99 %" if odds > 0.995 else f"{100 * odds:.2g} %" if odds >= LEAST else "< 0.5 %"


def lit(graph: Graph, highlight: Mapping[str, float]) -> Lit:
    """Find each place on the diagram."""
    found = Lit()
    for place, odds in highlight.items():
        if odds < LEAST:
            continue
        before, arrow, after = (part.strip() for part in place.partition("->"))
        named = [end for text in ((after, before) if arrow else (place,)) if (end := _end(graph, text))]
        if not named:
            found.unknown.append(place)
            continue
        end = named[0]
        _add(found.blocks, end.block, odds)
        if arrow:
            _add(found.nets, end, odds)
        if end.port:
            _add(found.ports, End(end.block, _drawn(graph, end)), odds)
        where = f"on the way {'into' if end == _end(graph, after) else 'out of'} {end.port}" if arrow else end.port
        found.notes.setdefault(end.block, []).append((where, odds))
    return found


def _add(known: dict[Key, float], key: Key, odds: float) -> None:
    known[key] = max(known.get(key, 0.0), odds)


def _end(graph: Graph, text: str) -> End | None:
    """The block a text begins with, and what of it is meant."""
    parts = text.split(".")
    for cut in range(len(parts), 0, -1):
        block = ".".join(parts[:cut])
        if block in graph.blocks:
            return End(block, ".".join(parts[cut:]))
    return None


def _drawn(graph: Graph, end: End) -> str:
    """The drawn port that a signal is taken from: ``hub.angle`` lies at the flange ``hub``."""
    drawn = {e.port for net in graph.nets for e in net.ends if e.block == end.block}
    candidates = [p for p in drawn if end.port == p or end.port.startswith(f"{p}.")]
    return max(candidates, key=len, default=end.port)
