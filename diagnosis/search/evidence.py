"""How much recordings speak for a model: one number, in which all models of a study are compared.

What a model leaves over is taken for coloured noise of unknown strength. Each signal's residual is split by the cosine
transform into bands of a third of an octave; in each, the noise is as strong as the model leaves it, and never weaker
than the sensor's. So a model is credited for every independent piece of the mismatch that it explains, at the noise
floor and far above it alike, and a mismatch that no model explains is no evidence against any of them. The logarithm of
the likelihood of all recordings, those held out as well, less what the parameters cost (prior, and the share of the
prior's volume that is left to them by Laplace's approximation [Kass 1995]) is the evidence:

    ln Z = -1/2 sum_b (n_b ln v_b + E_b / v_b) - 1/2 sum_i (x_i - c_i)^2 / s_i^2 - 1/2 ln(det(H + P) / det P)

with v_b = max(E_b / n_b, 1) the strength, E_b the energy and n_b the number of values of a band, P the information of
the prior and H that of the recordings, each band weighed by 1 / v_b. A size that is only chosen, such as a
delay, is a parameter like others here: what has no derivative has not been chosen for nothing.

Held-out recordings are foretold with parameters that the fitted ones leave uncertain. How well they happen to be met is
luck within that uncertainty, and two models that do the same may differ in it by tens. So x is where all recordings
together are likeliest: one step from where the fit ended, or as many as it takes, where the first does not keep what it
promised and the caller asks for them. What is left over is told there, too. How well a model foretells held-out
recordings is the evidence of all recordings over that of the fitted ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.least_squares import descend
from diagnosis.estimation.leftover import Leftover, left_by
from diagnosis.estimation.parameters import Array, moved
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import SimulationError
from engine.threads import Threads


@dataclass(frozen=True)
class ChosenSize:
    """A size that is only chosen, as the evidence takes it: by its logarithm.

    Attributes:
        slopes: derivative of the residual of each recording, shape (samples, signals) each.
        away: from where such sizes usually are.
        spread: standard deviation of the prior.
    """

    slopes: tuple[Array, ...]
    away: float
    spread: float


@dataclass(frozen=True)
class Evidence:
    """How much recordings speak for a model, and where they speak most for it.

    Attributes:
        log: logarithm of the evidence of all recordings, but for a constant that all models of a study share.
        foretold: how much of it held-out recordings add to that of the fitted ones; all, where none is held out.
        x: search vector at which all recordings together are likelier: where the fit ended, or further on.
        moved: what sizes that are only chosen change of the residual of each recording with that step, shape (samples,
            signals) each.
        owed: by how much it gains less with one step than the tangents promised; 0 where more than one was taken.
    """

    log: float
    foretold: float
    x: Array
    moved: tuple[Array, ...]
    owed: float = 0.0


def evidence(
    problem: Problem,
    x: Array,
    chosen: Sequence[ChosenSize] = (),
    instants: Sequence[Experiment] | None = None,
    *,
    followed: bool = False,
) -> Evidence:
    """The evidence of a fitted model.

    Args:
        problem: of the model.
        x: where its fit ended.
        chosen: sizes that are only chosen.
        instants: experiments whose values count, one for each of the model's; its own, if None.
        followed: whether as many steps are taken as it takes, to where all recordings are likeliest, or one.
    """
    instants = problem.experiments if instants is None else instants
    still = tuple(np.zeros(e.measured.shape) for e in instants)
    none = Evidence(-math.inf, -math.inf, x, still)
    try:
        near = _Near(problem, x, chosen, instants)
    except SimulationError:
        return none
    every = range(len(instants))
    fitted = [number for number, e in enumerate(instants) if e.role != "hold_out"]
    found = near.marginal(every)
    before = near.marginal(fitted).log if len(fitted) < len(instants) else 0.0
    if followed:
        near, found = _followed(near, found)
    foretold = found.log - before
    if not math.isfinite(foretold):
        return none  # a run that leaves all bounds there speaks for nothing
    owed = 0.0 if followed or len(fitted) == len(instants) else found.owed
    there, changes = near.stepped(found.step)
    return Evidence(found.log, foretold, there, tuple(changes), owed)


@dataclass(frozen=True)
class _Marginal:
    """The evidence of some recordings near the end of a fit.

    Attributes:
        log: its logarithm.
        likely: that of the likelihood, less what parameters cost, after the step.
        step: to where they are likelier, none if they are not.
        owed: by how much the likelihood rises less with it than the tangents promised.
    """

    log: float
    likely: float
    step: Array
    owed: float


def _followed(near: _Near, found: _Marginal) -> tuple[_Near, _Marginal]:
    """Where all recordings are likeliest, and their evidence there: where one step does not lead, several do.

    An angle at which a pendulum hangs, or a knee of a friction, may be told by held-out recordings alone.
    """
    problem = near.problem
    with Threads(1) as pool:
        x, *_ = descend(problem, near.x, problem.experiments, pool, least_gain=SEARCH.slow)
    try:
        there = _Near(problem, x, near.chosen, near.instants)
    except SimulationError:
        return near, found
    other = there.marginal(range(len(near.instants)))
    return (there, other) if other.likely > found.likely else (near, found)


class _Near:
    """A model near the end of its fit: its residuals and their slopes, those of sizes that are only chosen last.

    Args:
        problem, x, chosen, instants: as of `evidence`.

    Raises:
        SimulationError: the run cannot be differentiated.
    """

    def __init__(
        self, problem: Problem, x: Array, chosen: Sequence[ChosenSize], instants: Sequence[Experiment]
    ) -> None:
        self.problem, self.x, self.chosen, self.instants = problem, x, chosen, instants
        self._away, self._own = _prior(problem, x, chosen)
        found = _slopes(problem, x, chosen, instants)
        self._rows, self._slopes = [r for r, _ in found], [J for _, J in found]
        self._parts = [_by_band(e, r, J) for e, (r, J) in zip(instants, found, strict=True)]

    def marginal(self, numbers: Sequence[int]) -> _Marginal:
        """The evidence of some of the recordings."""
        some = [self.instants[k] for k in numbers]
        left = left_by(some, [self._rows[k] for k in numbers])
        away, own = self._away, self._own
        pull, data = self._information(numbers, left)
        slope = pull + own.T @ away
        step: Array = -np.asarray(np.linalg.lstsq(data + own.T @ own, slope, rcond=None)[0])
        promised = -0.5 * float(slope @ step)
        likely = left.log_likelihood - 0.5 * float(away @ away)
        beyond, away = self._left_after(step, numbers)
        gained = beyond.log_likelihood - 0.5 * float(away @ away) - likely
        if gained > 0:
            likely, left = likely + gained, beyond
            data = self._information(numbers, left)[1]
        else:
            step = np.zeros(len(step))
        volume = float(np.linalg.slogdet(data + own.T @ own)[1] - np.linalg.slogdet(own.T @ own)[1])
        return _Marginal(likely - 0.5 * volume, likely, step, promised - max(gained, 0.0))

    def _left_after(self, step: Array, numbers: Sequence[int]) -> tuple[Leftover, Array]:
        """What some recordings leave over after a step, and how far from the prior's middle it leads."""
        there, changes = self.stepped(step)
        some = [self.instants[k] for k in numbers]
        rows = self.problem.residuals(there, [self.problem.experiments[k] for k in numbers])
        runs = zip(some, rows, numbers, strict=True)
        left = left_by(some, [np.where(np.isfinite(e.measured), r + changes[k], 0.0) for e, r, k in runs])
        further = zip(self.chosen, step[len(self.x) :].tolist(), strict=True)
        nearer = [replace(size, away=size.away + change) for size, change in further]
        return left, _prior(self.problem, there, nearer)[0]

    def stepped(self, step: Array) -> tuple[Array, list[Array]]:
        """The search vector after a step, and what sizes that are only chosen change of each residual, by slopes."""
        n = len(self.x)
        return moved(self.problem.free, self.x, step[:n], range(n)), [J[..., n:] @ step[n:] for J in self._slopes]

    def _information(self, numbers: Sequence[int], left: Leftover) -> tuple[Array, Array]:
        """Gradient and curvature of half the misfit of some recordings, with noise as strong as what is left over."""
        size, strengths = self._own.shape[1], left.by_band
        pull, data = np.zeros(size), np.zeros((size, size))
        for number in numbers:
            for name, errors, rows in self._parts[number]:
                if strength := strengths.get(name):
                    pull += rows.T @ errors / strength
                    data += rows.T @ rows / strength
        return pull, data


