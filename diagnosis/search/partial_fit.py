"""What a fit begins with and what it leaves: models with effects in them, before they are judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.search.scored_model import ScoredModel


@dataclass(frozen=True)
class StartingPoint:
    """Where a fit may start: a model, a search vector, its cost there, the effects' sizes, and those it was built with.

    The search vector counts from the sizes that the model was built with.
    """

    cost: float
    problem: Problem
    x: Array
    sizes: tuple[Sizes, ...]
    built: tuple[Sizes, ...]


class PointSource(Protocol):
    """Builds models with effects in them, and says where their fits may start."""

    def points(
        self, effects: tuple[Candidate, ...], groups: Sequence[Sequence[Sizes]], parent: dict[str, float]
    ) -> list[StartingPoint]:
        """Starting sizes that share one model, each with its cost."""
        ...


@dataclass(frozen=True)
class PartialFit:
    """Effects put in, after a few steps of their fit."""

    effects: tuple[Candidate, ...]
    point: StartingPoint
    converged: bool

    def row(self) -> dict[str, Any]:
        """As numbers, for `CandidateFitter.restored`."""
        return {
            "x": self.point.x.tolist(),
            "cost": self.point.cost,
            "converged": self.converged,
            "sizes": self.point.sizes,
            "built": self.point.built,
            "internal_step": self.point.problem.internal_step,
        }


def ended(trial: ScoredModel, effect: Candidate) -> Candidate:
    """An effect of a trial, to start only from where the trial ended."""
    return ended_at(effect, trial.fit.parameters(), trial.sizes[trial.effects.index(effect)])


def ended_at(effect: Candidate, values: dict[str, float], sizes: Sizes) -> Candidate:
    """An effect, to start only from where a fit that began at some sizes has it."""
    there = {key: values.get(f"{effect.name}.{key}", value) for key, value in sizes.items()}
    return replace(effect, starts=(there,), bold=())
