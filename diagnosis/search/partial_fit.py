"""What a fit begins with and what it leaves: models with effects in them, before they are judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.parameters import Array, FreeParameter
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


class Builder(Protocol):
    """Builds models with effects in them."""

    def build(self, effects: Sequence[Candidate], starts: Sequence[Sizes], *, whole: bool = False) -> Problem:
        """The problem with effects at starting values, with the recordings as they are if ``whole``."""
        ...

    def placed(
        self,
        effects: tuple[Candidate, ...],
        group: Sequence[tuple[Sizes, ...]],
        parent: dict[str, float],
        longest: float | None = None,
    ) -> Iterator[tuple[Problem, Array, tuple[Sizes, ...]]]:
        """Models with effects at sizes that share one model, and search vectors that keep the parent's values."""
        ...


@dataclass(frozen=True)
class PartialFit:
    """Effects put in, after a few steps of their fit.

    Attributes:
        effects: what was put in.
        point: where the steps ended.
        converged: whether no step leads lower.
        around: mark of the model that the recordings are made coarse around; see `CandidateFitter.near`.
        work: that its fit took; see `engine.work`.
        begun: search vector from which the steps were taken, if any were.
    """

    effects: tuple[Candidate, ...]
    point: StartingPoint
    converged: bool
    around: str = ""
    work: int = 0
    begun: Array | None = None

    @property
    def label(self) -> str:
        """The effects in words."""
        return " + ".join(c.key for c in self.effects)

    def row(self) -> dict[str, Any]:
        """As numbers, for `CandidateFitter.restored`."""
        return {
            "x": self.point.x.tolist(),
            "cost": self.point.cost,
            "converged": self.converged,
            "sizes": self.point.sizes,
            "built": self.point.built,
            "internal_step": self.point.problem.internal_step,
            "work": self.work,
            "begun": None if self.begun is None else self.begun.tolist(),
            "whole": not any(e.coarse for e in self.point.problem.experiments),
        }


def ended(trial: ScoredModel, effect: Candidate) -> Candidate:
    """An effect of a trial, to start only from where the trial ended."""
    return ended_at(effect, trial.fit.parameters(), trial.sizes[trial.effects.index(effect)])


def as_ended(model: ScoredModel) -> tuple[Candidate, ...]:
    """The effects of a model, to start only from where its fit ended."""
    return tuple(ended(model, c) for c in model.effects)


def others_as_ended(model: ScoredModel, effect: Candidate) -> tuple[Candidate, ...]:
    """The effects of a model but one of them, to start only from where its fit ended."""
    return tuple(ended(model, c) for c in model.effects if c is not effect)


def ended_at(effect: Candidate, values: dict[str, float], sizes: Sizes) -> Candidate:
    """An effect, to start only from where a fit that began at some sizes has it."""
    there = {key: values.get(f"{effect.name}.{key}", value) for key, value in sizes.items()}
    return replace(effect, starts=(there,))


def standing(made: Fit) -> dict[str, float]:
    """Where a fit ended: every parameter, and every starting value by its recording and name."""
    return {place_of(f): f.value(x) for f, x in zip(made.problem.free, made.x, strict=True)}


def drawn_back(made: Fit, far: float) -> dict[str, float]:
    """The same with the user's own parameters no farther from their values than so many tolerances."""
    x = [
        min(max(x, -far * f.spread), far * f.spread) if f.prior and not f.recording else x
        for f, x in zip(made.problem.free, made.x, strict=True)
    ]
    return {place_of(f): f.value(v) for f, v in zip(made.problem.free, x, strict=True)}


def place_of(free: FreeParameter) -> str:
    """What `standing` calls a parameter or a starting value."""
    return f"{free.recording}: {free.name}" if free.recording else free.name
