"""A YAML file as a tree of nodes that know their line.

The events come from ruamel.yaml; the values follow the YAML 1.2 core schema, so ``on`` and ``no`` stay texts and
``0777`` is a decimal number. Merge keys (``<<: *name``) are read, as in YAML 1.1. Tags, duplicate keys, several
documents and hostile input (aliases that multiply, deep nesting, control characters) are refused, each with its line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engine.errors import FlexarmError, Where
from engine.names import CONTROL
from engine.readers.regular import FileProblem, content

LARGEST_FILE = 5_000_000
"""Bytes."""

DEEPEST = 40
"""Levels of nesting."""

MOST_NODES = 200_000
"""Values in a file, after every alias is written out."""

Key = str | int

_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS = {"null": None, "Null": None, "NULL": None, "~": None, "": None, "true": True, "True": True, "TRUE": True}
_WORDS |= {"false": False, "False": False, "FALSE": False}


class DocumentError(FlexarmError):
    """A file cannot be read as YAML."""


@dataclass(frozen=True)
class Node:
    """One value of a document.

    Attributes:
        value: a scalar, a list of nodes, or a dictionary from key to node.
        file: where it was written; for a value given on the command line, the option.
        line: 1-based; 0 when it does not come from a file.
        key_lines: for a mapping, the line of each key.
        size: how many values it holds, itself included.
        scope: names the parameters a ``$name`` inside it refers to; None means those of its own file.
    """

    value: Any
    file: str = ""
    line: int = 0
    key_lines: dict[str, int] = field(default_factory=dict)
    size: int = 1
    scope: Any = None

    def plain(self) -> Any:
        """The value as ordinary Python objects."""
        if isinstance(self.value, dict):
            return {key: item.plain() for key, item in self.value.items()}
        if isinstance(self.value, list):
            return [item.plain() for item in self.value]
        return self.value

    def get(self, *path: Key) -> Node | None:
        """The node that the keys lead to, or None."""
        node: Node | None = self
        for key in path:
            assert node is not None
            if isinstance(node.value, dict):
                node = node.value.get(key)
            elif isinstance(node.value, list) and isinstance(key, int) and 0 <= key < len(node.value):
                node = node.value[key]
            else:
                return None
            if node is None:
                return None
        return node

    def items(self) -> Iterator[tuple[str, Node]]:
        """Keys and nodes of a mapping; nothing for anything else."""
        if isinstance(self.value, dict):
            yield from self.value.items()

    def where(self, *path: Key) -> Where:
        """The place of what the keys lead to; of the nearest existing parent when it is missing."""
        node, line = self, self.line
        for key in path:
            following = node.get(key)
            if following is None:
                break
            line = node.key_lines.get(key, following.line) if isinstance(key, str) else following.line
            if following.file != node.file:
                line = following.line
            node = following
        return Where(node.file, line, dotted(path))

    def put(self, path: Sequence[str], given: Node) -> Node:
        """A copy in which the keys lead to ``given``; mappings on the way are made when missing."""
        if not path:
            return given
        items = dict(self.value) if isinstance(self.value, dict) else {}
        child = items.get(path[0], Node({}, given.file, given.line))
        items[path[0]] = child.put(path[1:], given)
        return replace(self, value=items)


def dotted(path: Sequence[Key]) -> str:
    """A path of keys as text: ``connect[2]``, ``blocks.gear.ratio``."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else key
    return text


