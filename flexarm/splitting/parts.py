"""The parts of a system: groups of blocks on their way to FMUs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from engine.errors import FlexarmError, nearest
from engine.system import System
from flexarm.splitting.flanges import CutFlange
from fmu.variables import flat

REST = "rest"
"""FMU of the blocks that are in no group."""


@dataclass
class Part:
    """One group of blocks on its way to an FMU."""

    system: System
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    followers: list[CutFlange] = field(default_factory=list)
    owners: list[CutFlange] = field(default_factory=list)

    def give(self, name: str) -> str:
        """The signal, which is an output of the part from now on."""
        if name not in self.outputs:
            self.outputs.append(name)
        return name

    def take(self, name: str) -> str:
        """The signal, which is an input of the part from now on."""
        self.inputs.append(name)
        return name


def members_of(system: System, groups: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Blocks of every group, in the order of the system's."""
    of: dict[str, str] = {}
    for group, names in groups.items():
        if flat(group) != group or group == REST:
            raise FlexarmError(
                f"'{group}' cannot name an FMU", remedy="letters, digits and underscores, and not 'rest'"
            )
        for name in names:
            found = [block for block in system.blocks if block == name or block.startswith(f"{name}.")]
            if not found:
                raise FlexarmError(f"there is no block '{name}' to split off", remedy=nearest(name, system.blocks))
            for block in found:
                if of.setdefault(block, group) != group:
                    raise FlexarmError(
                        f"block '{block}' is in two groups: {of[block]} and {group}", remedy="name it in one of them"
                    )
    members: dict[str, list[str]] = {group: [] for group in groups}
    for block in system.blocks:
        members.setdefault(of.get(block, REST), []).append(block)
    if len(members) < 2:
        raise FlexarmError("that leaves one FMU", remedy="split off some blocks and leave others: NAME=BLOCK,BLOCK")
    return members
