"""Whatever the input: a result without NaN or an error that names a place; docs/robustness.md has the long counts."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from tests.robustness.guard import REFUSED, RESULT
from tests.robustness.properties import PROPERTIES

QUICK = {
    "documents": 60,
    "files": 40,
    "overrides": 40,
    "parameters": 150,
    "recordings": 120,
    "runs": 150,
    "quantities": 200,
    "blocks": 200,
    "points": 100,
    "foreign": 200,
    "anchors": 60,
    "pages": 40,
    "archives": 60,
    "states": 100,
    "caches": 20,
    "sweeps": 25,
    "foreign_fmus": 15,
}


@pytest.mark.parametrize("name", PROPERTIES)
def test_property(name: str) -> None:
    made = PROPERTIES[name]

    @settings(
        max_examples=QUICK[name],
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(made.strategy())
    def holds(example: object) -> None:
        assert made.check(example) in (RESULT, REFUSED)

    holds()
