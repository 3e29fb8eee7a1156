"""Numbers that decide something stand in one module, each with its unit, its reason and what set it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, fields
from pathlib import Path
from typing import Any

import pytest

from diagnosis import thresholds

ROOT = Path(__file__).resolve().parents[2]
DECIDING = ("estimation", "search", "verdict")
"""Rooms in which no module-level number may stand."""

NO_RULES = {
    ("verdict/figures.py", "DWARFS"),
    ("verdict/figures.py", "FAINT"),
    ("verdict/figures.py", "PLACES"),
    ("verdict/write.py", "THINNED"),
    ("verdict/write.py", "NEARLY_NOTHING"),
    ("estimation/time_experiment.py", "WINDOW"),
    ("estimation/initial_states.py", "_INDEPENDENT"),
    ("estimation/initial_states.py", "_ROUNDS"),
    ("search/dask_fitter.py", "STUDIES"),
    ("search/fitter.py", "KEPT"),
    ("search/study.py", "LEAST_ODDS"),
    ("estimation/least_squares.py", "UNDETERMINED"),
    ("verdict/examination.py", "SAME_DRIVE"),
}
"""What is drawn, printed, kept, or a rounding error."""


def numbers_of(path: Path) -> Iterator[Any]:
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(statement, ast.Assign):
            continue
        try:
            value = ast.literal_eval(statement.value)
        except ValueError:
            continue
        values = value if isinstance(value, tuple) else (value,)
        if values and all(isinstance(v, int | float) for v in values):
            yield from (node.id for node in ast.walk(statement.targets[0]) if isinstance(node, ast.Name))


def test_no_number_that_decides_stands_elsewhere() -> None:
    rooms = [p for room in DECIDING for p in (ROOT / "diagnosis" / room).rglob("*.py")]
    found = {
        (str(path.relative_to(ROOT / "diagnosis")), name)
        for path in [*rooms, ROOT / "diagnosis" / "problems.py"]
        for name in numbers_of(path)
    }
    assert found == NO_RULES


@pytest.mark.parametrize("group", thresholds.GROUPS, ids=lambda group: type(group).__name__)
def test_each_has_unit_reason_and_what_set_it(group: Any) -> None:
    for field in fields(group):
        assert set(field.metadata) == {"unit", "reason", "set_by"}, field.name
        assert all(field.metadata.values()), field.name
        assert field.metadata["reason"].endswith("."), field.name
    with pytest.raises(FrozenInstanceError):
        setattr(group, fields(group)[0].name, 0)


def test_every_number_is_used() -> None:
    text = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "diagnosis").rglob("*.py"))
    constants = {id(value): name for name, value in vars(thresholds).items()}
    for group in thresholds.GROUPS:
        for field in fields(group):
            assert f"{constants[id(group)]}.{field.name}" in text
