"""Which two effects together look best: all pairs at once, each effect taken as a small change of what is left over.

Two effects that are missing may hide each other, so that neither is among the leaders alone. Near the refitted model an
effect of a given size adds a known course to the residual, and what the model's own parameters can do is its tangents;
so the best pair of sizes is a linear least-squares problem of two unknowns, solved for all pairs from one Gram matrix.
The order says which pairs are fitted first: those of the leaders follow unless one of these leaves nothing to explain.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.effects.effect import Candidate, Sizes
from diagnosis.estimation.parameters import Array
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.scored_model import ScoredModel
from diagnosis.thresholds import FITTING, PAIRS
from engine.errors import FlexarmError, SimulationError
from engine.spread import Spread


@dataclass(frozen=True)
class Sensitivity:
    """What an effect of some size adds to the residual.

    Attributes:
        effect, sizes: which.
        values: residual with it less the residual without, fitted recordings and prior stacked.
    """

    effect: Candidate
    sizes: Sizes
    values: Array


def promising(
    fitter: CandidateFitter, refit: ScoredModel, effects: Sequence[Candidate], count: int
) -> list[tuple[Candidate, ...]]:
    """The pairs that take most of the residual away, the best first, to start from the sizes that do.

    Args:
        fitter: builds models.
        refit: the user's model, fitted.
        effects: those to pair; a freed parameter is left out.
        count: largest number of pairs.
    """
    made, x = refit.fit.problem, refit.fit.x
    training = made.training
    every = max(1, sum(len(e.time) for e in training) // PAIRS.samples)
    own, parts = made.prior(x), []
    try:
        for e in training:
            r, J = made.linearised(x, e)
            rows = r.reshape(e.measured.shape)[::every].ravel()
            parts.append((rows, J.reshape(*e.measured.shape, -1)[::every].reshape(len(rows), -1)))
    except SimulationError:
        return []
    r, J = np.concatenate([*(p[0] for p in parts), own[0]]), np.vstack([*(p[1] for p in parts), own[1]])

    def one(effect: Candidate) -> list[Sensitivity]:
        return list(_sensitivities(fitter, refit, effect, r, every))

    with Spread(fitter.workers, threads=True) as pool:
        sensitivities = [c for row in pool.map(one, [c for c in effects if not c.freed]) for c in row]
    if len(sensitivities) < 2:
        return []
    basis = np.linalg.qr(J)[0] if J.shape[1] else np.zeros((len(r), 0))
    table = np.column_stack([c.values for c in sensitivities])
    table -= basis @ (basis.T @ table)
    gram, pull = table.T @ table, -table.T @ (r - basis @ (basis.T @ r))
    return list(itertools.islice(_ranked(sensitivities, *_gains(gram, pull)), count))


def _sensitivities(
    fitter: CandidateFitter, refit: ScoredModel, effect: Candidate, r: Array, every: int
) -> Iterator[Sensitivity]:
    """The courses of an effect at several of its starting sizes; none where it cannot be simulated."""
    parent, own = refit.fit.parameters(), refit.fit.problem.prior(refit.fit.x)[0]
    groups = effect.structures()
    for group in groups:
        few = max(2, PAIRS.sizes // len(groups))
        picked = [group[k] for k in np.unique(np.linspace(0, len(group) - 1, few).astype(int))]
        try:
            points = fitter.points((effect,), [picked], parent)
        except FlexarmError:
            continue
        for point in points:
            there = point.problem.training
            rows = [point.problem.residual(point.x, e)[::every].ravel() for e in there]
            values = np.concatenate([*rows, own]) - r
            if np.abs(values).max() < FITTING.huge / 10 and float(values @ values) > 0:
                yield Sensitivity(effect, point.sizes[0], values)


def _gains(gram: Array, pull: Array) -> tuple[Array, Array]:
    """For each pair of courses, how much of the cost they take away, and how far their factors are from 1.

    Nothing where a factor is out of reach; the distance is the sum of the logarithms' magnitudes.
    """
    own = np.diag(gram)
    whole = np.outer(own, own)
    determinant = whole - gram**2
    determinant = np.where(determinant > 1e-9 * whole, determinant, np.inf)
    first = (own[None, :] * pull[:, None] - gram * pull[None, :]) / determinant
    second = first.T
    able = (first > 1 / PAIRS.factor) & (first < PAIRS.factor) & (second > 1 / PAIRS.factor) & (second < PAIRS.factor)
    gains = np.where(able, first * pull[:, None] + second * pull[None, :], 0.0)
    far = np.abs(np.log(np.where(able, first, 1.0))) + np.abs(np.log(np.where(able, second, 1.0)))
    return gains, far


def _ranked(sensitivities: Sequence[Sensitivity], gains: Array, far: Array) -> Iterator[tuple[Candidate, ...]]:
    """Pairs of different effects, best first, a few of a kind, with the sizes nearest to those that are asked for."""
    keys = [c.effect.key for c in sensitivities]
    groups: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for a, b in zip(*np.nonzero(np.triu(gains, 1) > 0), strict=True):
        if sensitivities[a].effect.effect != sensitivities[b].effect.effect:
            groups.setdefault((keys[a], keys[b]), []).append((int(a), int(b)))
    best = {key: max(float(gains[at]) for at in group) for key, group in groups.items()}
    places: dict[frozenset[str], int] = {}
    for key in sorted(groups, key=lambda key: -best[key]):
        one, other = (sensitivities[k].effect for k in groups[key][0])
        kind = frozenset((one.effect, other.effect))
        places[kind] = places.get(kind, 0) + 1
        if places[kind] > PAIRS.places:
            continue
        able = [at for at in groups[key] if gains[at] > PAIRS.nearly * best[key]]
        chosen = sorted(able, key=lambda at: far[at])[: PAIRS.kept]
        rows = [(sensitivities[a].sizes, sensitivities[b].sizes) for a, b in chosen]
        yield tuple(_begun(effect, [row[k] for row in rows]) for k, effect in enumerate((one, other)))


def _begun(effect: Candidate, sizes: Sequence[Sizes]) -> Candidate:
    """The effect to start from some of its sizes; a wave, at every order as well."""
    starts = {str(s): s for s in [*sizes, *(effect.wave.starts[:1] if effect.wave else ())]}
    return replace(effect, starts=tuple(starts.values()), bold=())
