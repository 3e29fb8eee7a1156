"""Change single values of a scenario by path: ``--set gear.ratio=14`` and the overrides of a sub-assembly."""

from __future__ import annotations

from dataclasses import replace

from engine.errors import Where, nearest
from scenarios.document import DocumentError, Node, parse
from scenarios.schema import SECTIONS
from scenarios.validate import ScenarioError

ASSEMBLY_ENDINGS = (".yaml", ".yml")


def is_assembly(entry: Node) -> bool:
    """Whether a block entry takes in another file."""
    kind = entry.get("type")
    return kind is not None and isinstance(kind.value, str) and kind.value.endswith(ASSEMBLY_ENDINGS)


def override(document: Node, text: str) -> Node:
    """The document with one ``key=value`` applied.

    Args:
        document: the scenario.
        text: for example ``gear.ratio=14``, ``parameters.supply=2 V``, ``simulate.stop=10 s``.

    Raises:
        ScenarioError: no such place; names the nearest.
    """
    path, given = located(document, text)
    return document.put(path, given)


def located(document: Node, text: str) -> tuple[list[str], Node]:
    """The keys that lead to what a ``key=value`` changes, and the value; see `override`."""
    key, equals, value = text.partition("=")
    shown = f"--set {text}"
    if not equals or not key.strip():
        raise ScenarioError(
            f"'{text}' does not set anything", Where("--set"), "write key=value, for example gear.ratio=14"
        )
    try:
        given = parse(value.strip())
    except DocumentError as error:
        raise ScenarioError(f"cannot read the value: {error.message}", Where(shown)) from None
    if given.value == {} and not value.strip().startswith("{"):
        given = Node(None)
    moved = _moved(given, shown)
    return _path(document, key.strip(), moved), moved


def _moved(node: Node, file: str) -> Node:
    """The node as if written in ``file``."""
    value = node.value
    if isinstance(value, dict):
        value = {key: _moved(item, file) for key, item in value.items()}
    elif isinstance(value, list):
        value = [_moved(item, file) for item in value]
    return replace(node, value=value, file=file, line=0, key_lines={})


def patch(document: Node, key: str, given: Node) -> Node:
    """The document with the value at ``key`` replaced.

    Args:
        document: the scenario or sub-assembly.
        key: a path: ``block.parameter``, ``assembly.block.parameter``, ``parameters.name``, a bare parameter name, a
            path that begins with a section, or a block by itself where ``given`` is a whole block with its type.
        given: the new value; its place is named if the key leads nowhere.

    Raises:
        ScenarioError: no such place; names the nearest.
    """
    return document.put(_path(document, key, given), given)


def _path(document: Node, key: str, given: Node) -> list[str]:
    parts = key.split(".")
    blocks = dict((document.get("blocks") or Node({})).items())
    parameters = dict((document.get("parameters") or Node({})).items())
    where = given.where()
    if parts[0] in SECTIONS and parts[0] not in blocks:
        if parts[0] == "blocks" and len(parts) > 1:
            return ["blocks", *_in_block(blocks, parts[1:], given)]
        if parts[0] in ("initial", "tolerances") and len(parts) > 1:
            return [parts[0], ".".join(parts[1:])]
        if parts[0] == "parameters" and (len(parts) != 2 or parts[1] not in parameters):
            name = ".".join(parts[1:])
            raise ScenarioError(f"the scenario has no parameter '{name}'", where, nearest(name, parameters))
        if parts[0] in ("connect", "blocks"):
            raise ScenarioError(f"'{parts[0]}' cannot be changed this way", where, "edit the file")
        return parts
    if len(parts) == 1 and parts[0] in parameters:
        return ["parameters", parts[0]]
    return ["blocks", *_in_block(blocks, parts, given)]


def _in_block(blocks: dict[str, Node], parts: list[str], given: Node) -> list[str]:
    name, rest, where = parts[0], parts[1:], given.where()
    if name not in blocks:
        raise ScenarioError(f"'{'.'.join(parts)}' leads nowhere", where, nearest(name, [*blocks, *SECTIONS]))
    if not rest:
        if isinstance(given.value, dict) and "type" in given.value:
            return [name]
        remedy = f"write {name}.parameter=value, or the whole block: {name}={{type: ..., parameter: value}}"
        raise ScenarioError(f"'{name}' is a block, not a value", where, remedy)
    if is_assembly(blocks[name]):
        if rest[0] == "parameters" and len(rest) == 2:
            return [name, *rest]
        return [name, ".".join(rest)]
    return [name, ".".join(rest)]
