"""The page of numbers in the rules of the diagnosis, made from `diagnosis.thresholds` while the docs are built."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from diagnosis import thresholds
from tools.reference import code, prose, table


def page() -> str:
    """Every number that decides something in a diagnosis: value, unit, reason, and what set it."""
    parts = [
        "# Numbers in the rules of the diagnosis",
        "",
        "Every number that decides something, as it stands in `diagnosis/thresholds.py`.",
        "[How diagnosis decides](../explanation/diagnosis/index.md) says what they are for. A commit in parentheses",
        "set the value; suites are those of [the proof](../proof.md). Tolerances of numerical methods stand beside",
        "the method.",
    ]
    for group in thresholds.GROUPS:
        rows = [
            [
                code(f.name),
                _shown(getattr(group, f.name)),
                f.metadata["unit"],
                prose(f.metadata["reason"]),
                f.metadata["set_by"],
            ]
            for f in fields(group)
        ]
        headings = ["number", "value", "unit", "reason", "set by"]
        parts += ["", f"## {type(group).__name__}", "", str(type(group).__doc__), "", table(headings, rows)]
    return "\n".join(parts) + "\n"


def _shown(value: Any) -> str:
    values = value if isinstance(value, tuple) else (value,)
    return ", ".join(f"{number:g}" for number in values)
