"""Edit the structure of a scenario file: insert blocks, reroute connections, keep comments.

ruamel's round trip edits the text, so the rest of the user's file stays as it is and the difference is small.
"""

from __future__ import annotations

import copy
import io
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engine.errors import FlexarmError
from scenarios.document import parse
from scenarios.patch import located


@dataclass(frozen=True)
class InSignal:
    """Put a block into a signal, in front of an input.

    Attributes:
        name: of the new block.
        type: of the new block.
        target: the input it stands before.
        parameters: of the new block.
        entry, exit: its ports.
    """

    name: str
    type: str
    target: str
    parameters: dict[str, Any] = field(default_factory=dict)
    entry: str = "in"
    exit: str = "out"


@dataclass(frozen=True)
class AtFlange:
    """Attach a block to a flange, as one more member of its node."""

    name: str
    type: str
    target: str
    port: str
    parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Between:
    """Cut a node in two and put a block between: ``inner`` joins the target and those beside it, ``outer`` the rest."""

    name: str
    type: str
    target: str
    inner: str
    outer: str
    parameters: dict[str, Any] = field(default_factory=dict)
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class OnSensor:
    """Insert a block behind a signal that recordings measure."""

    name: str
    type: str
    target: str
    parameters: dict[str, Any] = field(default_factory=dict)
    entry: str = "in"
    exit: str = "out"


@dataclass(frozen=True)
class ReadAt:
    """Read a signal that recordings measure elsewhere, such as on the other side of a connection that is cut.

    Attributes:
        name: of the signal.
        target: the signal that is measured in its place.
    """

    name: str
    target: str


@dataclass(frozen=True)
class Feed:
    """Drive an input from a new source, in place of what drives it."""

    name: str
    type: str
    target: str
    parameters: dict[str, Any] = field(default_factory=dict)
    exit: str = "out"


@dataclass(frozen=True)
class Wire:
    """Join ends by one more connection."""

    name: str
    ends: tuple[str, ...]


@dataclass(frozen=True)
class Set:
    """Give a parameter or option of a block."""

    name: str
    key: str
    value: Any


@dataclass(frozen=True)
class Replace:
    """Replace a block by one of another type, keeping its connections and the parameters that both types have."""

    name: str
    type: str
    parameters: dict[str, Any] = field(default_factory=dict)
    drop: tuple[str, ...] = ()


Edit = InSignal | AtFlange | Between | OnSensor | ReadAt | Feed | Wire | Set | Replace


def followed(edits: Sequence[Edit]) -> list[Edit]:
    """The edits, those behind a sensor at the signal that is read in its place, and behind those before."""
    readings = [edit for edit in edits if isinstance(edit, ReadAt)]
    read = {edit.name: edit.target for edit in readings}
    others: list[Edit] = []
    for edit in edits:
        if isinstance(edit, OnSensor):
            others.append(replace(edit, target=read.get(edit.target, edit.target)))
            read[edit.target] = f"{edit.name}.{edit.exit}"
        elif not isinstance(edit, ReadAt):
            others.append(edit)
    return [*readings, *others]


def amended(
    text: str,
    edits: Sequence[Edit],
    notes: dict[str, str] | None = None,
    resolve: Callable[[str], str] = str,
) -> str:
    """The scenario's text with edits applied.

    Args:
        text: a scenario.
        edits: in order.
        notes: comment for each block an edit touches, by name.
        resolve: what an exposed name of a connection stands for; see `scenarios.load.Scenario.resolve`.

    Raises:
        FlexarmError: an edit names a place the scenario does not have.
    """

    def change(document: Any) -> None:
        for edit in followed(edits):
            _apply(document, edit, resolve)
            name = edit.name
            note = (notes or {}).get(name)
            if note and name in document["blocks"]:
                document["blocks"].yaml_set_comment_before_after_key(name, before=note, indent=2)

    return _changed(text, change)


def with_values(text: str, values: Mapping[str, str | float], head: str = "") -> str:
    """The scenario's text with values of the model's parameters written where they are given.

    Args:
        text: a scenario.
        values: by the name in the model: ``motor.resistance``, ``zone.heights[2]``, a parameter of the scenario, or one
            inside a sub-assembly, which becomes an override of the block that takes it in.
        head: comment for the beginning of the file.

    Raises:
        FlexarmError: the scenario has no such place.
    """

    def change(document: Any) -> None:
        for name, value in values.items():
            _give(document, name, value)

    made = _changed(text, change)
    return "".join(f"# {line}\n" if line else "#\n" for line in head.splitlines()) + made


