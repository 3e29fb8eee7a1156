"""What a search has tried on a scenario and its recordings, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.effects.scales import OperatingScales
from diagnosis.recordings.types import Recorded
from diagnosis.search.scored_model import ScoredModel
from scenarios.load import Scenario


@dataclass(frozen=True)
class Study:
    """A scenario and its recordings, and everything tried on them.

    Attributes:
        scenario: the user's.
        recordings: of all roles.
        nominal: mean squared residual of the model as given, (train, hold-out).
        refit: the user's model with its parameters fitted.
        trials: single effects, best first, and pairs that may be taken for the chosen one.
        chosen: the best model found, of one or more effects, or the refit.
        around: sizes at the places.
        failures: candidates that could not be built, with the reason.
        notes: what was done differently from what was asked, in sentences.
    """

    scenario: Scenario
    recordings: tuple[Recorded, ...]
    nominal: tuple[float, float]
    refit: ScoredModel
    trials: tuple[ScoredModel, ...]
    chosen: ScoredModel
    scales: OperatingScales
    failures: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()
