"""An uncertain model from a fit: linear models drawn from its covariance, and bounds from its held-out recordings."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from engine.errors import ParameterError
from engine.family import Axis, collect
from engine.linearise import operating_point
from flexarm.cut import Cut
from flexarm.design.point import point, start_of
from flexarm.design.uncertainty.bounds import bounds
from flexarm.design.uncertainty.results import UncertainModel

if TYPE_CHECKING:
    from diagnosis.estimation.least_squares import Fit


def uncertain(
    made: Cut,
    fit: Fit,
    *,
    samples: int = 50,
    seed: int = 0,
    modes: Any = None,
    at: Any = None,
    trim: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> UncertainModel:
    """A family of linear models, and a bound on held-out responses, from a fit.

    Args:
        made: inputs and outputs of the linear models.
        fit: of the same scenario, with held-out recordings for the bound.
        samples: members of the family beside the fitted one.
        seed: of the draws.
        modes: as of `flexarm.api.linearise`, and the next two.
        at: the point otherwise.
        trim: an analysis of kind ``trim``.
        progress: told the fraction of the simulations done.

    Raises:
        FlexarmError: no sample, or as of the linear models.
    """
    from diagnosis.estimation.held_out_starts import with_held_out_starts

    if samples < 1:
        raise ParameterError(f"{samples} samples are no family", remedy="give 1 or more")
    x = with_held_out_starts(fit.problem, fit.x)
    draws = _draws(fit, x, samples, seed)
    known = {p.name for p in made.model.parameters}
    values = [{k: v for k, v in fit.problem.values(d)[0].items() if k in known} for d in draws]
    asked = point(made, modes, at)
    there = start_of(made, asked, trim, at)
    there = _heard(made, there, asked, values[0])
    points = [operating_point(made.model, **there, parameters=p) for p in values]
    labels = ("fitted", *(str(k) for k in range(1, len(draws))))
    axis = Axis("sample", "", np.arange(len(draws), dtype=float), labels)
    family = collect(made.model, [axis], points, values)
    bands, weights = bounds(fit, draws, progress)
    free = [i for i, f in enumerate(fit.problem.free) if not f.recording]
    slope = np.array([fit.problem.free[i].slope(fit.x[i]) for i in free])
    covariance = fit.covariance[np.ix_(free, free)] * np.outer(slope, slope)
    names = tuple(fit.problem.free[i].name for i in free)
    return UncertainModel(family, tuple(values), names, covariance, weights, bands, fit)


def _heard(made: Cut, there: dict[str, Any], asked: dict[str, Any], parameters: dict[str, float]) -> dict[str, Any]:
    """The point in modes in which every input moves some output, as `flexarm.api.linearise` takes them."""
    from engine.linear_modes import audible
    from engine.linearise import linearise

    here = linearise(made.model, **there, parameters=parameters)
    heard = audible(made.model, here, **{**there, "modes": asked["modes"], "parameters": parameters})
    return {**there, "modes": dict(heard.modes)} if heard.modes else there


def _draws(fit: Fit, x: NDArray[np.float64], count: int, seed: int) -> list[NDArray[np.float64]]:
    """The search vector, then draws about it. Starting values of recordings stay."""
    values, vectors = np.linalg.eigh((fit.covariance + fit.covariance.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    still = np.array([bool(f.recording) for f in fit.problem.free])
    random = np.random.default_rng(seed)
    rows = [x]
    for _ in range(count):
        change = root @ random.standard_normal(len(x))
        rows.append(x + np.where(still, 0.0, change))
    return rows