def _give(document: Any, name: str, value: str | float) -> None:
    """Write one value: a parameter of the scenario, or of a block, or an element of a list."""
    first, _, rest = name.partition(".")
    key, _, index = (rest or first).partition("[")
    place = document["blocks"].get(first) if rest else document.get("parameters")
    if place is None or (not rest and key not in place):
        raise FlexarmError(f"the scenario has no place to write '{name}'", remedy="put that value into the file itself")
    if not index:
        place[key] = value
        return
    number = int(index.rstrip("]")) - 1
    given = place[key]
    if not isinstance(given, list):
        raise FlexarmError(f"'{name}': one value stands for all", remedy="write one for each")
    given[number] = value


def with_overrides(text: str, overrides: Sequence[str]) -> str:
    """The scenario's text with ``key=value`` texts, as ``--set`` takes them, written where they change it.

    Raises:
        FlexarmError: the scenario has no such place.
    """

    def change(document: Any) -> None:
        tree = parse(text)
        for override in overrides:
            (*above, last), given = located(tree, override)
            tree, inner = tree.put([*above, last], given), document
            for key in above:
                if not isinstance(inner.get(key), dict):
                    inner[key] = {}
                inner = inner[key]
            value = given.plain()
            inner[last] = _flow(value) if isinstance(value, dict | list) else value

    return _changed(text, change) if overrides else text


def with_readings(text: str, readings: Mapping[tuple[str, ...], str | tuple[str, ...]]) -> str:
    """The scenario's text with what its recordings leave open, such as how an input runs between samples.

    Args:
        text: a scenario.
        readings: keys from ``recordings`` on -> value; recordings that are not described are passed over.
    """

    def change(document: Any) -> None:
        described = document.get("recordings") or {}
        for (_, name, *keys, last), value in readings.items():
            if name in described:
                place = described[name]
                for key in keys:
                    place = place[key]
                place[last] = value if isinstance(value, str) else list(value)

    return _changed(text, change) if readings else text


def without(text: str, *sections: str) -> str:
    """The scenario's text without some of its top-level sections, such as ``recordings``."""

    def change(document: Any) -> None:
        for section in sections:
            document.pop(section, None)

    return _changed(text, change)


def relocated(text: str, old: Path, new: Path) -> str:
    """The text with the files it names relative to ``old`` named relative to ``new``."""

    def change(document: Any) -> None:
        recordings = list((document.get("recordings") or {}).values())
        further = [one for entry in recordings if isinstance(entry, dict) for one in entry.get("files") or []]
        entries = [*recordings, *further, *(document.get("blocks") or {}).values()]
        for entry in entries:
            for key in ("file", "type"):
                value = entry.get(key) if isinstance(entry, dict) else None
                if not isinstance(value, str) or value.startswith("$") or Path(value).is_absolute():
                    continue
                if key == "file" or value.endswith((".yaml", ".yml")):
                    entry[key] = os.path.relpath((old / value).resolve(), new.resolve())

    return _changed(text, change)


def _changed(text: str, change: Callable[[Any], None]) -> str:
    """The text after a change that sees no anchors: every place holds a value of its own.

    Sections that the change leaves as they were keep their anchors, aliases and merge keys; the others are written out.
    """
    yaml = _yaml()

    def changed() -> Any:
        document = yaml.load(text)
        document = _unshared(document, set()) if _SHARED.search(text) else document
        change(document)
        return document

    written = _dumped(yaml, changed())
    if not _SHARED.search(text):
        return written
    # Anew, because ruamel moves comments while it writes.
    meant, original, mixed = parse(written).plain(), parse(text).plain(), changed()
    for key, value in yaml.load(text).items():
        if key in mixed and meant[key] == original[key]:
            mixed[key] = value
    kept = _dumped(yaml, mixed)
    try:  # a section that was not changed may share with one that was; if that went wrong, all is written out
        return kept if parse(kept).plain() == meant else written
    except FlexarmError:
        return written


_SHARED = re.compile(r"&\S.*(\*\S|<<)", re.DOTALL)
"""A text that may hold an anchor and a use of it."""


def _dumped(yaml: Any, document: Any) -> str:
    out = io.StringIO()
    yaml.dump(document, out)
    return out.getvalue()


