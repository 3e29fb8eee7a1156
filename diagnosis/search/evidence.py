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
luck within that uncertainty, and two models that do the same may differ in it by tens. So x is where the fit ended, or
one step further, towards what all recordings together ask for, whichever is likelier.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.leftover import Leftover, left_by
from diagnosis.estimation.parameters import Array, moved
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
from diagnosis.thresholds import EVIDENCE
from engine.errors import SimulationError


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


def evidence(
    problem: Problem,
    x: Array,
    left: Leftover,
    chosen: Sequence[ChosenSize] = (),
    instants: Sequence[Experiment] | None = None,
) -> float:
    """Logarithm of the evidence of a fitted model, but for a constant that all models of a study share.

    Args:
        problem: of the model.
        x: where its fit ended.
        left: what it leaves over of all recordings, at those instants.
        chosen: sizes that are only chosen.
        instants: experiments whose values count, one for each of the model's; its own, if None.
    """
    instants = problem.experiments if instants is None else instants
    try:
        slopes = _slopes(problem, x, chosen, instants)
    except SimulationError:
        return -math.inf
    pull, data = np.zeros(len(x) + len(chosen)), np.zeros((len(x) + len(chosen),) * 2)
    strengths = left.by_band
    for e, (r, J) in zip(instants, slopes, strict=True):
        for k in range(r.shape[1]):
            errors, rows = e.components(r[:, k]), e.components(J[:, k])
            for band, part in e.bands(EVIDENCE.fewest):
                strength = strengths.get((k, band))
                if strength:
                    pull += rows[part].T @ errors[part] / strength
                    data += rows[part].T @ rows[part] / strength
    away, own = _prior(problem, x, chosen)
    step: Array = -np.asarray(np.linalg.lstsq(data + own.T @ own, pull + own.T @ away, rcond=None)[0])
    fitted = left.log_likelihood - 0.5 * float(away @ away)
    together = _stepped(problem, x, step, chosen, instants, [J for _, J in slopes])
    volume = float(np.linalg.slogdet(data + own.T @ own)[1] - np.linalg.slogdet(own.T @ own)[1])
    return max(fitted, together) - 0.5 * volume


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


def _stepped(
    problem: Problem,
    x: Array,
    step: Array,
    chosen: Sequence[ChosenSize],
    instants: Sequence[Experiment],
    slopes: Sequence[Array],
) -> float:
    """Logarithm of likelihood and prior after a step; the model runs there, sizes that are only chosen by slopes."""
    n = len(x)
    there = moved(problem.free, x, step[:n], range(n))
    rows = problem.residuals(there, problem.experiments)
    rows = [
        np.where(np.isfinite(e.measured), r + J[..., n:] @ step[n:], 0.0)
        for e, r, J in zip(instants, rows, slopes, strict=True)
    ]
    nearer = [replace(size, away=size.away + change) for size, change in zip(chosen, step[n:].tolist(), strict=True)]
    away, _ = _prior(problem, there, nearer)
    return left_by(instants, rows).log_likelihood - 0.5 * float(away @ away)
