"""The page of numbers in the rules of the diagnosis, read from its code; called while the docs are built."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterable
from pathlib import Path

from tools.reference import code, prose, table

ROOT = Path(__file__).resolve().parent.parent

RULES = {
    "pairing": "Which two effects are tried together",
    "choice": "When an effect pays, and which of several",
    "trial": "How a model is scored",
    "verdict": "What the verdict needs",
    "screening": "What is odd about a recording",
}
"""Module of the diagnosis whose constants are rules: its title."""


def page() -> str:
    """The constants of the diagnosis' rules, with their values of today and their own sentences."""
    parts = [
        "# Numbers in the rules of the diagnosis",
        "",
        "Read from the code; [how diagnosis decides](../explanation/diagnosis.md) says what they are for.",
    ]
    for name, title in RULES.items():
        rows = [[code(", ".join(names)), value, prose(doc)] for names, value, doc in _constants(name)]
        if rows:
            parts += [
                "",
                f"## {title}",
                "",
                f"`diagnosis/{name}.py`",
                "",
                table(["constant", "value", "meaning"], rows),
            ]
    return "\n".join(parts) + "\n"


def _constants(module: str) -> Iterable[tuple[list[str], str, str]]:
    """Numbers assigned at the top of a module that have a sentence under them: names, value and sentence."""
    body = ast.parse((ROOT / "diagnosis" / f"{module}.py").read_text(encoding="utf-8")).body
    for statement, after in itertools.pairwise(body):
        if not (
            isinstance(statement, ast.Assign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        ):
            continue
        names = [node.id for node in ast.walk(statement.targets[0]) if isinstance(node, ast.Name)]
        try:
            value = ast.literal_eval(statement.value)
        except ValueError:
            continue
        values = value if isinstance(value, tuple) else (value,)
        if all(isinstance(number, int | float) for number in values):
            yield names, ", ".join(f"{number:g}" for number in values), str(after.value.value)
