"""A scenario inside an FMU that runs in Python: its files and how they are read again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.load import load

if TYPE_CHECKING:
    from engine.model import Model
    from flexarm.api import Cut
    from scenarios.load import Scenario

LOADER = "flexarm.recipe:model"


def recipe(made: Cut) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What `model` needs to know, and the files it reads, by path in the archive's resources."""
    main, files = scenario_files(made.scenario)
    return {
        "scenario": main,
        "overrides": list(made.scenario.overrides),
        "inputs": list(made.settings.inputs),
        "outputs": list(made.settings.outputs),
    }, files


def scenario_files(scenario: Scenario) -> tuple[str, dict[str, bytes]]:
    """Name of the scenario's file, and it and the files it reads, by path below a common folder."""
    paths = [path.resolve() for path in scenario.flat.files]
    for block in scenario.system.blocks.values():
        for option in getattr(type(block), "files", ()):
            name = getattr(block, option)
            if name:
                paths.append(Path(name).resolve())
    root = Path(os.path.commonpath([path.parent for path in paths]))
    files = {f"scenario/{path.relative_to(root).as_posix()}": path.read_bytes() for path in paths}
    return f"scenario/{scenario.path.resolve().relative_to(root).as_posix()}", files


def model(folder: Path, recipe: dict[str, Any]) -> Model:
    """The model of a recipe; called when the FMU is loaded."""
    return load(folder / recipe["scenario"], recipe["overrides"]).build(recipe["inputs"], recipe["outputs"])
