"""A scenario inside an FMU that runs in Python: its files and how they are read again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.files import scenario_files
from scenarios.load import load

if TYPE_CHECKING:
    from engine.model import Model
    from flexarm.cut import Cut

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


def model(folder: Path, recipe: dict[str, Any]) -> Model:
    """The model of a recipe; called when the FMU is loaded."""
    return load(folder / recipe["scenario"], recipe["overrides"]).build(recipe["inputs"], recipe["outputs"])
