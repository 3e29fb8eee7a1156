"""The files of a plan."""

from __future__ import annotations

from pathlib import Path

from diagnosis.planning.plan import Plan
from engine.files import folder_made, json_text, writing


def write(found: Plan, folder: Path) -> list[Path]:
    """Write ``plan.json`` and ``plan.png``; each appears whole or not at all.

    Raises:
        FlexarmError: the folder cannot be written.
    """
    from diagnosis.planning import figures

    folder_made(folder)
    made = folder / "plan.json"
    with writing(made, (".json",)) as temporary:
        temporary.write_text(json_text(found.numbers(), indent=2) + "\n", encoding="utf-8")
    return [made, figures.matrix(found, folder / "plan.png")]
