"""A scenario with edits applied in memory: what a search builds thousands of times, without a line of YAML.

`scenarios.amend` does the same to the text, once, for the file that the user gets.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from blocks.registry import find
from engine.block import Block
from engine.errors import FlexarmError
from engine.system import Connection, System
from scenarios.amend import AtFlange, Between, Edit, Feed, InSignal, OnSensor, ReadAt, Replace, Set, Wire, followed
from scenarios.load import Scenario


def edited(scenario: Scenario, edits: Sequence[Edit]) -> Scenario:
    """The scenario with edits applied to its system; the file it was read from stays as it is.

    Raises:
        FlexarmError: an edit names a place that the file does not have, or a block refuses its values.
    """
    given = scenario.system
    system = replace(
        given,
        blocks=dict(given.blocks),
        connections=list(given.connections),
        shared={name: dict(keys) for name, keys in given.shared.items()},
    )
    for edit in followed(edits):
        _apply(scenario, system, edit)
    return replace(scenario, system=system)


def renamed(names: Iterable[str], edits: Sequence[Edit]) -> list[str]:
    """What inputs and signals are called after edits: those of a block that is put before or behind them."""
    found = list(names)
    for edit in followed(edits):
        if isinstance(edit, ReadAt):
            found = [edit.target if name == edit.name else name for name in found]
        elif isinstance(edit, InSignal):
            found = [f"{edit.name}.{edit.entry}" if name == edit.target else name for name in found]
        elif isinstance(edit, OnSensor):
            found = [f"{edit.name}.{edit.exit}" if name == edit.target else name for name in found]
    return found


def _apply(scenario: Scenario, system: System, edit: Edit) -> None:
    if isinstance(edit, ReadAt):
        return
    if isinstance(edit, Wire):
        _join(system, *edit.ends)
        return
    if isinstance(edit, Set | Replace):
        if edit.name not in scenario.file.blocks:
            raise FlexarmError(f"the scenario has no block '{edit.name}' of its own")
        system.blocks[edit.name] = _changed(system, edit)
        return
    if edit.name in system.blocks:
        raise FlexarmError(f"the scenario has a block '{edit.name}' already")
    system.blocks[edit.name] = find(edit.type)(**edit.parameters)
    node = _node(scenario, system, edit.target)
    if isinstance(edit, OnSensor):
        _join(system, edit.target, f"{edit.name}.{edit.entry}")
    elif isinstance(edit, AtFlange):
        if node is None:
            _join(system, edit.target, f"{edit.name}.{edit.port}")
        else:
            ends = system.connections[node].ends
            _rewire(system, node, (*ends, f"{edit.name}.{edit.port}"))
    elif isinstance(edit, Between):
        if node is None or len(system.connections[node].ends) < 2:
            raise FlexarmError(f"nothing is connected to '{edit.target}'")
        outer = f"{edit.name}.{edit.outer}"
        ends = system.connections[node].ends
        rest = [outer if end == edit.target else end for end in ends if end not in edit.beside]
        _rewire(system, node, tuple(rest))
        _join(system, edit.target, *edit.beside, f"{edit.name}.{edit.inner}")
    elif isinstance(edit, InSignal):
        if node is not None:
            entry, ends = f"{edit.name}.{edit.entry}", system.connections[node].ends
            others = tuple(end for end in ends if end != edit.target)
            in_place = tuple(entry if end == edit.target else end for end in ends)
            _rewire(system, node, in_place if len(ends) == 2 else (*others, entry))
        _join(system, f"{edit.name}.{edit.exit}", edit.target)
    else:
        _feed(system, node, edit)


def _changed(system: System, edit: Set | Replace) -> Block:
    """A block of another type or with another value; what it shares with others stays shared unless it is given."""
    block = system.blocks[edit.name]
    given, shared = dict(block.given), system.shared.get(edit.name, {})
    if isinstance(edit, Set):
        values, made = {edit.key: edit.value}, type(block)
    else:
        values, made = edit.parameters, find(edit.type)
    for key in (*(edit.drop if isinstance(edit, Replace) else ()), *values):
        given.pop(key, None)
        for name in [name for name in shared if name == key or name.startswith(f"{key}[")]:
            del shared[name]
        system.fixed = {
            common: tuple(name for name in names if name != f"{edit.name}.{key}")
            for common, names in system.fixed.items()
        }
    return made(**given, **values)


def _node(scenario: Scenario, system: System, end: str) -> int | None:
    """Number of the connection of the file itself, or of an earlier edit, that joins an end."""
    own = ("", scenario.document.file)
    for i, connection in enumerate(system.connections):
        if end in connection.ends and (connection.where.file or "") in own:
            return i
    return None


def _join(system: System, *ends: str) -> None:
    system.connections.append(Connection(ends))


def _rewire(system: System, node: int, ends: tuple[str, ...]) -> None:
    system.connections[node] = replace(system.connections[node], ends=ends)


def _feed(system: System, node: int | None, edit: Feed) -> None:
    if node is not None:
        left = tuple(end for end in system.connections[node].ends if end != edit.target)
        if len(left) < 2:
            del system.connections[node]
        else:
            _rewire(system, node, left)
    _join(system, f"{edit.name}.{edit.exit}", edit.target)
