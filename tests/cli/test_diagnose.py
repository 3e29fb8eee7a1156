"""``flexarm diagnose --longest``: what is no time is refused before anything is read."""

from __future__ import annotations

from typing import Any

import pytest

from diagnosis.api import diagnose
from engine.errors import FlexarmError


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
