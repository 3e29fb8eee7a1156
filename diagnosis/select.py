"""Choosing what is missing: each candidate put in, refitted with equal care, and judged on data it has not seen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.candidate import Candidate
from diagnosis.catalogue import candidates
from diagnosis.fit import Fit, descend, fit, prior
from diagnosis.prepare import problem
from diagnosis.problem import Array, Problem
from diagnosis.recording import FrequencyTable, Recorded
from diagnosis.sines import renamed
from diagnosis.starts import settled
from diagnosis.surroundings import Surroundings, surroundings
from diagnosis.ties import lookalike
from engine.errors import FlexarmError
from scenarios.amend import Edit, amended
from scenarios.load import Scenario, load

BLOCK = 0.2
"""Length (s) of the blocks that the bootstrap draws: residuals are taken to be independent beyond it."""

STRAIN = 2.5
"""Tolerances beyond which a fitted parameter is not believed."""

CHANCE = 1.645
"""Standard deviations of chi2 that noise alone exceeds once in twenty times."""

DECISIVE = 10.0
"""Difference in cost, twice the log likelihood ratio, beyond which one change is preferred to another."""

STARTS, APART = 3, 3.0
"""How many starting sizes of an effect are fitted, and how far apart they lie in the search variables."""

FIRST, MOST = 6, 30
"""Steps from each start, and in all."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Trial:
    """A model with some effects put in, fitted and scored.

    Attributes:
        effects: what was put in; empty for the user's own model.
        fit: its fit to the training recordings.
        text: the scenario with the effects in it.
        sizes: what each effect started from; those of its parameters that cannot be fitted stay there.
        hold_out: mean squared residual on held-out data; 1 is the noise floor.
        errors: squared residuals of the held-out data, summed over blocks of time, for the bootstrap.
        samples: number of held-out values.
        bic: on the training data, with chi2 relative to the best model's.
    """

    effects: tuple[Candidate, ...]
    fit: Fit
    text: str
    sizes: tuple[dict[str, float], ...]
    hold_out: float
    errors: Array
    samples: int

    @property
    def size(self) -> int:
        """How many parameters the effects add."""
        return sum(max(len(c.knobs), 1) for c in self.effects)

    @property
    def merit(self) -> float:
        """Held-out chi2 and, spread over its values, what the fitted parameters cost against their tolerances.

        The second part is nothing beside thousands of samples, but a few rows of a table follow a wrong model whose
        parameters have left their tolerances.
        """
        return self.hold_out + float(np.sum(prior(self.fit.problem, self.fit.x)[0] ** 2)) / max(self.samples, 1)

    def added(self) -> dict[str, float]:
        """Sizes of the effects (SI): ``effect.parameter`` -> fitted value, or the one it stays at."""
        fitted, sizes = self.fit.parameters(), self.sizes or ({},) * len(self.effects)
        rows = {}
        for effect, start in zip(self.effects, sizes, strict=True):
            for knob in effect.knobs:
                name = f"{effect.name}.{knob.parameter}"
                rows[f"{effect.effect}.{knob.parameter}"] = fitted.get(name, start.get(knob.parameter, math.nan))
            if effect.loosened:
                rows[effect.loosened.name] = fitted[effect.loosened.name]
        return rows

    @property
    def label(self) -> str:
        """The effects in words."""
        return " + ".join(c.key for c in self.effects) or "nothing"


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
    """

    scenario: Scenario
    recordings: tuple[Recorded, ...]
    nominal: tuple[float, float]
    refit: Trial
    trials: tuple[Trial, ...]
    chosen: Trial
    around: Surroundings
    failures: tuple[tuple[str, str], ...]


def _scored(made: Fit, effects: tuple[Candidate, ...], text: str, sizes: tuple[dict[str, float], ...] = ()) -> Trial:
    made = replace(made, x=settled(made.problem, made.x))
    held = made.problem.chosen("hold_out") or made.problem.chosen("train", "repeat")
    sums, total, count = [], 0.0, 0
    for e in held:
        squares = np.sum(made.problem.residual(made.x, e) ** 2, axis=1)
        length = max(1, round(BLOCK / (e.step * e.every)))
        edges = np.arange(0, len(squares), length)
        sums.append(np.add.reduceat(squares, edges))
        total, count = total + float(squares.sum()), count + int(np.isfinite(e.measured).sum())
    return Trial(effects, made, text, sizes, total / max(count, 1), np.concatenate(sums), count)


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
        self.text = scenario.path.read_text(encoding="utf-8")
        self.base = problem(scenario, self.recordings)
        self.sigma = np.array([e.sigma for e in self.base.experiments])

    def refit(self) -> Trial:
        """The user's own model, its parameters fitted from several starts."""
        made = fit(self.base, random_starts=2, seed=self.seed, workers=self.workers)
        return _scored(made, (), self.text)

    def build(self, effects: Sequence[Candidate], starts: Sequence[dict[str, float]]) -> tuple[Problem, str]:
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
        return replace(made, experiments=experiments), text

    def attempt(self, effects: tuple[Candidate, ...], start: Fit) -> Trial:
        """Put effects in, try their starting sizes from the parent's optimum, fit from the best, and score.

        Raises:
            FlexarmError: the amended model has no meaning.
        """
        parent, entries = start.parameters(), []
        for chosen in itertools.product(*(c.structures() for c in effects)):
            made, text = self.build(effects, [group[0] for group in chosen])
            training = made.chosen("train", "repeat")
            for sizes in itertools.product(*chosen):
                x = _placed(made, parent, effects, sizes)
                cost = sum(float(np.sum(made.residual(x, e) ** 2)) for e in training)
                entries.append(Entry(cost + float(np.sum(prior(made, x)[0] ** 2)), made, x, text, sizes))
        entries.sort(key=lambda entry: entry.cost)
        return self._best(_spread(entries), effects)

    def _best(self, entries: Sequence[Entry], effects: tuple[Candidate, ...]) -> Trial:
        """A few steps from each entry; the best goes on until it converges."""
        with ThreadPoolExecutor(1) as pool:
            tried = []
            for entry in entries:
                made = entry.problem
                training = made.chosen("train", "repeat")
                x, cost, converged = descend(
                    made, entry.x, training, pool, iterations=FIRST if len(entries) > 1 else MOST
                )
                tried.append((replace(entry, x=x, cost=cost), converged))
            entry, converged = min(tried, key=lambda pair: pair[0].cost)
            made, x, cost = entry.problem, entry.x, entry.cost
            if not converged and len(entries) > 1:
                x, cost, converged = descend(made, x, made.chosen("train", "repeat"), pool, iterations=MOST - FIRST)
        count = sum(int(np.isfinite(e.measured).sum()) for e in made.chosen("train", "repeat"))
        chi2 = (cost - float(np.sum(prior(made, x)[0] ** 2))) / max(count, 1)
        n = len(x)
        return _scored(Fit(made, x, cost, chi2, converged, np.zeros((n, n))), effects, entry.text, entry.sizes)

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
        return _scored(better, trial.effects, trial.text, trial.sizes)


