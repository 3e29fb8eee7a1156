"""Mode functions of the uniform clamped-free beam, without cancellation at any order.

With x = s / L and b = beta_i:

    Q_i = cosh(b x) - cos(b x) - sigma_i (sinh(b x) - sin(b x)),        cos b cosh b = -1
    sigma_i = (cosh b + cos b) / (sinh b + sin b)

so that int Q_i Q_j ds = L delta_ij. The hyperbolic part is written (1 - sigma)/2 exp(b x) + (1 + sigma)/2 exp(-b x),
with 1 - sigma = 2 (sin b - cos b - exp(-b)) exp(-b) / (1 - exp(-2 b) + 2 exp(-b) sin b): nothing large is subtracted.
[Blevins 1979, Table 8-1]
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@functools.cache
def root(mode: int) -> float:
    """Root beta of a mode (1, 2, ...), that of cos b + 1 / cosh b = 0 next to (mode - 1/2) pi."""
    b = (mode - 0.5) * math.pi
    for _ in range(50):
        sech = 2 * math.exp(-b) / (1 + math.exp(-2 * b))
        step = (math.cos(b) + sech) / (math.sin(b) + sech * math.tanh(b))
        b += step
        if abs(step) <= 1e-15 * b:
            break
    return b


def _rising(mode: int) -> float:
    """(1 - sigma) exp(b) / 2, the weight of exp(b (x - 1)) in the hyperbolic part."""
    b = root(mode)
    small = math.exp(-b)
    return (math.sin(b) - math.cos(b) - small) / (1 - small**2 + 2 * small * math.sin(b))


def sigma(mode: int) -> float:
    """The constant sigma of a mode."""
    return 1 - 2 * _rising(mode) * math.exp(-root(mode))


def shape(mode: int, x: Vector | float, derivative: int = 0) -> Vector:
    """Q_i, or its first or second derivative with respect to x = s / L, at x in [0, 1]."""
    b, x = root(mode), np.asarray(x, dtype=float)
    rising = _rising(mode) * np.exp(b * (x - 1))
    falling = (1 + sigma(mode)) / 2 * np.exp(-b * x)
    cosine, sine = np.cos(b * x), np.sin(b * x)
    if derivative == 0:
        return np.asarray(rising + falling - cosine + sigma(mode) * sine)
    if derivative == 1:
        return np.asarray(b * (rising - falling + sine + sigma(mode) * cosine))
    return np.asarray(b**2 * (rising + falling + cosine - sigma(mode) * sine))


def tip(mode: int) -> float:
    """Q_i at the tip: +2, -2, +2, ..."""
    return 2.0 if mode % 2 else -2.0


def tip_slope(mode: int) -> float:
    """dQ_i/dx at the tip."""
    return tip(mode) * sigma(mode) * root(mode)


def first_moment(mode: int) -> float:
    """First moment int x Q_i dx = 2 / beta^2: the coupling with a rotation of the hub."""
    return 2.0 / root(mode) ** 2


def area(mode: int) -> float:
    """Area int Q_i dx = 2 sigma / beta."""
    return 2.0 * sigma(mode) / root(mode)


@functools.cache
def stiffening(modes: int) -> tuple[Vector, Vector]:
    """Foreshortening integrals of the first ``modes`` modes.

    Returns:
        1/2 int (1 - x^2) Q_i' Q_j' dx and int Q_i' Q_j' dx (primes with respect to x), each of shape (modes, modes).
    """
    nodes, weights = np.polynomial.legendre.leggauss(60 + 8 * modes)
    x, w = (nodes + 1) / 2, weights / 2
    slopes = np.array([shape(mode, x, 1) for mode in range(1, modes + 1)])
    beam = (slopes * (w * (1 - x**2) / 2)) @ slopes.T
    end = (slopes * w) @ slopes.T
    return (beam + beam.T) / 2, (end + end.T) / 2
