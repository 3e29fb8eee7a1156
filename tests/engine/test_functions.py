"""The exponential function of compiled code and byte code, against numbers of more digits."""

from __future__ import annotations

import ctypes
import math
from decimal import Decimal, localcontext

import numpy as np

from engine.codegen import INCLUDES, runtime
from engine.compile import library
from engine.model import Vector

_LOOP = """
__attribute__((visibility("default"))) void exponentials(const double *x, double *y, long n) {
  for (long i = 0; i < n; i++) y[i] = fa_exp(x[i]);
}
"""


def _exponentials(x: Vector) -> Vector:
    function = library(INCLUDES + runtime("functions.c") + _LOOP).exponentials
    y = np.empty_like(x)
    function(*(ctypes.c_void_p(array.ctypes.data) for array in (x, y)), ctypes.c_long(len(x)))
    return y


def test_the_exponential_function_is_right_to_half_a_unit_of_the_last_digit() -> None:
    random = np.random.default_rng(0)
    parts = [random.uniform(-20, 1, 2000), random.uniform(-650, 709, 2000), random.normal(0, 1e-3, 500)]
    x = np.concatenate([*parts, np.arange(-256, 256) * (math.log(2) / 256)])
    with localcontext() as context:
        context.prec = 40
        for given, found in zip(x.tolist(), _exponentials(x).tolist(), strict=True):
            exact = Decimal(given).exp()
            assert abs(Decimal(found) - exact) < Decimal("0.52") * Decimal(math.ulp(float(exact)))


def test_the_exponential_function_at_its_ends() -> None:
    x = np.array([0.0, -0.0, 709.7, 709.8, 1e300, math.inf, -709.0, -740.0, -746.0, -1e300, -math.inf, math.nan])
    found, expected = _exponentials(x), np.exp(np.where(x > 709.79, math.inf, x))
    assert found[:2].tolist() == [1.0, 1.0]
    assert np.allclose(found, expected, rtol=1e-15, atol=5e-324, equal_nan=True)
