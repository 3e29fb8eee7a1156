"""What the command line imports before it answers: what an answer does not need is not waited for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

NEVER = {
    "control",
    "jinja2",
    "markdown_it",
    "matplotlib",
    "pandas",
    "pint",
    "pyarrow",
    "rich",
    "scipy",
    "xarray",
}
"""Packages that neither help nor a run needs."""
RUNNING = {"blocks", "casadi", "diagnosis", "engine.model", "fmu", "numpy", "ruamel", "scenarios"}
"""What reads and runs a scenario."""


def imported(folder: Path, *given: str) -> set[str]:
    """The modules that are imported when the command has answered; of those of others, the packages too."""
    program = "import atexit, sys; from pathlib import Path\n"
    program += "atexit.register(lambda: Path('modules').write_text(' '.join(sys.modules)))\n"
    program += "from flexarm.cli import main; main()"
    environment = {name: value for name, value in os.environ.items() if name != "_FLEXARM_COMPLETE"}
    run = [sys.executable, "-c", program, *given]
    environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(run, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return set((folder / "modules").read_text().split())


@pytest.mark.parametrize("given", [["--help"], ["--version"], ["diagnose", "--help"]])
def test_help_imports_nothing_that_reads_or_runs(tmp_path: Path, given: list[str]) -> None:
    found = imported(tmp_path, *given)
    assert "flexarm.cli" in found
    assert not found & (NEVER | RUNNING)


def test_a_run_imports_its_own_blocks_alone(tmp_path: Path) -> None:
    found = imported(tmp_path, "run", "quanser-single-link")
    assert not found & (NEVER | {"diagnosis"})
    assert {"blocks.actuators.dc_motor", "blocks.actuators.gear"} <= found
    assert not found & {"blocks.actuators.harmonic_drive", "blocks.links.serial_arm", "blocks.controllers.pid"}