def _unshared(node: Any, seen: set[int]) -> Any:
    """The tree with a copy in place of every alias, merge keys written out, and no anchors."""
    from ruamel.yaml.anchor import Anchor
    from ruamel.yaml.comments import CommentedMap, CommentedSeq, merge_attrib

    if isinstance(node, CommentedMap | CommentedSeq):
        if id(node) in seen:
            node = copy.deepcopy(node)
            _uncommented(node)
        seen.add(id(node))
        if isinstance(node, CommentedMap):
            entries = [(key, node[key]) for key in node]
            if hasattr(node, merge_attrib):
                delattr(node, merge_attrib)
        else:
            entries = list(enumerate(node))
        for key, value in entries:
            node[key] = _unshared(value, seen)
    elif hasattr(node, Anchor.attrib):
        node = copy.copy(node)
    if hasattr(node, Anchor.attrib):
        delattr(node, Anchor.attrib)
    return node


def _uncommented(node: Any) -> None:
    """Take the comments off a tree; they stay where they were written first."""
    from ruamel.yaml.comments import Comment

    if hasattr(node, Comment.attrib):
        delattr(node, Comment.attrib)
    for inner in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        _uncommented(inner)


def _yaml() -> Any:
    from ruamel.yaml import YAML

    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = 120
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


def _flow(values: Any) -> Any:
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    made = CommentedSeq(values) if isinstance(values, list) else CommentedMap(values)
    made.fa.set_flow_style()
    return made


def _node(document: Any, end: str, resolve: Callable[[str], str]) -> tuple[Any, int]:
    """The connection that joins an end, and the end's place in it; None and 0 if there is none."""
    for connection in document.setdefault("connect", []):
        for place, name in enumerate(connection):
            if resolve(str(name)) == end:
                return connection, place
    return None, 0


def _apply(document: Any, edit: Edit, resolve: Callable[[str], str]) -> None:
    blocks = document["blocks"]
    if isinstance(edit, ReadAt):
        _rename(document, edit.name, edit.target, ("measurements", "response"), "")
        return
    if isinstance(edit, Wire):
        document.setdefault("connect", []).append(_flow(list(edit.ends)))
        return
    if isinstance(edit, Set | Replace):
        if edit.name not in blocks:
            raise FlexarmError(f"the scenario has no block '{edit.name}' of its own")
        if isinstance(edit, Set):
            blocks[edit.name][edit.key] = edit.value
            return
        blocks[edit.name]["type"] = edit.type
        for key in edit.drop:
            blocks[edit.name].pop(key, None)
        blocks[edit.name].update(edit.parameters)
        return
    if edit.name in blocks:
        raise FlexarmError(f"the scenario has a block '{edit.name}' already")
    blocks[edit.name] = _flow({"type": edit.type, **edit.parameters})
    connect = document.setdefault("connect", [])
    node, place = _node(document, edit.target, resolve)
    if isinstance(edit, InSignal):
        if node is not None:
            if len(node) == 2:
                node[place] = f"{edit.name}.{edit.entry}"
            else:
                del node[place]
                node.append(f"{edit.name}.{edit.entry}")
        connect.append(_flow([f"{edit.name}.{edit.exit}", edit.target]))
        _rename(document, edit.target, f"{edit.name}.{edit.entry}", ("drive",), "inputs")
    elif isinstance(edit, Feed):
        if node is not None:
            del node[place]
            if len(node) < 2:
                connect.remove(node)
        connect.append(_flow([f"{edit.name}.{edit.exit}", edit.target]))
    elif isinstance(edit, AtFlange):
        if node is None:
            connect.append(_flow([edit.target, f"{edit.name}.{edit.port}"]))
        else:
            node.append(f"{edit.name}.{edit.port}")
    elif isinstance(edit, Between):
        if node is None or len(node) < 2:
            raise FlexarmError(f"nothing is connected to '{edit.target}'")
        node[place] = f"{edit.name}.{edit.outer}"
        for name in [str(end) for end in node if resolve(str(end)) in edit.beside]:
            node.remove(name)
        connect.append(_flow([edit.target, *edit.beside, f"{edit.name}.{edit.inner}"]))
    else:
        connect.append(_flow([edit.target, f"{edit.name}.{edit.entry}"]))
        _rename(document, edit.target, f"{edit.name}.{edit.exit}", ("measurements", "response"), "")


def _rename(document: Any, old: str, new: str, sections: tuple[str, ...], analyses: str) -> None:
    """Rename ``old`` to ``new`` in recordings, and in analyses if asked for."""
    for recording in (document.get("recordings") or {}).values():
        for section in sections:
            entry = recording.get(section)
            if hasattr(entry, "insert") and old in entry:
                position = list(entry).index(old)
                value = entry.pop(old)
                entry.insert(position, new, value)
            elif entry == old:
                recording[section] = new
    if analyses:
        for analysis in (document.get("analyses") or {}).values():
            names = analysis.get(analyses)
            if names and old in names:
                names[list(names).index(old)] = new
