"""Turn checked documents into one flat `System`: make blocks, include sub-assemblies, resolve names."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engine.block import Block
from engine.errors import FlexarmError, ParameterError, Where, nearest
from engine.files import is_file
from engine.quantity import Option, compatible
from engine.system import Connection, Formula, System, resolved
from scenarios.common import Common, Scope, lookup, read_by, root_scope, substitute, term, worked_out
from scenarios.document import Node, read
from scenarios.expressions import PLAIN, is_expression
from scenarios.patch import is_assembly, patch
from scenarios.validate import ScenarioError, validate

MOST_BLOCKS = 10_000

Finder = Callable[[str], type[Block]]


@dataclass
class Flat:
    """The result of flattening.

    Attributes:
        system: blocks and connections.
        exposed: further names of inner ports.
        initial: starting values as written, by resolved name.
        files: every file read.
    """

    system: System
    exposed: dict[str, str] = field(default_factory=dict)
    initial: dict[str, Node] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)

    def resolve(self, name: str) -> str:
        """An endpoint or signal name with exposed names replaced by what they stand for."""
        return resolved(name, self.exposed)


def flatten(document: Node, path: Path, find: Finder) -> Flat:
    """Make the blocks of a scenario and of every sub-assembly in it.

    Args:
        document: the outermost file, already checked and patched.
        path: where it lies.
        find: block class by name; raises `FlexarmError` with the nearest name.

    Raises:
        FlexarmError: the first problem, with its place.
    """
    system = System({}, [], name=str(document.get("name").value) if document.get("name") else path.stem)  # type: ignore[union-attr]
    work = _Flattener(Flat(system), find)
    work.add(document, path, "", root_scope(document), ())
    work.finish()
    return work.flat


class _Flattener:
    def __init__(self, flat: Flat, find: Finder) -> None:
        self.flat, self.find = flat, find
        self.system = flat.system
        self.units: dict[str, tuple[str, str]] = {}
        self.read: dict[Path, Node] = {}

    def add(self, document: Node, path: Path, prefix: str, scope: Scope, above: tuple[Path, ...]) -> None:
        absolute = path.resolve()
        self.flat.files.append(path)
        for name, entry in document.get("blocks").items():  # type: ignore[union-attr]
            where = document.where("blocks", name)
            if is_assembly(entry):
                self.assembly(document, path, name, prefix, scope, (*above, absolute))
            else:
                self.block(document, path, name, prefix, scope)
            if len(self.system.blocks) > MOST_BLOCKS:
                raise ScenarioError(f"the scenario has more than {MOST_BLOCKS} blocks", where)
        for i, node in enumerate((document.get("connect") or Node([])).value):
            ends = tuple(prefix + str(end) for end in node.plain())
            self.system.connections.append(Connection(ends, document.where("connect", i)))
        for name, node in (document.get("expose") or Node({})).items():
            if prefix + name in self.system.blocks or document.get("blocks", name):
                raise ScenarioError(f"'{name}' is already the name of a block", document.where("expose", name))
            self.flat.exposed[prefix + name] = prefix + str(node.value)
        for name, node in (document.get("initial") or Node({})).items():
            value = Node(substitute(node, scope, document.where("initial", name)), node.file, node.line)
            where = document.where("initial", name)
            self.flat.initial[prefix + name] = replace(value, line=where.line)
            self.fix(node, scope, where, prefix + name)

    def assembly(
        self, document: Node, path: Path, name: str, prefix: str, scope: Scope, above: tuple[Path, ...]
    ) -> None:
        entry = document.get("blocks", name)
        assert entry is not None
        given = str(entry.get("type").value)  # type: ignore[union-attr]
        where = document.where("blocks", name, "type")
        target = path.parent / given
        if not is_file(target):
            siblings = [f"./{p.name}" for p in sorted(path.parent.glob("*.y*ml"))]
            raise ScenarioError(f"there is no file '{target}'", where, nearest(given, siblings))
        if target.resolve() in above:
            chain = " -> ".join(p.name for p in (*above, target.resolve()))
            raise ScenarioError(f"a sub-assembly includes itself: {chain}", where, "name another file")
        inner = self.read.get(target)
        if inner is None:
            inner = self.read[target] = read(target, os.path.normpath(target))
        common: Scope = {}
        for key, node in entry.items():
            if key == "type":
                continue
            if key == "parameters":
                for inner_name, value in node.items():
                    inner = patch(inner, f"parameters.{inner_name}", _scoped(value, scope))
            else:
                inner = patch(inner, key, _scoped(node, scope))
        validate(inner)
        for inner_name, node in (inner.get("parameters") or Node({})).items():
            if node.scope is not None and isinstance(node.value, str) and PLAIN.fullmatch(node.value):
                common[inner_name] = lookup(node.value, node.scope, node.where())
            else:
                common[inner_name] = Common(f"{prefix}{name}.{inner_name}", node, common)
        self.add(inner, target, f"{prefix}{name}.", common, above)

    def block(self, document: Node, path: Path, name: str, prefix: str, scope: Scope) -> None:
        entry = document.get("blocks", name)
        assert entry is not None
        kind = entry.get("type")
        assert kind is not None
        try:
            cls = self.find(str(kind.value))
        except FlexarmError as error:
            raise error.at(document.where("blocks", name, "type")) from None
        full = prefix + name
        values: dict[str, Any] = {}
        laws: dict[str, tuple[str | Formula, Where]] = {}
        lists: dict[str, tuple[Node, Scope, Where]] = {}
        files = {
            key: str(path.parent / str(node.value)) for key, node in entry.items() if key in getattr(cls, "files", ())
        }
        further = {declared.name: declared for declared in cls.further_parameters(files)}
        known = [*cls.parameters, *cls.options, *further]
        for key, node in entry.items():
            if key != "type" and key not in known:
                # '{resistance: 2,6 ohm}' is a resistance of 2 and a key '6 ohm' without a value.
                comma = node.value is None and key[:1].isdigit()
                if "." in key and not further:
                    raise ScenarioError(
                        f"'{name}.{key}' leads nowhere: '{name}' is a single block",
                        document.where("blocks", name, key),
                        f"write {name}.parameter=value",
                    )
                raise ScenarioError(
                    f"{cls.__name__} has no parameter '{key}'",
                    document.where("blocks", name, key),
                    "write numbers with a decimal point, as in 2.6 ohm" if comma else nearest(key, known),
                )
        for key, node in entry.items():
            if key == "type":
                continue
            where = document.where("blocks", name, key)
            declared = cls.parameters.get(key) or cls.options.get(key) or further[key]
            inner = node.scope if node.scope is not None else scope
            made = None if getattr(declared, "kind", None) is str else term(node.value, inner, where)
            if made is not None:
                value = worked_out(made, where)
                if isinstance(declared, Option) and isinstance(value, float) and value.is_integer():
                    value = int(value)
            elif getattr(declared, "kind", None) is str and is_expression(node.value):
                value = node.value  # a text, such as $FLEXARM_RECORDINGS/table.csv
            else:
                value = substitute(node, scope, where)
            if value is None or isinstance(value, dict):
                raise ScenarioError(
                    f"no value is given for '{key}'" if value is None else f"'{key}' takes a value, not a mapping",
                    where,
                    declared.doc,
                )
            size = getattr(declared, "size", "")
            try:
                for item in value if size and isinstance(value, list) else [value]:
                    declared.check(item)
            except ParameterError as error:
                error.remedy = error.remedy or f"{key}: {declared.doc}"
                if made is not None:
                    error.message += f" (the value of {node.value})"
                elif isinstance(node.value, str) and node.value.startswith("$"):
                    used = lookup(node.value, node.scope if node.scope is not None else scope, where)
                    error.message += f" (the value of {node.value}: {used.node.where()})"
                raise error.at(where) from None
            values[key] = files.get(key, value)
            if getattr(declared, "kind", None) is str:
                continue
            if key not in cls.parameters or cls.parameters[key].structural:
                self.fix(node, inner, where, f"{full}.{key}")
            elif size:
                lists[key] = (node, inner, where)
            elif (law := _law(node, inner, where)) is not None:
                laws[key] = (law, where)
        place = document.where("blocks", name)
        try:
            block = self.system.blocks[full] = cls(**values)
        except FlexarmError as error:
            raise error.at(place) from None
        self.system.places[full] = place
        for key, (node, inner, where) in lists.items():
            for i in range(len(block.values[key])):
                one: Node = node.value[i] if isinstance(node.value, list) else node
                if (law := _law(one, inner, where)) is not None:
                    laws[f"{key}[{i + 1}]"] = (law, where)
        for key, (law, where) in laws.items():
            if isinstance(law, str):
                self.share(law, full, key, block.unit_of(key.partition("[")[0]), where)
            else:
                self.system.shared.setdefault(full, {})[key] = law

    def share(self, common: str, block: str, key: str, unit: str, where: Where) -> None:
        first = self.units.setdefault(common, (unit, f"{block}.{key}"))
        if not compatible(first[0], unit):
            raise ScenarioError(
                f"'${common}' is used for {first[1]} in {first[0]} and for {block}.{key} in {unit}",
                where,
                "declare two parameters",
            )
        self.system.shared.setdefault(block, {})[key] = common

    def fix(self, node: Node, scope: Scope, where: Where, name: str) -> None:
        """Note which common parameters give what a model is built with, and cannot be tuned in it."""
        for common in dict.fromkeys(read_by(node, scope, where)):
            self.system.fixed[common] = (*self.system.fixed.get(common, ()), name)

    def finish(self) -> None:
        """Replace exposed names in connections and starting values."""
        resolve, self.system.exposed = self.flat.resolve, self.flat.exposed
        self.system.connections = [
            replace(c, ends=tuple(resolve(end) for end in c.ends)) for c in self.system.connections
        ]
        self.flat.initial = {resolve(name): node for name, node in self.flat.initial.items()}
        self.system.fixed = {
            common: tuple(resolve(name) for name in names) for common, names in self.system.fixed.items()
        }


def _law(node: Node, scope: Scope, where: Where) -> str | Formula | None:
    """The common parameter that a value is, or a formula of those that it reads; None if it reads none."""
    scope = node.scope if node.scope is not None else scope
    made = term(node.value, scope, where)
    if made is not None and made.leaves:
        return Formula(str(node.value), {name: (leaf.unit, leaf.value) for name, leaf in made.common().items()}, made)
    plain = isinstance(node.value, str) and PLAIN.fullmatch(node.value)
    return lookup(node.value, scope, where).name if plain else None


def _scoped(node: Node, scope: Scope) -> Node:
    return node if node.scope is not None else replace(node, scope=scope)
