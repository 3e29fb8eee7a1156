"""What a search has tried on a scenario and its recordings, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from diagnosis.effects.effect import Candidate
from diagnosis.effects.scales import OperatingScales
from diagnosis.recordings.types import Recorded
from diagnosis.search.posterior import place_odds
from diagnosis.search.scored_model import ScoredModel
from diagnosis.search.screening import Origin
from scenarios.load import Scenario

LEAST_ODDS = 0.001
"""Odds below this are not told, nor a probability closer to one: no model of noise is that exact."""


@dataclass(frozen=True)
class SpareEvidence:
    """What columns that were logged and not fitted say of one model.

    Attributes:
        model: its effects, by key.
        log_likelihood: of the columns under it.
        correlations: of each column with what the model predicts, by signal.
    """

    model: frozenset[str]
    log_likelihood: float
    correlations: Mapping[str, float]


@dataclass(frozen=True)
class Looked:
    """What was seen when effects were looked at beside the user's model alone.

    Attributes:
        order: effects at places, in each way to put them in, those that promise most first.
        refused: effects that cannot be put in, with the reason.
        origin: where they were looked at; None where nothing can be simulated.
        fitted: models with effects that were fitted since, those that are worth most.
    """

    order: tuple[Candidate, ...]
    refused: tuple[tuple[str, str], ...]
    origin: Origin | None
    fitted: tuple[ScoredModel, ...] = ()


@dataclass(frozen=True)
class Study:
    """A scenario and its recordings, and everything tried on them.

    Attributes:
        scenario: the user's.
        recordings: of all roles.
        nominal: mean squared residual of the model as given, (train, hold-out).
        refit: the user's model with its parameters fitted.
        trials: models with effects that were fitted to the end, the most probable first.
        chosen: the most probable model, of one or more effects, or the refit.
        odds: how probable each model is that is told, by its effects.
        tried: number of effects at places.
        scales: sizes at the places.
        failures: effects that were not tried, with the reason.
        notes: what was done differently from what was asked, in sentences.
        looked: what was seen before the first fit with an effect; None where none was to be sought.
        spare: what spare columns say of the models that they were held against.
        ended_early: whether the time that was allowed was over before the search was.
    """

    scenario: Scenario
    recordings: tuple[Recorded, ...]
    nominal: tuple[float, float]
    refit: ScoredModel
    trials: tuple[ScoredModel, ...]
    chosen: ScoredModel
    odds: Mapping[frozenset[str], float]
    tried: int
    scales: OperatingScales
    failures: tuple[tuple[str, str], ...]
    notes: tuple[str, ...] = ()
    looked: Looked | None = None
    spare: tuple[SpareEvidence, ...] = ()
    ended_early: bool = False

    @property
    def place_odds(self) -> dict[str, float]:
        """How probable it is that something acts at each place, the most probable first."""
        return {place: share for place, share in place_odds(self.trials, self.odds).items() if share >= LEAST_ODDS}
