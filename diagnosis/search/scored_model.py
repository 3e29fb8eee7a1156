"""One model with some effects put in: its fit, and how well it does on data it has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.least_squares import Fit, with_held_out_starts
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import counted
from diagnosis.thresholds import NOISE, PREFERENCE


@dataclass(frozen=True)
class ScoredModel:
    """A model with some effects put in, fitted and scored.

    Attributes:
        effects: what was put in; empty for the user's own model.
        fit: its fit to the training recordings.
        sizes: what each effect started from; those of its parameters that cannot be fitted stay there.
        hold_out: mean squared residual on held-out data; 1 is the noise floor.
        errors: squared residuals of the held-out data, summed over blocks of time, for the bootstrap.
        samples: number of held-out values.
    """

    effects: tuple[Candidate, ...]
    fit: Fit
    sizes: tuple[dict[str, float], ...]
    hold_out: float
    errors: Array
    samples: int

    @property
    def size(self) -> int:
        """How many parameters the effects add."""
        return sum(max(len(c.parameters), 1) for c in self.effects)

    @property
    def merit(self) -> float:
        """Held-out chi2 and, spread over its values, what the fitted parameters cost against their tolerances.

        The second part is nothing beside thousands of samples, but a few rows of a table follow a wrong model whose
        parameters have left their tolerances.
        """
        return self.hold_out + self.prior_cost / max(self.samples, 1)

    def added(self) -> dict[str, float]:
        """Sizes of the effects (SI): ``effect.parameter`` -> fitted value, or the one it stays at."""
        fitted, sizes = self.fit.parameters(), self.sizes or ({},) * len(self.effects)
        rows = {}
        for effect, start in zip(self.effects, sizes, strict=True):
            for parameter in effect.parameters:
                name = f"{effect.name}.{parameter.name}"
                rows[f"{effect.effect}.{parameter.name}"] = fitted.get(name, start.get(parameter.name, math.nan))
            if effect.freed:
                rows[effect.freed.name] = fitted[effect.freed.name]
        return rows

    @property
    def prior_cost(self) -> float:
        """What the fitted parameters cost against their tolerances."""
        return self.fit.problem.prior_cost(self.fit.x)

    @property
    def label(self) -> str:
        """The effects in words."""
        return " + ".join(c.key for c in self.effects) or "nothing"


def scored(made: Fit, effects: tuple[Candidate, ...], sizes: tuple[dict[str, float], ...] = ()) -> ScoredModel:
    """A fit judged on the held-out recordings, or on the fitted ones where none is held out."""
    problem, x = made.problem, with_held_out_starts(made.problem, made.x)
    sums = []
    for e in problem.judged:
        squares = np.sum(e.squares(problem.residual(x, e)), axis=1)
        length = max(1, round(NOISE.block / e.interval))
        sums.append(np.add.reduceat(squares, np.arange(0, len(squares), length)))
    errors, samples = np.concatenate(sums), counted(problem.judged)
    return ScoredModel(effects, replace(made, x=x), sizes, problem.chi2(x, problem.judged), errors, samples)


def gain_band(better: ScoredModel, worse: ScoredModel, seed: int = 0, draws: int = 400) -> tuple[float, float]:
    """95 % band of the gain in held-out chi2 from ``worse`` to ``better``, by a bootstrap over blocks of time."""
    difference = (worse.errors - better.errors) / max(better.samples, 1)
    random = np.random.default_rng(seed)
    picks = random.integers(0, len(difference), (draws, len(difference)))
    sums = difference[picks].sum(axis=1)
    return float(np.quantile(sums, 0.025)), float(np.quantile(sums, 0.975))


def by_chance(trial: ScoredModel) -> float:
    """How far above the floor noise alone may leave held-out chi2: far for the few rows of a table."""
    return NOISE.chance * math.sqrt(2 / max(trial.samples, 1))


def outside_tolerances(refit: ScoredModel) -> list[str]:
    """Parameters that the refit could only place far outside their tolerances."""
    pairs = zip(refit.fit.problem.free, refit.fit.x, strict=True)
    return [f.name for f, x in pairs if f.prior and abs(x) > PREFERENCE.believed]


def at_end(trial: ScoredModel) -> list[str]:
    """Sizes that went as far as they may, beyond which their effect is another one."""
    ends = {f"{c.effect}.{k.name}": k.most * k.reference for c in trial.effects for k in c.parameters if k.most}
    found = trial.added() if ends else {}
    return [name for name, most in ends.items() if abs(found[name]) > PREFERENCE.at_end * most]


def log_evidence(trial: ScoredModel, best: ScoredModel) -> float:
    """-BIC/2 on the training data, with chi2 relative to the best model's where that is above 1."""
    count = counted(trial.fit.problem.training)
    floor = max(1.0, best.fit.chi2)
    return -0.5 * (trial.fit.chi2 * count / floor + trial.size * math.log(max(count, 2)))
