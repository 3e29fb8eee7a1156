"""Every way to cut a rig that the names of joints allow.

A joint ``X -> Y`` of a node says which flange is the first of the near side, and which that of the far side. Flanges
behind Y may be on either side, and a sensor of the node's motion may sit on any piece.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

from benchmarks.concealed.rigs.rig import Rig

WAYS = 32
"""Ways that are tried at most, as each is a fit of its own: all that a node of six flanges with one sensor has."""


def ways(rig: Rig, places: Sequence[str], others: Sequence[str] = ()) -> Iterator[Rig]:
    """A rig that is cut in each way that names allow, first those nearest to how it was drawn.

    Ways that leave a piece without inertia, and cuts that cross, are left out.

    Args:
        rig: which.
        places: joints, each in one node.
        others: joints that give too, as they are.
    """
    t, joints = rig.topology, [*places, *others]
    nodes = [_node(rig, place) for place in places]
    found = []
    for sides in itertools.product(*(t.far_sides(i, place) for i, place in zip(nodes, places, strict=True))):
        cut = rig.also_cut(dict(zip(places, zip(nodes, sides, strict=True), strict=True)))
        if cut.can_give(joints):
            moved = sum(len(far ^ t.far(i)) for i, far in zip(nodes, sides, strict=True))
            found += [(moved + len(seats), cut, seats) for seats in _seats(cut, sorted({*nodes}), joints)]
    for _, cut, seats in sorted(found, key=lambda way: way[0])[:WAYS]:
        yield cut.seated(seats)


def _node(rig: Rig, place: str) -> int:
    index = rig.topology.joined(place)
    if index is None:
        raise ValueError(f"{rig.name} has no node with both ends of '{place}'")
    return index


def _seats(rig: Rig, nodes: Sequence[int], joints: Sequence[str]) -> Iterator[dict[str, str]]:
    """Every way to seat the sensors of motion of nodes that are cut; those that stay are not in it."""
    choices: list[list[tuple[str, str] | None]] = []
    for probe in rig.topology.probes:
        index = rig.topology.node_of(probe.at)
        if probe.kind in ("angle", "speed") and index in nodes:
            others = [piece.flanges for piece in rig.pieces(index, joints) if probe.at not in piece.flanges]
            choices.append([None, *((rig.signal(probe), flanges[0]) for flanges in others)])
    for chosen in itertools.product(*choices):
        yield dict(seat for seat in chosen if seat is not None)
