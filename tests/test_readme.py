"""The scenario in the README is one that runs, and its diagnosis is that of the tutorial, whose commands are run."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

import flexarm

README = Path(__file__).parent.parent / "README.md"


def test_the_scenario_in_the_readme_runs(tmp_path: Path) -> None:
    text = README.read_text(encoding="utf-8")
    indented = re.search(r"(?m)^    schema: 1\n(?:    .*\n)+", text)
    assert indented is not None
    path = tmp_path / "arm.yaml"
    path.write_text(textwrap.dedent(indented.group(0)), encoding="utf-8")
    run = flexarm.simulate(flexarm.load(path))
    assert np.isfinite(run.values).all()
    # Steady speed under 0.82 V: the motor constant over the damping of the back-emf, without other friction.
    constant = 0.9 * 70 * 7.68e-3 / 2.6
    speed = 0.82 * constant / (0.9 * 70**2 * 7.68e-3**2 / 2.6)
    middle = np.searchsorted(run.time, 0.95)
    slope = np.gradient(run["link.hub.angle"], run.time)[middle]
    assert abs(slope / speed - 1) < 0.2


def test_every_command_of_the_readme_exists() -> None:
    from typer.main import get_command

    from flexarm.cli import app

    named = set(re.findall(r"`flexarm (\w+)", README.read_text(encoding="utf-8")))
    assert named >= {"run", "check", "linearise", "export", "compare"}
    group: Any = get_command(app)
    assert named <= set(group.commands)


def test_the_readme_shows_the_diagnosis_of_the_tutorial() -> None:
    shown = re.search(r"(?m)^    my-arm: named\n(?:    .*\n)+", README.read_text(encoding="utf-8"))
    assert shown is not None
    tutorial = (README.parent / "docs" / "tutorial" / "first-diagnosis.md").read_text(encoding="utf-8")
    assert textwrap.dedent(shown.group(0)) in tutorial
