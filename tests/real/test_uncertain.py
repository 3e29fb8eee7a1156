"""Bounds on responses of real rigs that were not fitted, and the page that tells them."""

from __future__ import annotations

from pathlib import Path

from flexarm.api import uncertain
from flexarm.commands.uncertain import uncertain_page


def test_the_flexible_stage_and_emps_lie_within_their_bounds(recordings: Path) -> None:
    """Responses that were not fitted, of real rigs: 95 % of the bins are to lie within."""
    for name in ("flexible-joint-stage", "emps"):
        assert 0.9 <= uncertain(name, samples=20, workers=1).coverage <= 0.98, name


def test_the_page_lists_parameters_of_the_model_alone(recordings: Path) -> None:
    page = uncertain_page(uncertain("flexible-joint-stage", samples=2, workers=1), "stage")
    table = page[page.index("  parameter") : page.index("  held out")].splitlines()[1:]
    assert [row.split()[0] for row in table] == ["joint.stiffness", "joint.damping", "arm.inertia"]
