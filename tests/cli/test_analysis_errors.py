"""What is wrong in an analysis of the file is told with its file, line and key, by `check` and by the command."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SCENARIO = """\
schema: 1
name: axis
blocks:
  source: {type: Constant, value: 0 N}
  motor: {type: Force}
  guide: {type: TranslationalBearingFriction, coulomb_friction: 1 N, viscous_friction: 200 N.s/m}
  carriage: {type: Mass, mass: 95 kg}
connect:
  - [source.out, motor.force]
  - [motor.flange, guide.slide, carriage.flange]
analyses:
  first:
    kind: %s
    inputs: [motor.force]
    outputs: [carriage.flange.position]
    %s
"""


@pytest.mark.parametrize(
    ("kind", "line", "path", "piece"),
    [
        ("linearise", "modes: {gide: stuck}", "modes", "did you mean 'guide'?"),
        (
            "linearise",
            "modes: {guide: sliding}",
            "modes.guide",
            "forward' or 'sliding backward'?",
        ),
        ("linearise", "at: {guide.slide.sped: 1 m/s}", "at", "did you mean 'guide.slide.speed'?"),
        ("linearise", "at: {guide.slide.speed: 1 rad}", "at.guide.slide.speed", "'m/s' is expected"),
        ("linearise", "trim: level", "trim", "no analysis 'level' of kind trim"),
        ("linearise", "grid: {carriage.mas: '1:2:3'}", "grid", "did you mean 'carriage.mass'?"),
        ("margins", "grid: {carriage.mass: '1:2'}", "grid.carriage.mass", "START:STOP:N"),
        ("trim", "fix: {carriage.flange.positon: 1}", "fix", "did you mean 'carriage.flange.position'?"),
        ("trim", "fix: {carriage.flange.position: 1 rad}", "fix.carriage.flange.position", "'m' is expected"),
        ("trim", "free: [motor.forse]", "free", "did you mean 'motor.force'?"),
        ("trim", "bounds: {motor.force: [1 N, 1 rad]}", "bounds.motor.force", "'N' is expected"),
    ],
)
def test_they_point_there(
    kind: str, line: str, path: str, piece: str, command: Callable[..., Any], tmp_path: Path
) -> None:
    file = tmp_path / "axis.yaml"
    file.write_text(SCENARIO % (kind, line), encoding="utf-8")
    for name in ("check", kind):
        answer = command(name, str(file))
        assert answer.code == 1, (name, answer.out)
        assert f"axis.yaml:16: analyses.first.{path}" in answer.err, answer.err
        assert piece in answer.err, answer.err


def test_what_the_command_line_says_points_elsewhere(command: Callable[..., Any], tmp_path: Path) -> None:
    file = tmp_path / "axis.yaml"
    file.write_text(SCENARIO % ("linearise", "modes: {guide: stuck}"), encoding="utf-8")
    for arguments in (["--mode", "gide=stuck"], ["--at", "guide.slide.sped=1"], ["--grid", "carriage.mas=1:2:3"]):
        answer = command("linearise", str(file), *arguments)
        assert answer.code == 1
        assert "axis.yaml:" not in answer.err
        assert "did you mean" in answer.err


def test_an_input_that_is_none_is_shown_in_the_analysis_that_was_asked_for(
    command: Callable[..., Any], tmp_path: Path
) -> None:
    """Though another analysis names it as well."""
    file = tmp_path / "axis.yaml"
    text = SCENARIO.replace("inputs: [motor.force]", "inputs: [guide.slide.speed]") % ("linearise", "trim: ''")
    text = text.replace("    trim: ''\n", "")
    first = text[text.index("  first:") :]
    further = first.replace("first:", "second:").replace("[guide.slide.speed]", "[motor.force, guide.slide.speed]")
    file.write_text(text + further, encoding="utf-8")
    for analysis, line, place in (("first", 14, "inputs[0]"), ("second", 18, "inputs[1]")):
        answer = command("linearise", str(file), "-a", analysis)
        assert answer.code == 1
        assert f"axis.yaml:{line}: analyses.{analysis}.{place}: 'guide.slide.speed' is not an input" in answer.err
