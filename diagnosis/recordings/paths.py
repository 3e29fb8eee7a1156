"""Where a recording's file lies."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from diagnosis.recordings.columns import RecordingError
from engine.errors import nearest

if TYPE_CHECKING:
    from scenarios.load import Scenario

VARIABLE = "FLEXARM_RECORDINGS"
"""Environment variable that names the folder of recordings which are not flexarm's to distribute."""


def location(scenario: Scenario, name: str) -> Path:
    """The file of a recording of a scenario.

    Args:
        scenario: describes the recording.
        name: of the recording.

    Raises:
        RecordingError: the file starts with a variable that is not `VARIABLE`, or that is unset or names no folder.
    """
    file = scenario.recordings[name].file
    if not file.startswith("$"):
        return scenario.path.parent / file
    where = scenario.where("recordings", name, "file")
    variable, _, rest = file[1:].replace("\\", "/").partition("/")
    variable = variable.strip("{}")
    if variable != VARIABLE:
        raise RecordingError(
            f"'${variable}' is not known in '{file}'",
            where,
            nearest(variable, [VARIABLE]) or f"files begin with ${VARIABLE}, or are relative to the scenario",
        )
    folder = os.environ.get(VARIABLE, "")
    if not folder:
        raise RecordingError(
            f"recording '{name}' lies in the folder named by the environment variable {VARIABLE}, which is not set",
            where,
            "docs/real-recordings.md says where each can be had; set the variable to the folder you put them in",
        )
    if not Path(folder).is_dir():
        raise RecordingError(
            f"{VARIABLE} is '{folder}', which is no folder", where, "set it to the folder that holds the recordings"
        )
    return Path(folder) / rest


def at_hand(scenario: Scenario, name: str) -> bool:
    """Whether a recording lies in the scenario's own folder, or in one that is named."""
    return not scenario.recordings[name].file.startswith("$") or bool(os.environ.get(VARIABLE))
