"""What a fit begins with and what it leaves: models with effects in them, before they are judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.problem import Array, Problem
from diagnosis.search.scored_model import Trial


@dataclass(frozen=True)
class Entry:
    """Where a fit may start: a model, a search vector, its cost there, the effects' sizes, and those it was built with.

    The search vector counts from the sizes that the model was built with.
    """

    cost: float
    problem: Problem
    x: Array
    sizes: tuple[Sizes, ...]
    built: tuple[Sizes, ...]


@dataclass(frozen=True)
class Draft:
    """Effects put in, after a few steps of their fit."""

    effects: tuple[Candidate, ...]
    entry: Entry
    converged: bool

    def row(self) -> dict[str, Any]:
        """As numbers, for `Workshop.revived`."""
        return {
            "x": self.entry.x.tolist(),
            "cost": self.entry.cost,
            "converged": self.converged,
            "sizes": self.entry.sizes,
            "built": self.entry.built,
            "internal_step": self.entry.problem.internal_step,
        }


def ended(trial: Trial, effect: Candidate) -> Candidate:
    """An effect of a trial, to start only from where the trial ended."""
    return ended_at(effect, trial.fit.parameters(), trial.sizes[trial.effects.index(effect)])


def ended_at(effect: Candidate, values: dict[str, float], sizes: Sizes) -> Candidate:
    """An effect, to start only from where a fit that began at some sizes has it."""
    there = {key: values.get(f"{effect.name}.{key}", value) for key, value in sizes.items()}
    return replace(effect, starts=(there,), bold=())