def scalar(text: str) -> Any:
    """A plain scalar by the YAML 1.2 core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text) and len(text) <= 40:
        return int(text)
    if _BASED.fullmatch(text) and len(text) <= 40:
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _SPECIAL.fullmatch(text):
        return float(text.replace(".", ""))
    return text


def read(path: Path, shown: str = "") -> Node:
    """Read a YAML file.

    Args:
        path: the file.
        shown: how messages name the file; the path by default.

    Raises:
        DocumentError: it cannot be opened, is too large, is not UTF-8, or is not plain YAML.
    """
    shown = shown or str(path)
    try:
        data = content(path, LARGEST_FILE, "keep recordings in .csv, .mat or .parquet files and name them here")
    except FileProblem as error:
        raise DocumentError(error.message, Where(shown), error.remedy) from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        kind = _binary(data)
        if kind:
            what = f"this is {kind}, not a scenario"
            raise DocumentError(what, Where(shown), "give the scenario's .yaml file") from None
        line = data.count(b"\n", 0, error.start) + 1
        raise DocumentError(
            f"byte 0x{data[error.start]:02x} is not UTF-8 text", Where(shown, line), "save the file as UTF-8"
        ) from error
    return parse(text, shown)


_STARTS = (
    (b"PAR1", "a Parquet file"),
    (b"PK\x03\x04", "a zip archive, as an FMU or an Excel file is"),
    (b"\x89HDF", "an HDF5 file"),
    (b"MATLAB", "a MATLAB file"),
    (b"\x89PNG", "a picture"),
    (b"\xff\xd8", "a picture"),
    (b"%PDF", "a PDF file"),
    (b"\x1f\x8b", "a compressed file"),
    (b"MDF", "an MDF recording"),
    (b"TDSm", "a TDMS recording"),
)


def _binary(data: bytes) -> str:
    """What a file is that is no text, empty if it may be one."""
    found = next((kind for start, kind in _STARTS if data.startswith(start)), "")
    if found or data[:2] in (b"\xff\xfe", b"\xfe\xff"):  # a byte order mark of UTF-16 begins a text
        return found
    return "a binary file" if b"\0" in data[:4096] else ""


def parse(text: str, shown: str = "") -> Node:
    """Read YAML text; see `read`."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        return _Builder(shown).build(YAML(typ="safe", pure=True).parse(text))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = ", ".join(str(part) for part in (error.context, error.problem) if part)
        raise DocumentError(f"not YAML: {said}", Where(shown, mark.line + 1 if mark else 0), _remedy(said)) from error
    except YAMLError as error:
        position = getattr(error, "position", None)
        line = text.count("\n", 0, position) + 1 if isinstance(position, int) else 0
        reason = getattr(error, "reason", None) or str(error).split("\n", 1)[0]
        raise DocumentError(f"not YAML: {reason}", Where(shown, line)) from error


_REMEDIES = (
    (r"'\\t'", "indent with spaces, not with tabs"),
    (r"expected ',' or '[]}]'", "close every [ and {, put commas between items, and quote texts that hold brackets"),
    (
        r"mapping values are not allowed",
        "a name is followed by a colon and a space; a text that holds ': ' needs quotes",
    ),
    (r"expected ':'", "a name is followed by a colon and a space"),
    (r"block (mapping|collection)", "entries of one level begin in the same column"),
)
"""What the parser says, and what to do about it."""


def _remedy(said: str) -> str:
    return next((remedy for pattern, remedy in _REMEDIES if re.search(pattern, said)), "")


