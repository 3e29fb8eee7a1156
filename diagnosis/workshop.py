"""Where models with effects in them are built and fitted."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.candidate import Candidate, Sizes
from diagnosis.fit import Fit, descend, fit, prior
from diagnosis.prepare import problem, resolved
from diagnosis.problem import Array, Problem
from diagnosis.recording import FrequencyTable, Recorded
from diagnosis.sines import renamed
from diagnosis.trial import Trial, scored
from engine.errors import FlexarmError
from scenarios.amend import Edit, InSignal, OnSensor, amended, without
from scenarios.load import Scenario, load

STARTS, APART = 3, 3.0
"""How many starting sizes of an effect are fitted, and how far apart they lie in the search variables."""

GLANCE = 0.4
"""Share of the training recordings on which starting sizes are compared."""

FIRST, MOST = 6, 25
"""Steps from each of the best starts, and then from the best of all."""

FINER = (0.5, 0.25, 0.125, 0.0625)
"""Distances, in samples, at which a size that is only chosen is looked for next to the best."""

HARDLY = 3e-3
"""A first step that gains less than this share of the cost is the last."""


class Workshop:
    """Builds and fits models of a study, with a bounded number of threads.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.
        seed: of everything random.
    """

    def __init__(self, scenario: Scenario, recordings: Sequence[Recorded], workers: int = 2, seed: int = 0) -> None:
        self.scenario, self.recordings = scenario, tuple(recordings)
        self.workers, self.seed = workers, seed
        self.text = without(scenario.path.read_text(encoding="utf-8"), "recordings", "analyses")
        self.base = problem(scenario, self.recordings)
        self.sigma = np.array([e.sigma for e in self.base.experiments])

    def refit(self) -> Trial:
        """The user's own model, its parameters fitted from several starts."""
        made = fit(self.base, random_starts=2, seed=self.seed, workers=self.workers)
        return scored(made, ())

    def build(self, effects: Sequence[Candidate], starts: Sequence[dict[str, float]]) -> Problem:
        """The problem with effects put in at starting values.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        edits: list[Edit] = [edit for c, s in zip(effects, starts, strict=True) for edit in c.edits(s)]
        text = amended(self.text, edits)
        scenario = load(self.scenario.path, self.scenario.overrides, text=text)
        extra = [f for c, s in zip(effects, starts, strict=True) for f in c.free(s)]
        recordings = [_renamed(r, edits) for r in self.recordings]
        made = problem(scenario, recordings, extra)
        experiments = tuple(replace(e, sigma=s) for e, s in zip(made.experiments, self.sigma, strict=True))
        return replace(made, experiments=experiments)

    def draft(self, effects: tuple[Candidate, ...], start: Fit) -> Draft:
        """Put effects in, try their starting sizes from the parent's optimum, and take a few steps from the best.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        parent, entries = start.parameters(), []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            entries += self._entries(effects, chosen, parent)
        if not entries:
            raise FlexarmError("at every size it would move faster than these recordings can show")
        entries.sort(key=lambda entry: entry.cost)
        bold = self._entries(effects, [effects[0].bold], parent) if len(effects) == 1 and effects[0].bold else []
        tried = []
        with ThreadPoolExecutor(1) as pool:
            for entry in [*_spread(entries), *bold]:
                training = entry.problem.chosen("train", "repeat")
                x, cost, converged = descend(entry.problem, entry.x, training, pool, iterations=FIRST, least=HARDLY)
                tried.append(Draft(effects, replace(entry, x=x, cost=cost), converged))
        return min(tried, key=lambda draft: draft.entry.cost)

    def _entries(
        self, effects: tuple[Candidate, ...], groups: Sequence[Sequence[Sizes]], parent: dict[str, float]
    ) -> list[Entry]:
        """Starting sizes that share one model, each with its cost."""
        made, rows = self.build(effects, [group[0] for group in groups]), []
        for sizes in itertools.product(*groups):
            x = _placed(made, parent, effects, sizes)
            stepped = resolved(made, x)
            if stepped is not None:
                rows.append(Entry(_glance(stepped, x), stepped, x, sizes))
        return rows

    def reduced(self, trial: Trial, kept: Candidate) -> Trial:
        """One effect of a trial alone, from where the trial ended.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        values = trial.fit.parameters()
        sizes = trial.sizes[trial.effects.index(kept)]
        there = {key: values.get(f"{kept.name}.{key}", value) for key, value in sizes.items()}
        alone = replace(kept, starts=(there,), finer=None, bold=())
        made = self.finish(self.draft((alone,), trial.fit))
        return replace(made, effects=(kept,))

    def finish(self, draft: Draft, iterations: int = MOST) -> Trial:
        """Fit a draft until it converges, and score it; with no iterations left it is scored as it is."""
        draft = self._refined(draft) if iterations else draft
        entry, converged = draft.entry, draft.converged
        made, x, cost = entry.problem, entry.x, entry.cost
        training = made.chosen("train", "repeat")
        if not converged and iterations:
            made = resolved(made, x) or made
            with ThreadPoolExecutor(1) as pool:
                x, cost, converged = descend(made, x, training, pool, iterations=iterations)
        count = sum(int(np.isfinite(e.measured).sum()) for e in training)
        chi2 = (cost - float(np.sum(prior(made, x)[0] ** 2))) / max(count, 1)
        n = len(x)
        return scored(Fit(made, x, cost, chi2, converged, np.zeros((n, n))), draft.effects, entry.sizes)

    def _refined(self, draft: Draft) -> Draft:
        """The draft with sizes that are only chosen, such as a delay, moved to where they fit best."""
        for k, effect in enumerate(draft.effects):
            for share in FINER if effect.finer else ():
                best = draft.entry
                for sizes in effect.finer(best.sizes[k], share) if effect.finer else ():
                    chosen = tuple(sizes if j == k else s for j, s in enumerate(best.sizes))
                    made = self.build(draft.effects, chosen)
                    training = made.chosen("train", "repeat")
                    with ThreadPoolExecutor(1) as pool:
                        x, cost, converged = descend(made, best.x, training, pool, iterations=FIRST, least=HARDLY)
                    if cost < draft.entry.cost:
                        draft = Draft(draft.effects, Entry(cost, made, x, chosen), converged)
        return draft

    def polish(self, trial: Trial) -> Trial:
        """The same model, fitted until it converges."""
        made = trial.fit
        if made.converged:
            return trial
        training = made.problem.chosen("train", "repeat")
        with ThreadPoolExecutor(self.workers) as pool:
            x, cost, converged = descend(made.problem, made.x, training, pool, iterations=150)
        count = sum(int(np.isfinite(e.measured).sum()) for e in training)
        chi2 = (cost - float(np.sum(prior(made.problem, x)[0] ** 2))) / max(count, 1)
        better = replace(made, x=x, cost=cost, chi2=chi2, converged=converged)
        return scored(better, trial.effects, trial.sizes)


@dataclass(frozen=True)
class Entry:
    """Where a fit may start: a model, a search vector, its cost there, and the effects' sizes."""

    cost: float
    problem: Problem
    x: Array
    sizes: tuple[dict[str, float], ...]


