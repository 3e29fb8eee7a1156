"""The file of a recording: beside the scenario, or in a folder of the user."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from diagnosis.recordings.columns import RecordingError
from engine.errors import Where, nearest

if TYPE_CHECKING:
    from scenarios.load import Scenario

VARIABLE = "FLEXARM_RECORDINGS"
"""Environment variable with the folder of recordings that flexarm may not distribute."""


def recording_path(scenario: Scenario, name: str) -> Path:
    """The file of a recording of a scenario.

    Args:
        scenario: describes the recording.
        name: of the recording.

    Raises:
        RecordingError: the path starts with a variable other than `VARIABLE`, or `VARIABLE` is unset or no folder.
    """
    return named_path(scenario, name, scenario.recordings[name].file, scenario.where("recordings", name, "file"))


def named_path(scenario: Scenario, name: str, file: str, where: Where) -> Path:
    """A file that a recording names; see `recording_path`."""
    if not file.startswith("$"):
        return scenario.path.parent / file
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
            "docs/real-recordings.md says where to get each; set the variable to the folder that holds them",
        )
    if not Path(folder).is_dir():
        raise RecordingError(
            f"{VARIABLE} is '{folder}', which is not a folder", where, "set it to the folder that holds the recordings"
        )
    return Path(folder) / rest


def is_available(scenario: Scenario, name: str) -> bool:
    """Whether the folder of a recording is known: the scenario's own, or one that `VARIABLE` names."""
    return not scenario.recordings[name].file.startswith("$") or bool(os.environ.get(VARIABLE))
