"""Clamped-free mode functions against mpmath and scipy's quadrature, up to mode 32."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import mpmath  # type: ignore[import-untyped]
import numpy as np
import pytest
from scipy import integrate

from blocks.links import mode_shapes

HIGH = [1, 2, 3, 4, 5, 8, 12, 20, 32]


@cache
def exact(mode: int) -> tuple[mpmath.mpf, mpmath.mpf]:
    """Root and sigma in 80 digits, from the equations as they stand."""
    with mpmath.workdps(80):
        guess = mpmath.mpf(1.8751) if mode == 1 else (mode - mpmath.mpf(1) / 2) * mpmath.pi
        b = mpmath.findroot(lambda b: mpmath.cos(b) + 1 / mpmath.cosh(b), guess)
        return b, (mpmath.cosh(b) + mpmath.cos(b)) / (mpmath.sinh(b) + mpmath.sin(b))


def shape(mode: int, x: float, derivative: int) -> float:
    """The mode function in 80 digits."""
    b, sigma = exact(mode)
    with mpmath.workdps(80):
        y = b * mpmath.mpf(x)
        ch, sh, c, s = mpmath.cosh(y), mpmath.sinh(y), mpmath.cos(y), mpmath.sin(y)
        forms = (ch - c - sigma * (sh - s), sh + s - sigma * (ch - c), ch + c - sigma * (sh + s))
        return float(b**derivative * forms[derivative])


def test_published_roots_and_constants() -> None:
    np.testing.assert_allclose(
        [mode_shapes.root(i) for i in range(1, 5)], [1.8751040687, 4.6940911330, 7.8547574382, 10.9955407], rtol=1e-8
    )
    np.testing.assert_allclose(
        [mode_shapes.sigma(i) for i in (1, 2, 3)], [0.7340955138, 1.0184673193, 0.9992244965], rtol=1e-9
    )


@pytest.mark.parametrize("mode", HIGH)
def test_shapes_do_not_cancel(mode: int) -> None:
    b, sigma = exact(mode)
    assert mode_shapes.root(mode) == pytest.approx(float(b), rel=1e-15)
    assert mode_shapes.sigma(mode) == pytest.approx(float(sigma), rel=1e-15)
    x = np.linspace(0, 1, 23)
    for derivative in (0, 1, 2):
        expected = [shape(mode, float(point), derivative) for point in x]
        scale = max(abs(value) for value in expected)
        np.testing.assert_allclose(mode_shapes.shape(mode, x, derivative), expected, rtol=0, atol=1e-12 * scale)
    assert mode_shapes.tip(mode) == pytest.approx(shape(mode, 1.0, 0), rel=1e-12)
    assert mode_shapes.tip_slope(mode) == pytest.approx(shape(mode, 1.0, 1), rel=1e-12)


def quadrature(i: int, j: int, derivative: int, weight: int = 0) -> float:
    """Integral of w(x) Q_i Q_j, piecewise over the waves, on values in 80 digits turned to floats."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    pieces = max(i, j, 2) * 2
    edges = np.linspace(0, 1, pieces + 1)
    x = np.concatenate([(b - a) / 2 * nodes + (a + b) / 2 for a, b in pairwise(edges)])
    w = np.concatenate([(b - a) / 2 * weights for a, b in pairwise(edges)])
    first = np.array([shape(i, float(p), derivative) for p in x])
    second = first if i == j else np.array([shape(j, float(p), derivative) for p in x])
    factor = (1 - x**2) / 2 if weight else 1.0
    return float(np.sum(w * factor * first * second))


@pytest.mark.parametrize("mode", HIGH)
def test_norm_and_stiffness(mode: int) -> None:
    """[Blevins 1979, Table 8-1]: int Q^2 = L, int Q''^2 = beta^4 / L^3."""
    assert quadrature(mode, mode, 0) == pytest.approx(1.0, rel=1e-10)
    assert quadrature(mode, mode, 2) == pytest.approx(mode_shapes.root(mode) ** 4, rel=1e-10)


@pytest.mark.parametrize(("i", "j"), [(1, 2), (1, 5), (3, 4), (12, 13)])
def test_modes_are_orthogonal(i: int, j: int) -> None:
    assert abs(quadrature(i, j, 0)) < 1e-10
    assert abs(quadrature(i, j, 2)) < 1e-9 * mode_shapes.root(j) ** 4


@pytest.mark.parametrize("mode", HIGH)
def test_moments_by_scipy(mode: int) -> None:
    def form(x: float) -> float:
        return float(mode_shapes.shape(mode, x))

    moment = integrate.quad(lambda x: x * form(x), 0, 1, limit=400, epsabs=1e-13)[0]
    area = integrate.quad(form, 0, 1, limit=400, epsabs=1e-13)[0]
    assert mode_shapes.first_moment(mode) == pytest.approx(moment, rel=1e-8)
    assert mode_shapes.area(mode) == pytest.approx(area, rel=1e-8)


def test_published_integrals() -> None:
    """Computed independently, tolerance 1e-6."""
    assert mode_shapes.first_moment(1) == pytest.approx(0.5688257, rel=1e-6)
    assert mode_shapes.first_moment(2) == pytest.approx(0.0907668, rel=1e-6)  # 2 / beta^2
    assert mode_shapes.area(1) == pytest.approx(0.7829918, rel=1e-6)
    assert mode_shapes.area(2) == pytest.approx(0.4339362, rel=1e-6)
    assert mode_shapes.root(1) ** 4 == pytest.approx(12.3623634, rel=1e-6)
    assert mode_shapes.root(2) ** 4 == pytest.approx(485.5188, rel=1e-6)
    beam, _ = mode_shapes.stiffening(3)
    np.testing.assert_allclose(np.diag(beam), [1.19334, 6.47822, 17.8595], rtol=5e-6)
    assert beam[0, 1] == pytest.approx(-0.68586, rel=1e-5)


def test_stiffening_of_high_modes() -> None:
    beam, end = mode_shapes.stiffening(32)
    for i, j in [(1, 1), (1, 2), (2, 7), (12, 12), (31, 32), (32, 32)]:
        assert beam[i - 1, j - 1] == pytest.approx(quadrature(i, j, 1, weight=1), rel=1e-9, abs=1e-9)
        assert end[i - 1, j - 1] == pytest.approx(quadrature(i, j, 1), rel=1e-9, abs=1e-9)
    assert (np.linalg.eigvalsh(beam) > 0).all()