@dataclass(frozen=True)
class Draft:
    """Effects put in, after a few steps of their fit."""

    effects: tuple[Candidate, ...]
    entry: Entry
    converged: bool


def _glance(made: Problem, x: Array) -> float:
    """The cost over the first part of the training recordings."""
    training = [e.cut(GLANCE * float(e.time[-1])) for e in made.chosen("train", "repeat")]
    return sum(float(np.sum(made.residual(x, e) ** 2)) for e in training) + float(np.sum(prior(made, x)[0] ** 2))


def _spread(entries: Sequence[Entry]) -> list[Entry]:
    """The best entries that do not lie next to each other; those that share no model differ in a fixed size."""
    chosen: list[Entry] = []
    for entry in entries:
        if all(_apart(entry, other) for other in chosen):
            chosen.append(entry)
        if len(chosen) == STARTS:
            break
    return chosen


def _apart(one: Entry, other: Entry) -> bool:
    return one.problem.model is not other.problem.model or float(np.abs(one.x - other.x).max()) > APART


def _placed(
    made: Problem, parent: dict[str, float], effects: Sequence[Candidate], sizes: Sequence[dict[str, float]]
) -> Array:
    """The search vector that keeps the parent's parameters and gives the effects their sizes."""
    x = np.zeros(len(made.free))
    given = {f"{c.name}.{key}": value for c, s in zip(effects, sizes, strict=True) for key, value in s.items()}
    for i, f in enumerate(made.free):
        value = given.get(f.name, parent.get(f.name)) if not f.recording else None
        if value is not None:
            x[i] = f.position(value)
    return x


def _renamed(recording: Recorded, edits: Sequence[Edit]) -> Recorded:
    """The recording with its signals called as the amended scenario calls them."""
    if isinstance(recording, FrequencyTable):
        return renamed(recording, edits)
    for edit in edits:
        if isinstance(edit, InSignal):
            drive = tuple(
                replace(c, name=f"{edit.name}.{edit.entry}") if c.name == edit.target else c for c in recording.drive
            )
            recording = replace(recording, drive=drive)
        elif isinstance(edit, OnSensor):
            measured = tuple(
                replace(c, name=f"{edit.name}.{edit.exit}") if c.name == edit.target else c
                for c in recording.measurements
            )
            recording = replace(recording, measurements=measured)
    return recording
