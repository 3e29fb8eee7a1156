"""Where models with effects in them are built and fitted."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.candidate import Candidate, Sizes
from diagnosis.draft import Draft, Entry, ended, ended_at
from diagnosis.fit import Fit, descend, fit
from diagnosis.prepare import problem, resolved
from diagnosis.problem import Array, Problem, prior
from diagnosis.recording import FrequencyTable, Recorded
from diagnosis.sines import Sines, renamed
from diagnosis.trial import Trial, scored
from diagnosis.waves import solved
from engine.errors import FlexarmError
from engine.spread import Store
from engine.threads import Threads
from scenarios.amend import Edit, InSignal, OnSensor, amended, without
from scenarios.load import Scenario, load

STARTS, APART = 3, 3.0
"""How many starting sizes of an effect are fitted, and how far apart they lie in the search variables."""

STRUCTURES, SETTLES = 10, 24
"""Of sizes that are only chosen, such as the order of a ripple, so many are fitted, in so many steps: which is right
shows late."""

GLANCE = 0.4
"""Share of the training recordings on which starting sizes are compared."""

FIRST, MOST = 6, 25
"""Steps from each of the best starts, and then from the best of all."""

POLISHED = 150
"""Steps at most of the chosen model's last fit."""

FINER = (0.5, 0.25, 0.125, 0.0625, 0.03125)
"""Distances, in samples, at which a size that is only chosen is looked for next to the best."""

SOLVED, REORDERED = 5, 3
"""So many orders of a wave are fitted from the linear solution, and so many beside another effect."""

SOLUTION = 2.0
"""Mean squared residual up to which what the linear solution gives is taken for the solution."""

HARDLY = 3e-3
"""A first step that gains less than this share of the cost is the last."""


