"""A least-squares straight line, its slope with an interval from the residuals or from known noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.stats import t as student

from diagnosis.recordings.columns import Vector


@dataclass(frozen=True)
class Line:
    """A least-squares line, y = intercept + slope x.

    Attributes:
        slope, intercept: of the line.
        standard_error: of the slope; from the residuals or from known noise, the larger of the two.
        half_width: of the slope's 95 % interval; from Student's t with n - 2 degrees of freedom on the residuals, or
            1.96 standard errors of known noise, the larger of the two.
    """

    slope: float
    intercept: float
    standard_error: float
    half_width: float


def fit_line(x: Vector, y: Vector, covariance: Vector | None = None) -> Line:
    """The least-squares line through points.

    Args:
        x: shape (n,), n >= 2.
        y: shape (n,).
        covariance: of the noise in ``y``, shape (n, n), if known.
    """
    n = len(x)
    centred = x - x.mean()
    weights = centred / (centred @ centred)
    slope = float(weights @ y)
    intercept = float(y.mean() - slope * x.mean())
    residual = y - intercept - slope * x
    from_residuals = math.sqrt(float(residual @ residual) / (n - 2) / float(centred @ centred)) if n > 2 else 0.0
    from_noise = math.sqrt(max(float(weights @ covariance @ weights), 0.0)) if covariance is not None else 0.0
    quantile = float(student.ppf(0.975, n - 2)) if n > 2 else 0.0
    return Line(
        slope,
        intercept,
        max(from_residuals, from_noise),
        max(quantile * from_residuals, 1.96 * from_noise),
    )