@dataclass(frozen=True)
class Entry:
    """Where a fit may start: a model, a search vector, its cost there, and the effects' sizes."""

    cost: float
    problem: Problem
    x: Array
    text: str
    sizes: tuple[dict[str, float], ...]


def _spread(entries: Sequence[Entry]) -> list[Entry]:
    """The best entries that do not lie next to each other, and the one with the least effect."""
    chosen: list[Entry] = []
    for entry in entries:
        if all(entry.problem is not other.problem or np.abs(entry.x - other.x).max() > APART for other in chosen):
            chosen.append(entry)
        if len(chosen) == STARTS:
            break
    return chosen


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
    from scenarios.amend import InSignal, OnSensor

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


def gain_band(better: Trial, worse: Trial, seed: int = 0, draws: int = 400) -> tuple[float, float]:
    """95 % band of the gain in held-out chi2 from ``worse`` to ``better``, by a bootstrap over blocks of time."""
    difference = (worse.errors - better.errors) / max(better.samples, 1)
    random = np.random.default_rng(seed)
    picks = random.integers(0, len(difference), (draws, len(difference)))
    sums = difference[picks].sum(axis=1)
    return float(np.quantile(sums, 0.025)), float(np.quantile(sums, 0.975))


def study(
    scenario: Scenario,
    recordings: Sequence[Recorded],
    *,
    workers: int = 2,
    seed: int = 0,
    most: int = 2,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> Study:
    """Refit, try every candidate, then pairs with the best, and keep what pays on held-out data.

    Args:
        scenario: the user's model.
        recordings: training and held-out.
        workers: threads.
        seed: of everything random.
        most: at most so many effects.
        without: effects that are not to be tried.
        progress: told what is done, how many of how many.
    """
    shop = Workshop(scenario, recordings, workers, seed)
    base = shop.base
    zero = np.zeros(len(base.free))
    nominal = Fit(base, zero, 0.0, 0.0, True, np.zeros((len(zero), len(zero))))
    before = (nominal.score(base.chosen("train", "repeat")), nominal.score(base.chosen("hold_out")))
    if progress:
        progress("fitting the model's own parameters", 0, 1)
    refit = shop.refit()
    around = surroundings(base)
    listed = [c for c in candidates(around) if c.effect not in without]
    trials, failures = _try_all(shop, [(c,) for c in listed], refit.fit, progress)
    trials.sort(key=lambda t: (t.merit, t.size))
    chosen = _choose(refit, trials)
    for _ in range(1, most):
        if not chosen.effects or chosen.hold_out - 1 < max(0.2, by_chance(chosen)):
            break
        used = {c.effect for c in chosen.effects}
        more = [t for t in trials if t.effects[0].effect not in used][:12]
        second, _ = _try_all(shop, [(*chosen.effects, t.effects[0]) for t in more], chosen.fit, progress)
        second.sort(key=lambda t: (t.merit, t.size))
        if not second or second[0].hold_out - 1 > 0.5 * (chosen.hold_out - 1):
            break
        chosen = second[0]
    chosen = shop.polish(chosen)
    pair = lookalike(chosen, trials)
    if pair:
        trials += [shop.polish(t) for t in _try_all(shop, [pair], refit.fit, progress)[0]]
    return Study(scenario, tuple(recordings), before, refit, tuple(trials), chosen, around, tuple(failures))


def _try_all(
    shop: Workshop, combinations: Sequence[tuple[Candidate, ...]], start: Fit, progress: Progress | None
) -> tuple[list[Trial], list[tuple[str, str]]]:
    trials: list[Trial] = []
    failures: list[tuple[str, str]] = []

    def one(effects: tuple[Candidate, ...]) -> Trial | tuple[str, str]:
        try:
            return shop.attempt(effects, start)
        except FlexarmError as error:
            return effects[-1].key, error.message

    with ThreadPoolExecutor(shop.workers) as pool:
        for done, found in enumerate(pool.map(one, combinations), 1):
            if isinstance(found, Trial):
                trials.append(found)
            else:
                failures.append(found)
            if progress:
                progress("trying effects", done, len(combinations))
    return trials, failures


def _choose(refit: Trial, trials: Sequence[Trial]) -> Trial:
    """The best single effect if it pays: a gain of 30 % of the held-out excess, beyond its bootstrap band."""
    if not trials:
        return refit
    best = trials[0]
    near = [t for t in trials if gain_band(best, t)[0] <= 0 and t.merit - best.merit < 0.05 * best.merit]
    best = min(near or [best], key=lambda t: (t.size, t.merit))
    excess = refit.hold_out - 1
    if excess < 0.2 and strained(refit):
        return _freed(refit, trials)
    least = max(0.05, by_chance(refit))
    if refit.hold_out - best.hold_out < 0.3 * max(excess, 0.0) or gain_band(best, refit)[0] <= 0 or excess < least:
        return refit
    return best


def by_chance(trial: Trial) -> float:
    """How far above the floor noise alone may leave held-out chi2: far for the few rows of a table."""
    return CHANCE * math.sqrt(2 / max(trial.samples, 1))


def strained(refit: Trial) -> list[str]:
    """Parameters that the refit could only place far outside their tolerances."""
    pairs = zip(refit.fit.problem.free, refit.fit.x, strict=True)
    return [f.name for f, x in pairs if f.prior and abs(x) > STRAIN]


def _freed(refit: Trial, trials: Sequence[Trial]) -> Trial:
    """The single change that lets all other parameters stay within their tolerances, if one does."""
    able = [t for t in trials if t.size == 1 and t.hold_out < 1.1 * refit.hold_out]
    best = min(able, key=lambda t: (t.fit.cost, t.effects[0].effect != "wrong_parameter"), default=refit)
    return best if refit.fit.cost - best.fit.cost > DECISIVE else refit


def log_evidence(trial: Trial, best: Trial) -> float:
    """-BIC/2 on the training data, with chi2 relative to the best model's where that is above 1."""
    training = trial.fit.problem.chosen("train", "repeat")
    count = sum(int(np.isfinite(e.measured).sum()) for e in training)
    floor = max(1.0, best.fit.chi2)
    return -0.5 * (trial.fit.chi2 * count / floor + trial.size * math.log(max(count, 2)))
