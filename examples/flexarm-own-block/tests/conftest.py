"""The recordings of the rig, written once."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def rig():
    """The scenario, after rig.py has written its recordings beside it."""
    folder = Path(__file__).parent.parent
    subprocess.run([sys.executable, "rig.py"], cwd=folder, check=True)
    return folder / "wheel.yaml"
