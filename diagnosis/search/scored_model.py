"""One model with some effects put in: its fit, and how much all recordings speak for it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.growing import beginning
from diagnosis.estimation.held_out_starts import with_held_out_starts
from diagnosis.estimation.least_squares import Fit
from diagnosis.estimation.leftover import Leftover, Noise
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import counted
from diagnosis.search.evidence import ChosenSize, evidence
from diagnosis.thresholds import SEARCH, WORDING


@dataclass(frozen=True)
class ScoredModel:
    """A model with some effects put in, fitted and scored.

    Attributes:
        effects: what was put in; empty for the user's own model.
        fit: its fit to the training recordings.
        sizes: what each effect started from; those of its parameters that cannot be fitted stay there.
        hold_out: mean squared residual on held-out data, or on the fitted data where none are held out; 1 is the noise
            floor.
        left: what it leaves over of all recordings, where these together speak most for it.
        unseen: the same of those that are held out, or of the fitted ones where none is.
        log_evidence: see `diagnosis.search.evidence`.
        foretold: how well it foretells those that are held out; see there.
        owed: by how much all recordings are less likely a step further on than the tangents promise; see there.
        likeliest: search vector at which all recordings together are likelier than where the fit ended.
    """

    effects: tuple[Candidate, ...]
    fit: Fit
    sizes: tuple[dict[str, float], ...]
    hold_out: float
    left: Leftover
    unseen: Leftover
    log_evidence: float
    foretold: float
    owed: float = 0.0
    likeliest: Array | None = None

    @property
    def size(self) -> int:
        """How many parameters the effects add."""
        return sum(max(len(c.parameters), 1) for c in self.effects)

    @property
    def keys(self) -> frozenset[str]:
        """The effects and their places; models that differ only in how an effect is put in there share them."""
        return frozenset(c.key for c in self.effects)

    @property
    def prior_cost(self) -> float:
        """What the fitted parameters cost against their tolerances."""
        return self.fit.problem.prior_cost(self.fit.x)

    @property
    def squares(self) -> float:
        """Sum of the squared residuals of all recordings, in variances of the noise, where the fit ended."""
        problem = self.fit.problem
        return counted(problem.training) * self.fit.chi2 + counted(problem.held_out) * self.hold_out

    @property
    def cost(self) -> float:
        """Cost of the fitted recordings where all together are likelier, or where the fit ended, whichever is more."""
        experiments = self.fit.problem.experiments
        fitted = self.left.of([number for number, e in enumerate(experiments) if e.role != "hold_out"])
        return max(self.prior_cost - 2 * fitted.log_likelihood, self.fit.cost)

    @property
    def strain(self) -> float:
        """What the user's own parameters cost against their tolerances."""
        pairs = zip(self.fit.problem.free, self.fit.x, strict=True)
        return float(sum((x / f.spread) ** 2 for f, x in pairs if f.prior and not f.recording))

    @property
    def together(self) -> float:
        """Mean squared residual on held-out data where all recordings together are likeliest, as of `hold_out`."""
        return float(self.unseen.energy.sum() / self.unseen.count.sum())

    @functools.cached_property
    def given(self) -> float:
        """Mean squared residual on held-out data with all parameters as they are given, as of `hold_out`."""
        problem = self.fit.problem
        return problem.chi2(np.zeros(len(problem.free)), problem.judged)

    @functools.cached_property
    def in_step(self) -> bool:
        """Whether it follows the beginnings of all recordings: over them a hair's breadth of parameters does little."""
        begun = beginning(self.fit.problem, SEARCH.beginning)
        return all(begun.chi2(self.fit.x, [e]) < SEARCH.lost for e in begun.experiments)

    @property
    def own(self) -> int:
        """How many of the user's own parameters may move within their tolerances."""
        return sum(1 for f in self.fit.problem.free if f.prior and not f.recording)

    @property
    def bent(self) -> bool:
        """Whether the user's own parameters are farther off than a right model's, a tolerance each on average."""
        return self.strain > self.own

    @property
    def far_off(self) -> list[str]:
        """The user's own parameters that the fit has put farther from their values than `WORDING.far` tolerances."""
        pairs = zip(self.fit.problem.free, self.fit.x, strict=True)
        return [f.name for f, x in pairs if f.prior and abs(x) > WORDING.far]

    @property
    def bent_blocks(self) -> set[str]:
        """The user's own blocks of which the fit has put a parameter farther from its value than it is believed to be.

        By the block's name: more than a tolerance.
        """
        pairs = zip(self.fit.problem.free, self.fit.x, strict=True)
        return {f.name.rpartition(".")[0] for f, x in pairs if f.prior and abs(x / f.spread) > 1}

    @property
    def at_an_end(self) -> list[str]:
        """Sizes of effects, by name, that the fit has put to an end of their range, where another effect begins."""
        rows, found = {f.name: (f, x) for f, x in zip(self.fit.problem.free, self.fit.x, strict=True)}, []
        for effect in self.effects:
            for size in (k for k in effect.parameters if k.least > 0 or k.most is not None):
                free, x = rows.get(f"{effect.name}.{size.name}", (None, 0.0))
                if free is not None and any(math.isclose(free.value(x), end) for end in (free.low, free.high)):
                    found.append(f"{size.name} of {effect.key}")
        return found

    @property
    def room(self) -> float:
        """By how much the evidence could rise at most: what is unexplained, and what the parameters cost."""
        return self.left.unexplained + 0.5 * self.strain

    @property
    def label(self) -> str:
        """The effects in words."""
        return " + ".join(c.key for c in self.effects) or "nothing"

    def judged_as(self, other: ScoredModel) -> ScoredModel:
        """The model where its fit ended, judged on all recordings where another end of its fit was."""
        return replace(
            self,
            left=other.left,
            unseen=other.unseen,
            log_evidence=other.log_evidence,
            foretold=other.foretold,
            owed=other.owed,
            likeliest=other.likeliest,
        )

    def added(self) -> dict[str, float]:
        """Sizes of the effects (SI): ``effect.parameter`` -> fitted value, or the one it stays at."""
        fitted, sizes = self.fit.parameters(), self.sizes or ({},) * len(self.effects)
        rows = {}
        for effect, start in zip(self.effects, sizes, strict=True):
            for parameter in effect.parameters:
                name = f"{effect.name}.{parameter.name}"
                rows[f"{effect.effect}.{parameter.name}"] = fitted.get(name, start.get(parameter.name, float("nan")))
            if effect.freed:
                rows[effect.freed.name] = fitted[effect.freed.name]
        return rows


def scored(
    made: Fit,
    effects: tuple[Candidate, ...],
    sizes: tuple[dict[str, float], ...] = (),
    noise: Noise = "coloured",
    chosen: Sequence[ChosenSize] = (),
    *,
    followed: bool = False,
) -> ScoredModel:
    """A fit judged on all recordings.

    Args:
        made: the fit.
        effects: as of `ScoredModel`.
        sizes: as of `ScoredModel`.
        noise: with which the starting values of held-out recordings are fitted.
        chosen: sizes that are only chosen.
        followed: as of `evidence`.
    """
    problem, x = made.problem, with_held_out_starts(made.problem, made.x, noise=noise)
    found = evidence(problem, x, chosen, followed=followed)
    left = problem.leftover(found.x, problem.experiments, found.moved if chosen else ())
    unseen = left.of([number for number, e in enumerate(problem.experiments) if any(e is j for j in problem.judged)])
    hold_out = problem.chi2(x, problem.judged)
    return ScoredModel(
        effects, replace(made, x=x), sizes, hold_out, left, unseen, found.log, found.foretold, found.owed, found.x
    )
