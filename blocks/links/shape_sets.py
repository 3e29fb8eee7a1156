"""Sets of shape functions in which a link that is clamped at its root bends, and their integrals.

With x = s / L and primes for d/dx, every set is orthonormal: int Q_i Q_j dx = 1 if i = j else 0, and
int Q_i'' Q_j'' dx = 0 unless i = j. Both integrals stay diagonal, so a bending link costs the same in either set.

cantilever: the modes of the link that is clamped at its root and free at its tip (`blocks.links.mode_shapes`). Their
curvature vanishes at the tip, so a link that carries a moment there, as one before a locked or driven joint does, is
approached slowly: the error falls as 1 / n.

craig_bampton: combinations of the two shapes into which a force and a moment at the tip bend the link,
3 x^2 - 2 x^3 and x^3 - x^2, and of the modes of the link clamped at both ends,

    Q = cosh(b x) - cos(b x) - sigma (sinh(b x) - sin(b x)),        cos b cosh b = 1
    sigma = (cosh b - cos b) / (sinh b - sin b)

They meet any load at the tip exactly in the static limit. [Craig 1968]
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blocks.links import mode_shapes

Matrix = NDArray[np.float64]

SETS = ("cantilever", "craig_bampton")


@dataclass(frozen=True)
class ShapeSet:
    """Constants of n shapes, arrays of shape (n,) or (n, n).

    Attributes:
        stiffness: int Q_i''^2 dx.
        area, first_moment: int Q_i dx, int x Q_i dx.
        tip, tip_slope: Q_i and Q_i' at the tip.
        root_curvature: Q_i'' at the root.
        drawn, stiffening, end: int (1 - x) Q_i' Q_j' dx, 1/2 int (1 - x^2) Q_i' Q_j' dx, int Q_i' Q_j' dx.
    """

    stiffness: Matrix
    area: Matrix
    first_moment: Matrix
    tip: Matrix
    tip_slope: Matrix
    root_curvature: Matrix
    drawn: Matrix
    stiffening: Matrix
    end: Matrix

    def __len__(self) -> int:
        return len(self.tip)


@functools.cache
def shape_set(name: str, count: int) -> ShapeSet:
    """The first ``count`` shapes of a set, by its name in `SETS`; ``craig_bampton`` has at least 2."""
    if name == "cantilever" or count == 0:
        return _cantilever(count)
    nodes, weights = np.polynomial.legendre.leggauss(60 + 8 * count)
    x, w = (nodes + 1) / 2, weights / 2
    at = np.concatenate([[0.0], x, [1.0]])
    raw = [np.array([_craig_bampton(i, at, order) for i in range(1, count + 1)]) for order in range(3)]
    mass, bending = ((values[:, 1:-1] * w) @ values[:, 1:-1].T for values in (raw[0], raw[2]))
    factor = np.linalg.inv(np.linalg.cholesky(mass))
    turn = np.linalg.eigh(factor @ bending @ factor.T)[1].T @ factor
    turn *= np.sign(turn @ raw[0][:, -1:]) * (-1.0) ** np.arange(count)[:, None]
    q, slope, curvature = (turn @ values for values in raw)
    return ShapeSet(
        stiffness=np.asarray(curvature[:, 1:-1] ** 2 @ w),
        area=q[:, 1:-1] @ w,
        first_moment=q[:, 1:-1] @ (w * x),
        tip=q[:, -1],
        tip_slope=slope[:, -1],
        root_curvature=curvature[:, 0],
        **_slopes(x, w, slope[:, 1:-1]),
    )


def _cantilever(count: int) -> ShapeSet:
    """The clamped-free modes; most of their integrals have closed forms."""
    nodes, weights = np.polynomial.legendre.leggauss(60 + 8 * count)
    x, w = (nodes + 1) / 2, weights / 2
    modes = range(1, count + 1)
    roots = np.array([mode_shapes.root(i) for i in modes])
    slopes = np.array([mode_shapes.shape(i, x, 1) for i in modes]).reshape(count, len(x))
    return ShapeSet(
        stiffness=roots**4,
        area=np.array([mode_shapes.area(i) for i in modes]),
        first_moment=np.array([mode_shapes.first_moment(i) for i in modes]),
        tip=np.array([mode_shapes.tip(i) for i in modes]),
        tip_slope=np.array([mode_shapes.tip_slope(i) for i in modes]),
        root_curvature=2 * roots**2,
        **_slopes(x, w, slopes),
    )


def _slopes(x: Matrix, w: Matrix, slopes: Matrix) -> dict[str, Matrix]:
    """The integrals of products of slopes, by quadrature."""
    return {
        "drawn": (slopes * (w * (1 - x))) @ slopes.T,
        "stiffening": (slopes * (w * (1 - x**2) / 2)) @ slopes.T,
        "end": (slopes * w) @ slopes.T,
    }


def _craig_bampton(number: int, x: Matrix, derivative: int) -> Matrix:
    """A shape of the set before it is made orthogonal, or its first or second derivative."""
    if number == 1:
        return (3 * x**2 - 2 * x**3, 6 * x - 6 * x**2, 6 - 12 * x)[derivative]
    if number == 2:
        return (x**3 - x**2, 3 * x**2 - 2 * x, 6 * x - 2)[derivative]
    b = _root(number - 2)
    small = math.exp(-b)
    weight = (math.cos(b) - math.sin(b) - small) / (1 - small**2 - 2 * small * math.sin(b))
    sigma = 1 - 2 * weight * small
    rising, falling = weight * np.exp(b * (x - 1)), (1 + sigma) / 2 * np.exp(-b * x)
    cosine, sine = np.cos(b * x), np.sin(b * x)
    shapes = (
        rising + falling - cosine + sigma * sine,
        b * (rising - falling + sine + sigma * cosine),
        b**2 * (rising + falling + cosine - sigma * sine),
    )
    return np.asarray(shapes[derivative])


@functools.cache
def _root(number: int) -> float:
    """Root of cos b cosh b = 1 next to (number + 1/2) pi."""
    b = (number + 0.5) * math.pi
    for _ in range(50):
        sech = 2 * math.exp(-b) / (1 + math.exp(-2 * b))
        step = (math.cos(b) - sech) / (math.sin(b) - sech * math.tanh(b))
        b += step
        if abs(step) <= 1e-15 * b:
            break
    return b
