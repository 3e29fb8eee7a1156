"""Poles and zeros as the command prints them."""

from __future__ import annotations

import numpy as np
import pytest

from engine.linearise import LinearModel
from flexarm.console.text import linear_page


def made(A: list[list[float]]) -> LinearModel:
    n = len(A)
    states = tuple(f"x{k}" for k in range(n))
    none = np.zeros((0, 0))
    return LinearModel(
        np.array(A), np.zeros((n, 0)), np.zeros((0, n)), none, states, (), (), units={}, modes={}, point={}, rate=0.0
    )


@pytest.mark.parametrize(("slow", "shown"), [(2.6e-12, "0"), (-2.6e-12, "0"), (-1e-3, "-0.001"), (0.0, "0")])
def test_what_rounding_leaves_of_a_pole_at_rest_is_zero(slow: float, shown: str) -> None:
    """A turning body has a pole at 0; eigenvalues leave the rounding of the fastest one, another on each machine."""
    linear = made([[slow, 0.0, 0.0], [0.0, -3.0, 0.0], [0.0, 0.0, -5000.0]])
    assert f"poles [1/s]:  {shown};  -3;  -5000" in linear_page(linear)
    assert f"poles {shown}, -3, -5000" in repr(linear)


def test_a_slow_pole_of_a_slow_machine_is_no_rounding() -> None:
    assert "poles [1/s]:  -1e-13;  -0.002" in linear_page(made([[-1e-13, 0.0], [0.0, -0.002]]))


@pytest.mark.parametrize("slow", [0.0, -1.2e-15, 3e-13])
def test_zeros_are_rounded_by_the_poles_beside_them(slow: float) -> None:
    """(s - slow) s / (s^2 (s + 5000)): alone, both zeros are as small as rounding and seem to differ."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -5000.0]])
    B, C, D = np.array([[0.0], [0.0], [1.0]]), np.array([[0.0, -slow, 1.0]]), np.zeros((1, 1))
    linear = LinearModel(A, B, C, D, ("a", "b", "c"), ("u",), ("y",), units={}, modes={}, point={}, rate=0.0)
    assert "zeros of y / u [1/s]:  0;  0" in linear_page(linear)
