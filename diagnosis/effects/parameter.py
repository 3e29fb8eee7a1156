"""A parameter of the model that is wrong by more than its tolerance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import OperatingScales

FACTOR = 1.0
"""Standard deviation of the logarithm of the factor by which a parameter is wrong, or of its relative error."""


def wrong_parameters(scales: OperatingScales) -> Iterator[Candidate]:
    """Each parameter with a tolerance, freed of it."""
    for f in scales.problem.free:
        if f.recording:
            continue
        block, _, key = f.name.rpartition(".")
        place = block or f.name
        factors = ({key: factor * f.start} for factor in scales.factors)
        freed = replace(f, prior=False, spread=FACTOR / (f.scale if f.logarithmic else f.scale / abs(f.start)))
        yield Candidate("wrong_parameter", f.name, place, place, lambda values: [], starts=({}, *factors), freed=freed)
