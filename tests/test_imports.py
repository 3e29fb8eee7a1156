"""The import graph of the house has no circle, and no module of ``flexarm`` hides a public name."""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

import flexarm

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm", "benchmarks", "tools", "tests")

Graph = Mapping[str, set[str]]


def modules(root: Path, packages: Iterable[str]) -> dict[str, Path]:
    """Every module of the packages by its dotted name; a package stands for its ``__init__``."""
    found = {}
    for package in packages:
        for path in (root / package).rglob("*.py"):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(root: Path, packages: Iterable[str]) -> Graph:
    """What each module imports: at its head, inside functions, and for type checking alone."""
    paths = modules(root, packages)
    graph: dict[str, set[str]] = {}
    for name, path in paths.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        named: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
                base = ".".join([*above, *([node.module] if node.module else [])])
                # `from package import module` imports the package too, and all that it imports.
                named |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
        graph[name] = (named & paths.keys()) - {name}
    return graph


def circles(graph: Graph) -> list[list[str]]:
    """One shortest circle through each group of modules that import one another."""
    reached = {name: reachable(graph, name) for name in graph}
    groups = {frozenset(other for other in reached[name] if name in reached[other]) for name in graph}
    found = []
    for group in sorted(groups, key=sorted):
        if group:
            start = min(group)
            found.append(min((path(graph, after, start) for after in sorted(graph[start] & group)), key=len))
    return found


def reachable(graph: Graph, start: str) -> set[str]:
    """Modules that importing ``start`` leads to, itself included only if it lies on a circle."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        new = graph[waiting.pop()] - seen
        seen |= new
        waiting += new
    return seen


def path(graph: Graph, start: str, end: str) -> list[str]:
    """The shortest way from ``start`` to ``end``, as ``[end, start, ..., end]``."""
    before: dict[str, str] = {start: end}
    waiting = deque([start])
    while waiting and (name := waiting.popleft()) != end:
        for other in sorted(graph[name]):
            if other not in before:
                before[other] = name
                waiting.append(other)
    way = [end]
    while (name := before[way[-1]]) != end:
        way.append(name)
    return [end, *reversed(way)]


def test_no_import_circle() -> None:
    graph = imports(ROOT, PACKAGES)
    assert len(graph) > 200, "the packages were not found"
    found = [" -> ".join(circle) for circle in circles(graph)]
    assert not found, "import circles:\n" + "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "import house.b",
        "from house import b",
        "from house.b import name",
        "from . import b",
        "from .b import name",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.b import name",
        "def run():\n    from house import b",
    ],
)
def test_a_circle_is_found_and_named(tmp_path: Path, text: str) -> None:
    house = tmp_path / "house"
    house.mkdir()
    (house / "__init__.py").touch()
    (house / "a.py").write_text(text)
    (house / "b.py").write_text("from house import c")
    (house / "c.py").write_text("import house.a\nimport house.d")
    (house / "d.py").write_text("import os")
    found = circles(imports(tmp_path, ["house"]))
    assert found == [["house.a", "house.b", "house.c", "house.a"]]


def test_no_module_hides_a_public_name() -> None:
    # Importing `flexarm.sweep` would put the module in the place of the function of that name.
    taken = {name.split(".")[1] for name in modules(ROOT, ["flexarm"]) if "." in name}
    assert not taken & set(flexarm.__all__)