def _by_band(e: Experiment, r: Array, J: Array) -> list[tuple[tuple[int, int], Array, Array]]:
    """Signal and band, residual and slopes of each band of a recording."""
    found = []
    for k in range(r.shape[1]):
        errors, rows = e.components(r[:, k]), e.components(J[:, k])
        found += [((k, band), errors[part], rows[part]) for band, part in e.bands(EVIDENCE.fewest)]
    return found


def _slopes(
    problem: Problem, x: Array, chosen: Sequence[ChosenSize], instants: Sequence[Experiment]
) -> list[tuple[Array, Array]]:
    """Residuals of all recordings at some instants and their slopes, those of sizes that are only chosen last.

    Raises:
        SimulationError: the run cannot be differentiated.
    """
    found = []
    for number, (e, (r, J)) in enumerate(zip(instants, linearised(problem, x, problem.experiments), strict=True)):
        known = np.isfinite(e.measured)
        slopes = np.concatenate([J, *(size.slopes[number][:, :, None] for size in chosen)], axis=2)
        found.append((np.where(known, r, 0.0), np.where(known[:, :, None], slopes, 0.0)))
    return found


def _prior(problem: Problem, x: Array, chosen: Sequence[ChosenSize]) -> tuple[Array, Array]:
    """Residual and Jacobian of the prior, sizes that are only chosen last."""
    r, J = problem.prior(x)
    rows = np.zeros((len(r) + len(chosen), len(x) + len(chosen)))
    rows[: len(r), : len(x)] = J
    for k, size in enumerate(chosen):
        rows[len(r) + k, len(x) + k] = 1 / size.spread
    return np.concatenate([r, [size.away / size.spread for size in chosen]]), rows
