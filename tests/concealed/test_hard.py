"""The hard cases, diagnosed: each is named, at its place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import flexarm
from benchmarks.concealed.case import draw
from benchmarks.concealed.rigs.hard import HARD, hard
from benchmarks.concealed.scenario import write

QUICK = ("hard-low-noise", "hard-held-still")
"""Those that do not take minutes."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in HARD]
)
def test_it_is_named_at_its_place(name: str, tmp_path: Path) -> None:
    """The answer is what the rig was made with; the tool sees the scenario and the recordings alone."""
    case = HARD[name]
    write(draw(name, case.effects, case.sizes, 0, case.options), tmp_path / "case", tmp_path / "sealed")
    found = flexarm.diagnose(tmp_path / "case" / "scenario.yaml", workers=2)
    (answers,) = (tmp_path / "sealed").glob("*.json")
    (concealed,) = json.loads(answers.read_text(encoding="utf-8"))["concealed"]
    assert found.verdict == "named", found.findings
    (finding,) = found.findings
    assert finding["effect"] == concealed["effect"]
    assert _is_at(name, finding["place"], concealed["place"], concealed["same_place"])
    assert finding["probability"] >= 0.95
    assert finding["explained"] > 0.5


def _is_at(name: str, told: str, place: str, same: list[str]) -> bool:
    """Whether a place has a name of the true one; that of a joint, a flange before the cut and one behind it.

    Which flange of a side is named depends on their order in the scenario alone.
    """
    topology = hard(name).topology
    cut = topology.joined(place)
    if cut is None:
        return told in {place, *same}
    inner, outer = told.split(" -> ")
    near, far = topology.nodes[cut][: topology.cuts[cut]], topology.nodes[cut][topology.cuts[cut] :]
    return inner in near and outer in far
