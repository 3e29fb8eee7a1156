"""How much recordings speak for a model: one number, in which all models of a study are compared.

What a model leaves over is taken for coloured noise of unknown strength. Each signal's residual is split by the cosine
transform into bands of a third of an octave; in each, the noise is as strong as the model leaves it, and never weaker
than the sensor's. So a model is credited for every independent piece of the mismatch that it explains, at the noise
floor and far above it alike, and a mismatch that no model explains is no evidence against any of them. The logarithm of
the likelihood of all recordings, those held out as well, less what the parameters cost (prior, and the share of the
prior's volume that is left to them by Laplace's approximation [Kass 1995]) is the evidence:

    ln Z = -1/2 sum_b (n_b ln v_b + E_b / v_b) - 1/2 sum_i (x_i - c_i)^2 / s_i^2 - 1/2 ln(det(H + P) / det P)

with v_b = max(E_b / n_b, 1) the strength, E_b the energy and n_b the number of values of a band, P the information of
the prior and H that of the training recordings, each band weighed by 1 / v_b. A size that is only chosen, such as a
delay, is a parameter like others here: what has no derivative has not been chosen for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.leftover import Leftover
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
from diagnosis.thresholds import EVIDENCE
from engine.errors import SimulationError


@dataclass(frozen=True)
class ChosenSize:
    """A size that is only chosen, as the evidence takes it: by its logarithm.

    Attributes:
        slopes: derivative of the residual of each training recording, shape (samples, signals) each.
        away: from where such sizes usually are.
        spread: standard deviation of the prior.
    """

    slopes: tuple[Array, ...]
    away: float
    spread: float


def information(problem: Problem, x: Array, left: Leftover, chosen: Sequence[ChosenSize] = ()) -> tuple[Array, Array]:
    """What the training recordings and the prior know of the search vector: two matrices, shape (n, n) each.

    Args:
        problem: of a model.
        x: search vector where its fit ended.
        left: what the model leaves over of all recordings: each band weighs as its noise is strong.
        chosen: sizes that are only chosen, which follow the search vector in both matrices.

    Raises:
        SimulationError: the run cannot be differentiated.
    """
    weights = problem.prior(x)[1]
    own = np.diag([*np.zeros(len(x)), *(1 / size.spread**2 for size in chosen)])
    own[: len(x), : len(x)] = weights.T @ weights
    data = np.zeros_like(own)
    strengths = left.by_band
    pairs = zip(problem.training, linearised(problem, x, problem.training), strict=True)
    for number, (e, (_, J)) in enumerate(pairs):
        extra = [size.slopes[number][:, :, None] for size in chosen]
        slopes = np.concatenate([J, *extra], axis=2)
        for k in range(slopes.shape[1]):
            rows = e.components(slopes[:, k])
            for band, part in e.bands(EVIDENCE.fewest):
                strength = strengths.get((k, band))
                if strength:
                    data += rows[part].T @ rows[part] / strength
    return data, own


def evidence(problem: Problem, x: Array, left: Leftover, chosen: Sequence[ChosenSize] = ()) -> float:
    """Logarithm of the evidence of a fitted model, but for a constant that all models of a study share.

    Args:
        problem: of the model.
        x: where its fit ended.
        left: what it leaves over of all recordings.
        chosen: sizes that are only chosen.
    """
    try:
        data, own = information(problem, x, left, chosen)
    except SimulationError:
        return -math.inf
    prior = float(np.sum(problem.prior(x)[0] ** 2)) + sum((size.away / size.spread) ** 2 for size in chosen)
    volume = float(np.linalg.slogdet(data + own)[1] - np.linalg.slogdet(own)[1])
    return left.log_likelihood - 0.5 * prior - 0.5 * volume
