"""Which of several models keep up while ever more of the recordings is fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.estimation import growing
from diagnosis.thresholds import SEARCH


def test_half_of_the_models_is_dropped_at_each_doubling_once_the_recordings_tell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Model 5 is the right one: it looks worst over the first instants, and best from an eighth on."""
    tried: dict[float, list[int]] = {}

    def fitted(made: Any, x: NDArray[np.float64], share: float, *_: Any) -> tuple[NDArray[np.float64], float]:
        tried.setdefault(share, []).append(made)
        early = share < SEARCH.telling
        return x + 1, float((9 if early else -1) if made == 5 else made)

    monkeypatch.setattr(growing, "_fitted", fitted)
    models: list[Any] = list(range(8))
    found = growing.raced([(made, np.zeros(1)) for made in models])
    assert [len(tried[share]) for share in sorted(tried)] == [8, 8, 8, 4, 2]
    ((number, x),) = found
    assert number == 5
    assert x == len(tried), "it goes on from where it ended"
