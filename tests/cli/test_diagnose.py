"""``flexarm diagnose --longest``: what is no time is refused, and what was cut short goes on with more."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from diagnosis.api import diagnose
from diagnosis.effects.catalogue import EFFECTS
from engine.errors import FlexarmError
from flexarm.commands.diagnose import PROGRESS
from tests.diagnosis.plants import case

TRIED = ("coulomb_friction", "dead_zone")


@pytest.mark.parametrize("text", ["3 kg", "-1 min", "soon"])
def test_what_is_no_time_is_refused(command: Any, text: str) -> None:
    answer = command("diagnose", "nowhere.yaml", "--longest", text)
    assert answer.code != 0
    assert "--longest" in answer.err
    assert text.split()[0] in answer.err
    assert "nowhere" not in answer.err


@pytest.mark.parametrize("longest", [0.0, -1.0, float("nan")])
def test_a_search_without_time_is_refused(longest: float) -> None:
    with pytest.raises(FlexarmError, match="finds nothing"):
        diagnose("nowhere.yaml", longest=longest)


def test_a_search_that_was_cut_short_goes_on_with_more_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    """A millisecond is over after the model's own parameters are fitted; friction is found without the limit."""
    monkeypatch.chdir(tmp_path)
    path, out = case(tmp_path, coulomb=4.0e-4, seed=3), tmp_path / "out"
    given = ["diagnose", path.name, "-o", "out", "--without", ",".join(sorted(set(EFFECTS) - set(TRIED)))]

    def told() -> Any:
        return json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))

    early = command(*given, "--longest", "1 ms")
    assert early.code == 0, early.err
    assert "the time that was allowed was over" in early.out
    assert told()["ended_early"]
    assert told()["verdict"] != "named"
    kept = len(list((out / PROGRESS).iterdir()))
    assert kept > 0
    assert command(*given).code == 0
    assert not told()["ended_early"]
    assert [f["effect"] for f in told()["findings"]] == ["coulomb_friction"]
    assert not (out / PROGRESS).exists()