class _Builder:
    """Turns the events of a YAML parser into nodes."""

    def __init__(self, shown: str) -> None:
        self.shown = shown
        self.anchors: dict[str, Node] = {}
        self.nodes = 0
        self.depth = 0

    def build(self, events: Iterator[Any]) -> Node:
        self.events = events
        root = Node({}, self.shown, 1)
        documents = 0
        for event in events:
            kind = type(event).__name__
            if kind in ("StreamStartEvent", "StreamEndEvent", "DocumentEndEvent"):
                continue
            if kind == "DocumentStartEvent":
                documents += 1
                if documents > 1:
                    raise self.problem(event, "a second document begins here", "a scenario file holds one document")
                if event.version and tuple(event.version) != (1, 2):
                    raise self.problem(event, "another YAML version is asked for", "scenario files are YAML 1.2")
                continue
            root = self.node(event)
        if root.value is None:
            root = Node({}, self.shown, 1)
        return root

    def node(self, event: Any) -> Node:
        kind = type(event).__name__
        if kind == "AliasEvent":
            known = self.anchors.get(event.anchor)
            if known is None:
                raise self.problem(event, f"'*{event.anchor}' names no finished value before it")
            self.count(event, known.size)
            return known
        if event.tag is not None and event.tag != "!":
            raise self.problem(event, f"the tag '{event.tag}' is not allowed", "write plain values")
        self.count(event, 1)
        line = event.start_mark.line + 1
        if kind == "ScalarEvent":
            text = self.text(event)
            made = Node(scalar(text) if event.implicit[0] else text, self.shown, line)
        else:
            self.depth += 1
            if self.depth > DEEPEST:
                raise self.problem(event, f"values are nested more than {DEEPEST} levels deep")
            made = self.mapping(line) if kind == "MappingStartEvent" else self.sequence(line)
            self.depth -= 1
        if event.anchor is not None:
            self.anchors[event.anchor] = made
        return made

    def sequence(self, line: int) -> Node:
        items = []
        while type(event := next(self.events)).__name__ != "SequenceEndEvent":
            items.append(self.node(event))
        return Node(items, self.shown, line, size=1 + sum(item.size for item in items))

    def mapping(self, line: int) -> Node:
        items: dict[str, Node] = {}
        lines: dict[str, int] = {}
        merged: list[Node] | None = None
        while type(event := next(self.events)).__name__ != "MappingEndEvent":
            if type(event).__name__ != "ScalarEvent":
                raise self.problem(event, "a key must be a name")
            self.node(event)
            key = self.text(event)
            if key == "<<" and event.implicit[0]:
                if merged is not None:
                    raise self.problem(event, "the key '<<' was given before", "write '<<: [*one, *two]'")
                merged = self.merged(event)
                continue
            if key in items:
                raise self.problem(event, f"the key '{key}' was given before, in line {lines[key]}", "keep one of them")
            lines[key] = event.start_mark.line + 1
            items[key] = self.node(next(self.events))
        # What the mapping says itself comes first, then the merged mappings in their order.
        for source in merged or ():
            for key, item in source.items():
                if key not in items:
                    items[key], lines[key] = item, source.key_lines.get(key, item.line)
        size = 1 + sum(1 + item.size for item in items.values())
        return Node(items, self.shown, line, lines, size)

    def merged(self, event: Any) -> list[Node]:
        """The mappings that a merge key takes in (YAML 1.1, https://yaml.org/type/merge.html)."""
        given = self.node(next(self.events))
        sources = given.value if isinstance(given.value, list) else [given]
        if not all(isinstance(source.value, dict) for source in sources):
            raise self.problem(event, "'<<' takes in mappings alone", "write '<<: *name', or '<<: [*one, *two]'")
        return list(sources)

    def text(self, event: Any) -> str:
        """The text of a scalar, characters that were escaped as two halves joined."""
        text = str(event.value)
        try:
            text = text if text.isascii() else text.encode("utf-16", "surrogatepass").decode("utf-16")
        except UnicodeDecodeError:
            raise self.problem(event, "the text holds half of a character (a lone surrogate)") from None
        found = CONTROL.search(text)
        if found:
            # XML, the terminal and MATLAB cannot hold them, and texts of a scenario go there.
            raise self.problem(event, f"the text holds the control character U+{ord(found[0]):04X}", "leave it out")
        return text

    def count(self, event: Any, size: int) -> None:
        self.nodes += size
        if self.nodes > MOST_NODES:
            raise self.problem(event, f"the file holds more than {MOST_NODES} values once its aliases are written out")

    def problem(self, event: Any, message: str, remedy: str = "") -> DocumentError:
        return DocumentError(message, Where(self.shown, event.start_mark.line + 1), remedy)
