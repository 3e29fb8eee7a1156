"""A parameter of a table's model that is wrong by a factor while something else is missing too.

Then the refit bends every other parameter to follow the rows that the missing effect changes, and with the wrong one
let go of it ends there as well. Springs, play and modes act at high frequencies; the lowest rows show inertia and
friction alone. So the lowest rows are fitted, half of the table or a third, with one parameter let go of at a time;
where one of them brings those rows to the floor and the tolerances do not, the effects are tried beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.candidate import Candidate
from diagnosis.choice import DECISIVE
from diagnosis.fit import Fit, descend
from diagnosis.problem import Array, Problem
from diagnosis.sines import Sines
from diagnosis.trial import Trial, strained
from engine.errors import FlexarmError
from engine.threads import Threads

if TYPE_CHECKING:
    from diagnosis.workshop import Workshop

SHARES = (0.5, 0.35)
"""Shares of the rows, those of the lowest frequencies, that are fitted: the largest one that can be met counts."""

SUSPECTS, BESIDE, TRIED = 2, 12, 3
"""So many parameters, each looked at with so many of the effects that do best alone, and fitted with so many."""


@dataclass(frozen=True)
class Suspect:
    """A parameter that may be wrong.

    Attributes:
        candidate: it starts from the factor that the lowest rows ask for.
        fit: of the model with it let go of to the lowest rows.
        highest: frequency of those rows (rad/s).
    """

    candidate: Candidate
    fit: Fit
    highest: float

    def told(self) -> str:
        """What the lowest rows say of it, as a sentence."""
        assert self.candidate.loosened is not None
        name, given = self.candidate.loosened.name, self.candidate.loosened.start
        found = self.fit.parameters()[name]
        return (
            f"the rows up to {self.highest:.3g} rad/s alone, where springs and contacts hardly act, ask for "
            f"{name} = {found:.3g}, {found / given:.3g} times the value given"
        )


def suspects(shop: Workshop, listed: Sequence[Candidate], refit: Trial) -> list[Suspect]:
    """Parameters whose being let go of lets the model meet the lowest rows, the best first.

    Args:
        shop: builds models.
        listed: the catalogue.
        refit: the user's model, fitted.

    Returns:
        Nothing unless tables are fitted, the refit had to leave its tolerances, and so it does at the lowest rows.
    """
    if not shop.tables or not strained(refit):
        return []
    for share in SHARES:
        count = sum(len(e.time) for e in _lowest(shop.base, share))
        within = _fitted(shop.base, [np.zeros(len(shop.base.free))], share)
        found = [_let_go(shop, c, share) for c in listed if c.loosened]
        found.sort(key=lambda suspect: suspect.fit.cost)
        if found and found[0].fit.cost < count:
            best = [s for s in found if s.fit.cost < min(within.cost, found[0].fit.cost + DECISIVE)]
            return best[:SUSPECTS] if within.cost - found[0].fit.cost > DECISIVE else []
    return []


def _let_go(shop: Workshop, candidate: Candidate, share: float) -> Suspect:
    """The model with a parameter let go of, fitted to the lowest rows from several factors."""
    assert candidate.loosened is not None
    made = shop.build((candidate,), ({},))
    i = [f.name for f in made.free].index(candidate.loosened.name)
    starts = []
    for sizes in candidate.starts:
        x = np.zeros(len(made.free))
        for value in sizes.values():
            x[i] = made.free[i].position(value)
        starts.append(x)
    fit = _fitted(made, starts, share)
    key = candidate.loosened.name.rpartition(".")[2]
    highest = max(float(e.frequency.max()) for e in _lowest(made, share))
    return Suspect(replace(candidate, starts=({key: made.free[i].value(fit.x[i])},)), fit, highest)


def _fitted(made: Problem, starts: Sequence[Array], share: float) -> Fit:
    rows, n = _lowest(made, share), len(made.free)
    with Threads(1) as pool:
        ends = [descend(made, x, rows, pool) for x in starts]
    x, cost, converged = min(ends, key=lambda end: end[1])
    return Fit(made, x, cost, cost, converged, np.zeros((n, n)))


def _lowest(made: Problem, share: float) -> list[Sines]:
    tables = [e for e in made.chosen("train", "repeat") if isinstance(e, Sines)]
    return [e.rows(np.argsort(e.frequency, kind="stable")[: round(share * len(e.time))]) for e in tables]


def pairs(
    shop: Workshop, suspected: Sequence[Suspect], singles: Sequence[Trial]
) -> Iterator[tuple[Fit, list[tuple[Candidate, ...]]]]:
    """For each suspect, the fit to start from and the pairs of it with the effects that look best beside it.

    Args:
        shop: builds models.
        suspected: parameters.
        singles: effects alone, best first.
    """
    others = [t.effects[0] for t in singles if len(t.effects) == 1 and not t.effects[0].loosened][:BESIDE]
    for suspect in suspected:
        parent, rows = suspect.fit.parameters(), []
        for other in others:
            entries = []
            for group in other.structures():
                try:
                    entries += shop.entries((suspect.candidate, other), [suspect.candidate.starts, group], parent)
                except FlexarmError:
                    continue
            if entries:
                best = min(entries, key=lambda entry: robust(entry.problem, entry.x))
                rows.append((robust(best.problem, best.x), other))
        rows.sort(key=lambda row: row[0])
        yield suspect.fit, [(suspect.candidate, other) for _, other in rows[:TRIED]]


def robust(problem: Problem, x: Array) -> float:
    """Sum of log(1 + r^2) over the fitted rows: a row that is far off costs little more than one that is off."""
    parts = [problem.residual(x, e) for e in problem.chosen("train", "repeat")]
    return float(sum(np.sum(np.log1p(part**2)) for part in parts))
