"""A flange where a system is cut: what moves and acts there, and the blocks that are put on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from engine.ports import MOTION, TRANSLATIONAL
from engine.system import Connection, System
from flexarm.splitting.sides import Follower, TranslationalFollower
from fmu.variables import flat


@dataclass(frozen=True)
class CutFlange:
    """A flange that was cut: groups on either side, the owner's flange, the follower's block, effort and motions."""

    owner: str
    follower: str
    head: str
    block: str
    effort: str
    motions: tuple[str, str, str]

    @property
    def owning(self) -> str:
        """Name of the block on the owner's side."""
        return f"{self.block}_{self.effort}"


def kind_of(system: System, end: str) -> str:
    """Kind of a flange: rotational or translational."""
    block, port = system.split(end)
    return system.blocks[block].ports[port].kind


def follower_of(system: System, end: str) -> tuple[str, str, tuple[str, str, str]]:
    """Name of the follower's block, its flange, and the motions it takes."""
    kind = kind_of(system, end)
    names = [name for name, _ in MOTION[kind][:3]]
    return f"cut_{flat(end)}", "flange" if kind == TRANSLATIONAL else "shaft", (names[0], names[1], names[2])


def effort_of(system: System, end: str) -> str:
    """What acts through a flange: torque, or force."""
    return "force" if kind_of(system, end) == TRANSLATIONAL else "torque"


def follow(system: System, end: str, name: str, port: str, kind: str) -> None:
    """Put a follower on a flange."""
    system.blocks[name] = TranslationalFollower() if kind == TRANSLATIONAL else Follower()
    join(system, end, f"{name}.{port}")


def join(system: System, end: str, added: str) -> None:
    """Put a flange on the node that ``end`` is on."""
    for i, connection in enumerate(system.connections):
        if end in connection.ends:
            system.connections[i] = replace(connection, ends=(*connection.ends, added))
            return
    system.connections.append(Connection((end, added)))
