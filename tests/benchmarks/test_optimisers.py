"""The benchmark of optimisers: on problems with known solutions, and in what its page counts."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import optimisers, whitening
from diagnosis.estimation.parameters import Array


class Values:
    """An experiment as far as an optimiser sees one: values of one signal."""

    name = "values"

    def __init__(self, count: int) -> None:
        self.measured = np.zeros((count, 1))

    def components(self, rows: Array) -> Array:
        return rows

    def even(self, rows: Array) -> Array:
        return rows


class Rosenbrock:
    """r = (10 (b - a^2), 1 - a): the cost is 0 at (1, 1) alone. The prior says next to nothing."""

    free = (SimpleNamespace(ends=(-np.inf, np.inf), recording=""),) * 2
    training = (Values(2),)

    def residual(self, x: Array, _: Any) -> Array:
        return np.array([[10 * (x[1] - x[0] ** 2)], [1 - x[0]]])

    def residuals(self, x: Array, experiments: Sequence[Any], split: Any, _: Any) -> list[Array]:
        return [split(e, self.residual(x, e)) for e in experiments]

    def linearised(self, x: Array, e: Any, only: Any = None) -> tuple[Array, Array]:
        return self.residual(x, e).ravel(), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])

    def prior_cost(self, x: Array) -> float:
        return float(np.sum(self.prior(x)[0] ** 2))

    def prior(self, x: Array) -> tuple[Array, Array]:
        return 1e-9 * x, 1e-9 * np.eye(2)


class Ridge(Rosenbrock):
    """Data that know a - b to a millionth and nothing of a + b, a prior at (1, 3): the best is (2, 2), a cost of 2."""

    training = (Values(1),)

    def residual(self, x: Array, _: Any) -> Array:
        return np.array([[1e6 * (x[0] - x[1])]])

    def linearised(self, x: Array, e: Any, only: Any = None) -> tuple[Array, Array]:
        return self.residual(x, e).ravel(), np.array([[1e6, -1e6]])

    def prior(self, x: Array) -> tuple[Array, Array]:
        return x - np.array([1.0, 3.0]), np.eye(2)


@pytest.mark.parametrize("name", optimisers.OPTIMISERS)
def test_every_optimiser_finds_the_bottom_of_a_curved_valley(name: str) -> None:
    problem: Any = Rosenbrock()
    x, converged = optimisers.OPTIMISERS[name](problem, np.array([-1.2, 1.0]))
    assert converged
    cost = float(np.sum(problem.residual(x, None) ** 2))
    assert cost < optimisers.LEAST


@pytest.mark.parametrize("name", list(optimisers.OPTIMISERS)[:2])
def test_on_a_ridge_the_prior_decides(name: str) -> None:
    problem: Any = Ridge()
    x, converged = optimisers.OPTIMISERS[name](problem, np.array([-20.0, -20.0]))
    assert converged
    assert x == pytest.approx([2.0, 2.0], abs=0.3)


def row(optimiser: str, start: str, cost: float, converged: bool) -> dict[str, Any]:
    about = {"seed": 3, "model": "nominal", "n": 4, "residual": 6.0, "jacobian": 5.0, "seconds": 1.0}
    return {"optimiser": optimiser, "start": start, "cost": cost, "converged": converged, **about}


def test_the_bottom_is_the_lowest_of_all_starts() -> None:
    rows = [row("one", "nominal", 1000.0, True), row("one", "bent", 1001.5, True), row("two", "bent", 1000.9, False)]
    assert [r["bottom"] for r in optimisers.lowest(rows)] == [True, False, True]


def test_the_page_tells_who_is_wrongly_content() -> None:
    own, *others = optimisers.OPTIMISERS
    rows = [row(own, "bent", 90.0, True), *(row(name, "bent", 50.0, True) for name in others)]
    text = optimisers.page(rows, {"machine": "a machine"})
    assert "1 fits of 1 random" in text.replace("\n", " ")
    assert f"| {own} | 0 of 1, 0 % (0 to 79 %) | - | - | 0 % | 100 % | 100 % | 6 | 5 | 1.00 |" in text
    assert f"| {others[0]} | 1 of 1, 100 % (21 to 100 %) | - | - | 100 % | 100 % | 0 % | 6 | 5 | 1.00 |" in text
    assert "| `rig-3` | nominal | bent | 90 | 50 | yes |" in text


def test_bands_keep_to_what_the_known_spectrum_says_and_white_noise_does_not() -> None:
    """Two residuals with the same slow spectrum: neither is better, whatever was drawn."""
    random = np.random.default_rng(1)
    found = []
    for _ in range(20):
        noise = random.normal(size=4000)
        one, other = (whitening.left(random, noise, 10.0) for _ in range(2))
        bands = whitening.in_bands(other, 1000) - whitening.in_bands(one, 1000)
        white = -0.5 * 4000 * (float(other @ other) / float(one @ one) - 1)
        found.append((bands, white))
    bands, white = np.std(found, axis=0)
    assert bands < 30 < 300 < white
