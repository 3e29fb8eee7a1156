"""Slopes over a distance against those of lines under a ripple."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.estimation.parameters import FreeParameter, moved, sides
from diagnosis.estimation.slopes import foretell, hold, linearised, secants
from diagnosis.thresholds import FITTING
from engine.errors import SimulationError

Array = NDArray[np.float64]
SLOPES = np.array([[3.0, -40.0], [25.0, 0.5], [-7.0, 60.0]])
RUN: Any = SimpleNamespace(name="run", measured=np.zeros((3, 1)))
OTHER: Any = SimpleNamespace(name="other", measured=np.zeros((3, 1)))


class Line:
    """A residual that is a line, with a ripple on it.

    Args:
        ripple: its amplitude.
        free: the parameters.
        runs: whether it does.
        smooth: whether it has tangents.
    """

    def __init__(
        self, ripple: float = 0.0, free: Sequence[FreeParameter] = (), *, runs: bool = True, smooth: bool = True
    ) -> None:
        self.ripple, self.runs, self.smooth = ripple, runs, smooth
        self.free = list(free) or [FreeParameter(n, 0.0, 1.0, False) for n in "ab"]
        self.cases: list[tuple[Array, Any]] = []
        self.above, self.left = 100.0, 9.0

    def chi2(self, x: Array, experiments: Sequence[Any]) -> float:
        return self.left

    def unexplained(self, x: Array, experiments: Sequence[Any]) -> float:
        return self.above

    def residuals_of(self, cases: Sequence[tuple[Array, Any]], *_: Any) -> list[Array]:
        self.cases += cases
        return [self.residual(x) for x, _ in cases]

    def residuals(self, x: Array, experiments: Sequence[Any], *_: Any) -> list[Array]:
        return [self.residual(x) for _ in experiments]

    def residual(self, x: Array) -> Array:
        if not self.runs:
            return np.full((3, 1), FITTING.huge)
        return np.asarray(SLOPES @ x + self.ripple * np.sin(1e5 * x.sum() + np.arange(3)))[:, None]

    def linearised(self, x: Array, experiment: Any, only: Any = None) -> tuple[Array, Array]:
        if not self.smooth or not self.runs:
            raise SimulationError("it has no tangents")
        steep = self.ripple * 1e5 * np.cos(1e5 * x.sum() + np.arange(3))
        return self.residual(x)[:, 0], SLOPES + steep[:, None]


def of(line: Line) -> Any:
    return line


HERE = np.array([0.3, -0.2])


@pytest.mark.parametrize("ripple", [0.0, 0.1, 1.0])
def test_secants_are_the_slopes_under_a_ripple(ripple: float) -> None:
    """They err by the ripple over the distance at most."""
    [found] = secants(of(Line(ripple)), HERE, [RUN], 0.5)
    np.testing.assert_allclose(found[:, 0], SLOPES, atol=ripple / 0.5 + 1e-9)


def test_secants_stay_within_bounds_and_ask_no_other_recording_of_where_one_starts() -> None:
    free = [FreeParameter("a", 0.0, 1.0, False, low=-0.1), FreeParameter("b", 0.0, 1.0, False, recording="other")]
    line = Line(free=free)
    found = secants(of(line), np.zeros(2), [RUN, OTHER], 0.5)
    np.testing.assert_allclose(found[0][:, 0, 0], SLOPES[:, 0])
    np.testing.assert_allclose(found[0][:, 0, 1], 0.0)
    np.testing.assert_allclose(found[1][:, 0], SLOPES)
    assert min(x[0] for x, _ in line.cases) == pytest.approx(-0.1)
    assert [e.name for x, e in line.cases if x[1]] == ["other", "other"]


def test_tangents_hold_on_a_line_and_not_on_a_ripple_that_is_steeper() -> None:
    for ripple, expected in ((0.0, True), (1e-6, True), (0.1, False)):
        line = Line(ripple)
        tangents = [line.linearised(HERE, RUN)[1].reshape(3, 1, 2)]
        assert hold(of(line), HERE, [RUN], tangents) is expected
    assert hold(of(Line(1.0)), HERE, [RUN], secants(of(Line(1.0)), HERE, [RUN], FITTING.held_over))


def test_where_nothing_is_left_to_explain_tangents_hold() -> None:
    line = Line(0.1)
    line.above = 0.0
    assert hold(of(line), HERE, [RUN], [line.linearised(HERE, RUN)[1].reshape(3, 1, 2)])


class Turns(Line):
    """A wave of a thousand turns in a tolerance, of amplitude 30: over a tenth of a tolerance tangents miss all."""

    def residual(self, x: Array) -> Array:
        return np.asarray(30.0 * np.sin(2e3 * np.pi * (x[0] - HERE[0]) + np.linspace(0.0, 3.0, 3)))[:, None]

    def linearised(self, x: Array, experiment: Any, only: Any = None) -> tuple[Array, Array]:
        steep = 6e4 * np.pi * np.cos(2e3 * np.pi * (x[0] - HERE[0]) + np.linspace(0.0, 3.0, 3))
        return self.residual(x)[:, 0], np.column_stack([steep, np.zeros(3)])


@pytest.mark.parametrize(
    ("above", "left", "expected"), [(0.0, 9.0, True), (5.0, 1.2, True), (5.0, 2.5, False), (2e4, 1.2, False)]
)
def test_tangents_of_what_leaves_noise_hold_as_far_as_what_could_be_explained_reaches(
    above: float, left: float, expected: bool
) -> None:
    """Five units of evidence are a hundredth of a turn. Above a sensor's noise, or for 20 000 units, they do not."""
    line = Turns()
    line.above, line.left = above, left
    assert hold(of(line), HERE, [RUN], [line.linearised(HERE, RUN)[1].reshape(3, 1, 2)]) is expected
    assert foretell(of(line), HERE, [RUN]) is (above == 0)


@pytest.mark.parametrize("smooth", [True, False])
def test_slopes_that_hold_are_tangents_or_secants(smooth: bool) -> None:
    [(r, slopes)] = linearised(of(Line(0.1, smooth=smooth)), HERE, [RUN])
    np.testing.assert_allclose(r, Line(0.1).residual(HERE))
    np.testing.assert_allclose(slopes[:, 0], SLOPES, atol=0.1 / FITTING.held_over)
    [(_, exact)] = linearised(of(Line()), HERE, [RUN])
    np.testing.assert_array_equal(exact[:, 0], SLOPES)


def test_a_model_that_does_not_run_has_no_slopes() -> None:
    with pytest.raises(SimulationError, match="no tangents"):
        linearised(of(Line(runs=False)), HERE, [RUN])


def test_both_sides_are_as_far_and_moves_end_at_bounds() -> None:
    free = [FreeParameter(n, 0.0, 1.0, False, low=-0.5) for n in "abcd"]
    after, before = sides(free, np.zeros(4), 0.2, [0, 2, 3])
    np.testing.assert_allclose(after, -before)
    assert np.linalg.norm(after) == pytest.approx(0.2)
    assert after[1] == 0.0
    assert moved(free, np.zeros(4), [-3.0], [1]).tolist() == [0.0, -0.5, 0.0, 0.0]
