"""The hard cases, diagnosed: each is named, at its place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import flexarm
from benchmarks.concealed.case import draw
from benchmarks.concealed.rigs.hard import HARD
from benchmarks.concealed.scenario import write

QUICK = ("hard-low-noise", "hard-held-still")
"""Those that do not take minutes."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in HARD]
)
def test_it_is_named_at_its_place(name: str, tmp_path: Path) -> None:
    """The answer is what the rig was made with; the tool sees the scenario and the recordings alone."""
    hard = HARD[name]
    write(draw(name, hard.effects, hard.sizes, 0, hard.options), tmp_path / "case", tmp_path / "sealed")
    found = flexarm.diagnose(tmp_path / "case" / "scenario.yaml", workers=2)
    (answers,) = (tmp_path / "sealed").glob("*.json")
    (concealed,) = json.loads(answers.read_text(encoding="utf-8"))["concealed"]
    assert found.verdict == "named", found.findings
    (finding,) = found.findings
    assert finding["effect"] == concealed["effect"]
    # A joint may be called by any flange on either of its sides.
    flanges = {*concealed["place"].split(" -> "), *concealed["same_place"]}
    assert finding["place"] == concealed["place"] or set(finding["place"].split(" -> ")) <= flanges
    assert finding["probability"] >= 0.95
    assert finding["explained"] > 0.5
