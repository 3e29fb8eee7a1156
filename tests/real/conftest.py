"""Other people's recordings, which stay outside the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from diagnosis.recordings.paths import VARIABLE


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder that the environment variable names; docs/real-recordings.md says what belongs into it."""
    folder = os.environ.get(VARIABLE, "")
    if not folder:
        pytest.skip(f"{VARIABLE} is not set: these recordings are not flexarm's to distribute")
    return Path(folder)