class Workshop:
    """Builds and fits models of a study, with a bounded number of threads.

    Args:
        scenario: the user's.
        recordings: of all roles.
        workers: threads.
        seed: of everything random.
        store: keeps every fit, so that a study that was interrupted goes on where it was.
    """

    def __init__(
        self,
        scenario: Scenario,
        recordings: Sequence[Recorded],
        workers: int = 2,
        seed: int = 0,
        store: Store | None = None,
    ) -> None:
        self.scenario, self.recordings, self.store = scenario, tuple(recordings), store
        self.workers, self.seed = workers, seed
        self.text = without(scenario.path.read_text(encoding="utf-8"), "recordings", "analyses")
        self.base = problem(scenario, self.recordings)
        self.sigma = np.array([e.sigma for e in self.base.experiments])
        self.tables = any(isinstance(e, Sines) for e in self.base.experiments)
        self.digest = _digest(self.base, seed)

    def again(self, recordings: Sequence[Recorded]) -> Workshop:
        """The same with other recordings."""
        return Workshop(self.scenario, recordings, self.workers, self.seed, self.store)

    def refit(self) -> Trial:
        """The user's own model, its parameters fitted from several starts."""

        def compute() -> Draft:
            made = fit(self.base, random_starts=2, seed=self.seed, workers=self.workers)
            return Draft((), Entry(made.cost, self.base, made.x, (), ()), made.converged)

        draft = self._kept("refit", (), compute)
        return self._trial(draft)

    def _kept(self, key: str, effects: tuple[Candidate, ...], compute: Callable[[], Draft]) -> Draft:
        """What ``compute`` gives, or what it gave before under the same key."""
        key = f"{self.digest} {key}"
        if self.store is None or key not in self.store:
            draft = compute()
            if self.store is not None:
                self.store[key] = draft.row()
            return draft
        return self.revived(effects, self.store[key])

    def revived(self, effects: tuple[Candidate, ...], row: dict[str, Any]) -> Draft:
        """The draft that was written down by `Draft.row`."""
        made = self.build(effects, row["built"]) if effects else self.base
        made = replace(made, internal_step=row["internal_step"])
        entry = Entry(row["cost"], made, np.array(row["x"]), tuple(row["sizes"]), tuple(row["built"]))
        return Draft(effects, entry, row["converged"])

    def _trial(self, draft: Draft) -> Trial:
        """A draft as it is, scored."""
        made, x = draft.entry.problem, draft.entry.x
        chi2 = (draft.entry.cost - float(np.sum(prior(made, x)[0] ** 2))) / max(_count(made), 1)
        n = len(x)
        found = Fit(made, x, draft.entry.cost, chi2, draft.converged, np.zeros((n, n)))
        return scored(found, draft.effects, draft.entry.sizes)

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
        held = {f"{c.name}.{key}" for c in effects for key in c.held}
        made = problem(scenario, recordings, extra, held=held)
        experiments = tuple(replace(e, sigma=s) for e, s in zip(made.experiments, self.sigma, strict=True))
        return replace(made, experiments=experiments)

    def draft(self, effects: tuple[Candidate, ...], start: Fit) -> Draft:
        """Put effects in, try their starting sizes from the parent's optimum, and take a few steps from the best.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        key = " ".join(["draft", *(c.key for c in effects), *(repr(c.starts) for c in effects), _hash(start.x)])
        return self._kept(key, effects, lambda: self.drafted(effects, start.parameters()))

    def drafted(self, effects: tuple[Candidate, ...], parent: dict[str, float]) -> Draft:
        """The work of `draft`, done anew whatever is kept.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        entries = []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            entries += self.entries(effects, chosen, parent)
        if not entries:
            raise FlexarmError("at every size it would move faster than these recordings can show")
        entries.sort(key=lambda entry: entry.cost)
        bold = self.entries(effects, [effects[0].bold], parent) if len(effects) == 1 and effects[0].bold else []
        tried = []
        with Threads(1) as pool:
            begun = [*self._begun(effects, entries, parent), *bold]
            most = SETTLES if len({id(entry.problem.model) for entry in begun}) > 1 else FIRST
            for entry in begun:
                training = entry.problem.chosen("train", "repeat")
                x, cost, converged = descend(entry.problem, entry.x, training, pool, iterations=most, least=HARDLY)
                tried.append(Draft(effects, replace(entry, x=x, cost=cost), converged))
        return min(tried, key=lambda draft: draft.entry.cost)

    def _begun(self, effects: tuple[Candidate, ...], entries: Sequence[Entry], parent: dict[str, float]) -> list[Entry]:
        """The entries to fit; ``entries`` begin from the parent's parameters, best first."""
        # A wave that goes on from where a fit ended needs no other start.
        waves = [k for k, c in enumerate(effects) if c.wave and len(c.starts) > 1]
        if waves and not self.tables:
            single = len(effects) == 1
            begun = [e for k in waves for e in solved(self, effects, k, parent)[: SOLVED if single else REORDERED]]
            if not single:
                return [*begun, *_spread(entries)[:1]]
            # A wave that moves the model far is not solved for by tangents: then every order is tried from the others.
            near = any(entry.cost < SOLUTION * _count(entry.problem) for entry in begun)
            return [*begun, *_spread(entries)[: STARTS if near else None]]
        if not self.tables or len(effects) > 1:
            return _spread(entries)
        # A few rows let the refit bend parameters that the effect would leave as they were given: begin there too.
        given: list[Entry] = []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            given += self.entries(effects, chosen, {})
        return [entries[0], min(given, key=lambda entry: entry.cost)]

    def entries(
        self, effects: tuple[Candidate, ...], groups: Sequence[Sequence[Sizes]], parent: dict[str, float]
    ) -> list[Entry]:
        """Starting sizes that share one model, each with its cost."""
        built = tuple(group[0] for group in groups)
        made, rows = self.build(effects, built), []
        for sizes in itertools.product(*groups):
            x = _placed(made, parent, effects, sizes)
            stepped = resolved(made, x)
            if stepped is not None:
                rows.append(Entry(_glance(stepped, x), stepped, x, sizes, built))
        return rows

    def reduced(self, trial: Trial, kept: Candidate) -> Trial:
        """One effect of a trial alone, from where the trial ended.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        alone = ended(trial, kept)
        made = self.finish(self.draft((alone,), trial.fit))
        return replace(made, effects=(kept,))

    def finish(self, draft: Draft, iterations: int = MOST) -> Trial:
        """Fit a draft until it converges, and score it; with no iterations left it is scored as it is."""
        if not iterations:
            return self._trial(draft)
        key = " ".join(["finish", *(c.key for c in draft.effects), str(iterations), _hash(draft.entry.x)])
        return self._trial(self._kept(key, draft.effects, lambda: self.finished(draft, iterations)))

    def finished(self, draft: Draft, iterations: int) -> Draft:
        """The work of `finish`, done anew whatever is kept and not scored."""
        draft = self._descended(self._refined(draft), iterations)
        for k, effect in enumerate(draft.effects):
            if effect.wave and len(effect.starts) == 1 and len(draft.effects) > 1 and not self.tables:
                draft = self._reordered(draft, k, iterations)
        return draft

    def _descended(self, draft: Draft, iterations: int) -> Draft:
        """The draft fitted until it converges."""
        if draft.converged:
            return draft
        entry = draft.entry
        made = resolved(entry.problem, entry.x) or entry.problem
        with Threads(1) as pool:
            training = made.chosen("train", "repeat")
            x, cost, converged = descend(made, entry.x, training, pool, iterations=iterations)
        if not math.isfinite(cost):
            return draft  # it stands where the model cannot be differentiated
        return Draft(draft.effects, replace(entry, problem=made, x=x, cost=cost), converged)

    def _reordered(self, draft: Draft, k: int, iterations: int) -> Draft:
        """The draft with its wave solved for anew beside the other effect, or as it is if no order does better.

        Alone, a wave may fit best at an order that makes up for what the other effect does.
        """
        entry, effects = draft.entry, draft.effects
        values = entry.problem.values(entry.x)[0]
        there = [ended_at(c, values, sizes) for c, sizes in zip(effects, entry.sizes, strict=True)]
        tried = [draft]
        for begun in solved(self, there, k, values)[:REORDERED]:
            training = begun.problem.chosen("train", "repeat")
            with Threads(1) as pool:
                x, cost, converged = descend(begun.problem, begun.x, training, pool, iterations=SETTLES, least=HARDLY)
            tried.append(Draft(effects, replace(begun, x=x, cost=cost), converged))
        best = min(tried, key=lambda made: made.entry.cost)
        return best if best is draft else self._descended(best, iterations)

    def _refined(self, draft: Draft) -> Draft:
        """The draft with sizes that are only chosen, such as a delay, moved to where they fit best."""
        for k, effect in enumerate(draft.effects):
            for share in FINER if effect.finer else ():
                best = draft.entry
                for sizes in effect.finer(best.sizes[k], share) if effect.finer else ():
                    chosen = tuple(sizes if j == k else s for j, s in enumerate(best.sizes))
                    built = tuple(sizes if j == k else s for j, s in enumerate(best.built))
                    made = self.build(draft.effects, built)
                    training = made.chosen("train", "repeat")
                    with Threads(1) as pool:
                        x, cost, converged = descend(made, best.x, training, pool, iterations=FIRST, least=HARDLY)
                    if cost < draft.entry.cost:
                        draft = Draft(draft.effects, Entry(cost, made, x, chosen, built), converged)
        return draft

    def polish(self, trial: Trial) -> Trial:
        """The same model, fitted until it converges."""
        made = trial.fit
        if made.converged:
            return trial
        training = made.problem.chosen("train", "repeat")
        with Threads(self.workers) as pool:
            x, cost, converged = descend(made.problem, made.x, training, pool, iterations=POLISHED)
        if not cost < made.cost:
            return trial  # it ended where the model cannot be differentiated
        return self._trial(Draft(trial.effects, Entry(cost, made.problem, x, trial.sizes, trial.sizes), converged))


def _count(made: Problem) -> int:
    """Values in the training recordings."""
    return sum(int(np.isfinite(e.measured).sum()) for e in made.chosen("train", "repeat"))


def _hash(x: Array) -> str:
    return hashlib.sha256(np.ascontiguousarray(x).tobytes()).hexdigest()[:16]


def _digest(base: Problem, seed: int) -> str:
    """What every fit depends on: the model, the data, what may move, and the random seed."""
    found = hashlib.sha256(f"{base.model.signature} {base.free} {base.internal_step} {seed}".encode())
    for e in base.experiments:
        found.update(f"{e.name} {e.role}".encode())
        for part in (e.time, e.measured, e.sigma, *([np.asarray(e.drive.values)] if e.drive is not None else [])):
            found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def _glance(made: Problem, x: Array) -> float:
    """The cost over the first part of the training recordings."""
    training = [e.cut(GLANCE * float(e.time[-1])) for e in made.chosen("train", "repeat")]
    return sum(float(np.sum(made.residual(x, e) ** 2)) for e in training) + float(np.sum(prior(made, x)[0] ** 2))


def _spread(entries: Sequence[Entry]) -> list[Entry]:
    """The best entries that do not lie next to each other; of sizes that are only chosen, the best of the best few."""
    models: dict[int, Entry] = {}
    for entry in entries:
        models.setdefault(id(entry.problem.model), entry)
    chosen = list(models.values())[:STRUCTURES] if len(models) > 1 else []
    for entry in entries:
        if len(chosen) >= STARTS:
            break
        if all(_apart(entry, other) for other in chosen):
            chosen.append(entry)
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
