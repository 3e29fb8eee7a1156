"""A parameter of a table's model that is wrong by a factor while something else is missing too.

Then the refit bends every other parameter to follow the rows that the missing effect changes, and with the wrong one
freed it ends there as well. Springs, play and modes act at high frequencies; the lowest rows show inertia and
friction alone. So the lowest rows are fitted, half of the table or a third, with one parameter freed at a time;
where one of them brings those rows to the floor and the tolerances do not, the effects are tried beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import Fit, descend
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.scored_model import ScoredModel, outside_tolerances
from diagnosis.thresholds import PREFERENCE, TABLES
from engine.errors import FlexarmError
from engine.threads import Threads


@dataclass(frozen=True)
class WrongParameter:
    """A parameter that may be wrong.

    Attributes:
        candidate: it starts from the factor that the lowest rows ask for.
        fit: of the model with this parameter freed, to the lowest rows.
        highest: frequency of those rows (rad/s).
    """

    candidate: Candidate
    fit: Fit
    highest: float

    def told(self) -> str:
        """What the lowest rows say of it, as a sentence."""
        assert self.candidate.freed is not None
        name, given = self.candidate.freed.name, self.candidate.freed.start
        found = self.fit.parameters()[name]
        return (
            f"the rows up to {self.highest:.3g} rad/s alone, where springs and contacts hardly act, ask for "
            f"{name} = {found:.3g}, {found / given:.3g} times the value given"
        )


def suspects(fitter: CandidateFitter, listed: Sequence[Candidate], refit: ScoredModel) -> list[WrongParameter]:
    """Parameters that let the model meet the lowest rows once they are freed, the best first.

    Args:
        fitter: builds models.
        listed: the catalogue.
        refit: the user's model, fitted.

    Returns:
        Nothing unless tables are fitted, the refit had to leave its tolerances, and so it does at the lowest rows.
    """
    if not fitter.tables or not outside_tolerances(refit):
        return []
    for share in TABLES.lowest_shares:
        count = sum(len(e.time) for e in _lowest(fitter.base, share))
        within = _fitted(fitter.base, [np.zeros(len(fitter.base.free))], share)
        found = [_let_go(fitter, c, share) for c in listed if c.freed]
        found.sort(key=lambda suspect: suspect.fit.cost)
        if found and found[0].fit.cost < count:
            best = [s for s in found if s.fit.cost < min(within.cost, found[0].fit.cost + PREFERENCE.decisive)]
            return best[: TABLES.suspects] if within.cost - found[0].fit.cost > PREFERENCE.decisive else []
    return []


def _let_go(fitter: CandidateFitter, candidate: Candidate, share: float) -> WrongParameter:
    """The model with a parameter freed, fitted to the lowest rows from several factors."""
    assert candidate.freed is not None
    made = fitter.build((candidate,), ({},))
    i = [f.name for f in made.free].index(candidate.freed.name)
    starts = []
    for sizes in candidate.starts:
        x = np.zeros(len(made.free))
        for value in sizes.values():
            x[i] = made.free[i].position(value)
        starts.append(x)
    fit = _fitted(made, starts, share)
    key = candidate.freed.name.rpartition(".")[2]
    highest = max(e.highest_frequency or 0.0 for e in _lowest(made, share))
    return WrongParameter(replace(candidate, starts=({key: made.free[i].value(fit.x[i])},)), fit, highest)


def _fitted(made: Problem, starts: Sequence[Array], share: float) -> Fit:
    rows, n = _lowest(made, share), len(made.free)
    with Threads(1) as pool:
        ends = [descend(made, x, rows, pool) for x in starts]
    x, cost, converged = min(ends, key=lambda end: end[1])
    return Fit(made, x, cost, cost, converged, np.zeros((n, n)))


def _lowest(made: Problem, share: float) -> list[Experiment]:
    return [e.lowest(share) for e in made.training]


def pairs(
    fitter: CandidateFitter, suspected: Sequence[WrongParameter], singles: Sequence[ScoredModel]
) -> Iterator[tuple[Fit, list[tuple[Candidate, ...]]]]:
    """For each suspect, the fit to start from and the pairs of it with the effects that look best beside it.

    Args:
        fitter: builds models.
        suspected: parameters.
        singles: effects alone, best first.
    """
    others = [t.effects[0] for t in singles if len(t.effects) == 1 and not t.effects[0].freed][: TABLES.beside]
    for suspect in suspected:
        parent, rows = suspect.fit.parameters(), []
        for other in others:
            points = []
            for group in other.structures():
                try:
                    points += fitter.points((suspect.candidate, other), [suspect.candidate.starts, group], parent)
                except FlexarmError:
                    continue
            if points:
                best = min(points, key=lambda point: robust(point.problem, point.x))
                rows.append((robust(best.problem, best.x), other))
        rows.sort(key=lambda row: row[0])
        yield suspect.fit, [(suspect.candidate, other) for _, other in rows[: TABLES.tried]]


def robust(problem: Problem, x: Array) -> float:
    """Sum of log(1 + r^2) over the fitted rows: a row that is far off costs little more than one that is off."""
    parts = [problem.residual(x, e) for e in problem.training]
    return float(sum(np.sum(np.log1p(part**2)) for part in parts))
