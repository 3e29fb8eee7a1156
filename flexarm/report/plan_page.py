"""The report of a plan: what would show, what ties, and what would settle the ties."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from diagnosis.planning.wording import apart_sentences, cannot_tell, input_sentence, sensor_sentence, size_in_words
from flexarm.report.origin import origin
from flexarm.report.page import render, write_page

if TYPE_CHECKING:
    from diagnosis.planning.plan import Plan

APART, OPEN, STAYS, ITSELF = "·", "○", "●", ""
"""Signs of the matrix: told apart, tied at the first size, and at the last; an effect against itself."""

LISTED = 8
"""Inputs and sensors that are listed."""


def write_plan(found: Plan, path: Path, *, command: str = "") -> Path:
    """Write the report of a plan.

    Args:
        found: the plan.
        path: the .html file to write; it appears whole or not at all.
        command: the command line, for the part on repeating it.

    Raises:
        FlexarmError: the file cannot be written.
    """
    first = found.multiples[0]
    now, pairs = found.apart(first), found.pairs[first]
    text = render(
        "plan.html.j2",
        [],
        title=f"{found.scenario.name}: plan",
        scenario=found.scenario,
        sensors=found.planned.sensors,
        assumed=found.planned.assumed,
        first=first,
        last=found.multiples[-1],
        rows=[(row, size_in_words(row), cannot_tell(row, found)) for row in found.shown],
        hidden=[row for row in found.rows if not row.shows],
        numbers=[row.number for row in found.shown],
        matrix=[(row, [_sign(found, row.number, other.number) for other in found.shown]) for row in found.shown],
        sentences=[*apart_sentences(found), input_sentence(found), sensor_sentence(found)],
        inputs=[(one.kind, one.sentence, now + len(one.settles), pairs) for one in found.inputs[:LISTED]],
        further=[(one.sensor, now + len(one.settles), pairs) for one in found.sensors[:LISTED]],
        failures=found.failures,
        origin=origin(found.scenario, command=command),
    )
    return write_page(path, text)


def _sign(found: Plan, one: int, other: int) -> str:
    """The sign of a pair of rows."""
    if one == other:
        return ITSELF
    pair = (min(one, other), max(one, other))
    if pair in found.tied[found.multiples[-1]] and len(found.multiples) > 1:
        return STAYS
    return OPEN if pair in found.tied[found.multiples[0]] else APART
