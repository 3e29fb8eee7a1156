"""The cutting of a system into parts: signals become wires, and so do motion and torque of flanges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from engine.block import Block
from engine.errors import FlexarmError
from engine.ports import TRANSLATIONAL
from engine.system import Connection, System
from flexarm.splitting.flanges import CutFlange, effort_of, follow, follower_of, join, kind_of
from flexarm.splitting.owner import owner_of
from flexarm.splitting.parts import Part
from flexarm.splitting.sides import Owner, TranslationalOwner
from fmu import ssp
from fmu.variables import flat


def cut_apart(
    system: System, members: Mapping[str, list[str]]
) -> tuple[dict[str, Part], list[tuple[ssp.End, ssp.End]]]:
    """The parts of a system, each closed by the blocks at its cuts, and the wires between them."""
    of = {block: group for group, blocks in members.items() for block in blocks}
    parts = {}
    for group, blocks in members.items():
        inside = {block: system.blocks[block] for block in blocks}
        initial = {n: v for n, v in system.initial.items() if of.get(_block(system, n)) == group}
        shared = {block: names for block, names in system.shared.items() if block in inside}
        part = replace(system, blocks=inside, connections=[], shared=shared, initial=initial)
        part.name, part.description = group, f"{group} of {system.name}"
        parts[group] = Part(part)
    wires: list[tuple[ssp.End, ssp.End]] = []
    crossing: list[tuple[Connection, dict[str, list[str]]]] = []
    for connection in system.connections:
        ends: dict[str, list[str]] = {}
        for end in connection.ends:
            ends.setdefault(of[system.split(end)[0]], []).append(end)
        if len(ends) == 1:
            parts[next(iter(ends))].system.connections.append(connection)
        elif system.is_flange(connection.ends[0]):
            crossing.append((connection, ends))
            for group, own in ends.items():
                if len(own) > 1:
                    parts[group].system.connections.append(replace(connection, ends=tuple(own)))
        else:
            _cut_signal(system, connection, ends, parts, wires)
    # Which side of a shaft can follow is judged by the parts as they are, before any cut is closed.
    owners = [owner_of(system, connection, ends, parts) for connection, ends in crossing]
    for (_, ends), owner in zip(crossing, owners, strict=True):
        _cut_flange(system, ends, owner, parts, wires)
    return parts, wires


def _block(system: System, name: str) -> str:
    try:
        return system.split(name)[0]
    except FlexarmError:
        return ""


def _cut_signal(
    system: System,
    connection: Connection,
    ends: Mapping[str, list[str]],
    parts: Mapping[str, Part],
    wires: list[tuple[ssp.End, ssp.End]],
) -> None:
    source = next(end for end in connection.ends if not system.is_input(end))
    for group, own in ends.items():
        if source in own:
            if len(own) > 1:
                parts[group].system.connections.append(replace(connection, ends=tuple(own)))
            start = (group, flat(parts[group].give(source)))
    for group, own in ends.items():
        if source not in own:
            wires += [(start, (group, flat(parts[group].take(end)))) for end in own]


def _cut_flange(
    system: System,
    ends: Mapping[str, list[str]],
    owner: str,
    parts: Mapping[str, Part],
    wires: list[tuple[ssp.End, ssp.End]],
) -> None:
    head = ends[owner][0]
    for group, own in ends.items():
        if group == owner:
            continue
        end, effort = own[0], effort_of(system, own[0])
        name, port, motions = follower_of(system, end)
        follow(parts[group].system, end, name, port, kind_of(system, end))
        for sent in motions:
            start = (owner, flat(parts[owner].give(f"{head}.{sent}")))
            wires.append((start, (group, flat(parts[group].take(f"{name}.{sent}")))))
        cut = CutFlange(owner, group, head, name, effort, motions)
        parts[group].followers.append(cut)
        parts[owner].owners.append(cut)
        side: Block = TranslationalOwner() if kind_of(system, end) == TRANSLATIONAL else Owner()
        parts[owner].system.blocks[cut.owning] = side
        join(parts[owner].system, head, f"{cut.owning}.{port}")
        out = (group, flat(parts[group].give(f"{name}.{effort}")))
        wires.append((out, (owner, flat(parts[owner].take(f"{cut.owning}.{effort}")))))
        for here, there, sender, taker in ((owner, group, cut.owning, name), (group, owner, name, cut.owning)):
            held = (here, flat(parts[here].give(f"{sender}.now")))
            wires.append((held, (there, flat(parts[there].take(f"{taker}.sent")))))
