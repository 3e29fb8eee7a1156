"""The optimiser against closed forms and scipy: ridges, curved valleys, bounds; and parameters that may vanish."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from diagnosis.estimation import least_squares
from diagnosis.estimation.least_squares import _LocalModel, descend
from diagnosis.estimation.parameters import FreeParameter, prior
from diagnosis.thresholds import FITTING
from engine.errors import SimulationError
from engine.threads import Threads
from engine.work import FACTORED, counted

Array = NDArray[np.float64]


class Samples:
    """An experiment as far as the optimiser sees one: values of one signal, all in one band."""

    name = "own"

    def __init__(self, count: int) -> None:
        self.measured = np.zeros((count, 1))

    def components(self, rows: Array) -> Array:
        return rows

    def even(self, rows: Array) -> Array:
        return rows

    def bands(self, fewest: int) -> list[tuple[int, slice]]:
        return [(0, slice(0, len(self.measured)))]


class Toy:
    """A residual with a Jacobian, and the prior of its parameters, as far as the optimiser sees a problem.

    Args:
        residual: of the search vector.
        jacobian: of it.
        free: the parameters.
    """

    def __init__(
        self, residual: Callable[[Array], Array], jacobian: Callable[[Array], Array], free: list[FreeParameter]
    ) -> None:
        self.function, self.slopes, self.free = residual, jacobian, free
        self.jacobians = self.asked = 0

    def unexplained(self, x: Array, experiments: Sequence[Any]) -> float:
        return np.inf

    def chi2(self, x: Array, experiments: Sequence[Any]) -> float:
        return float(np.mean(self.function(x) ** 2))

    def residuals_of(self, cases: Sequence[tuple[Array, Any]], split: Any, _: Any) -> list[Array]:
        self.asked += len(cases)
        return [split(e, self.function(x)[:, None]) for x, e in cases]

    def residuals(self, x: Array, experiments: Sequence[Any], split: Any = lambda _, r: r, _: Any = map) -> list[Array]:
        return [split(e, self.function(x)[:, None]) for e in experiments]

    def linearised(self, x: Array, experiment: Any, only: Any = None) -> tuple[Array, Array]:
        self.jacobians += 1
        return self.function(x), self.slopes(x)

    def prior(self, x: Array) -> tuple[Array, Array]:
        return prior(self.free, x)

    def prior_cost(self, x: Array) -> float:
        return float(np.sum(self.prior(x)[0] ** 2))

    def cost(self, x: Any) -> float:
        """n ln v + E / v with v = max(E / n, 1), plus the prior, written down once more."""
        r = self.function(np.asarray(x, dtype=float))
        v = max(float(np.mean(r**2)), 1.0)
        return len(r) * math.log(v) + float(r @ r) / v + self.prior_cost(np.asarray(x, dtype=float))

    def lowest(self, start: Any, bounds: Any = None) -> Any:
        """The least cost near a start, by scipy, which is given no derivative."""
        rough = minimize(
            self.cost, start, method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-10, "fatol": 1e-12}
        )
        return minimize(self.cost, rough.x, method="Powell", bounds=bounds, options={"xtol": 1e-12, "ftol": 1e-14})

    def descended(self, x: Any, **more: Any) -> tuple[Array, float, bool]:
        toy: Any = self
        begin = np.asarray(x, dtype=float)
        try:
            there: Any = [Samples(len(self.function(begin)))]
        except SimulationError:
            there = [Samples(1)]
        with Threads(1) as pool:
            return descend(toy, begin, there, pool, **more)


def plain(name: str, **more: Any) -> FreeParameter:
    return FreeParameter(name, 0.0, 1.0, False, **more)


@pytest.mark.parametrize("noise", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("start", [(0.0, 0.0), (3.0, -2.0), (-4.0, 1.0)])
def test_on_a_ridge_the_prior_decides_in_few_steps(noise: float, start: tuple[float, float]) -> None:
    """Two torques whose product alone is seen: the smallest change in tolerances shares what is missing by variance."""
    tolerances, spreads, missing = (0.1, 0.2), (1.0, 2.0), math.log(1.5)
    free = [FreeParameter(n, 1.0, s, True, 0.0, spread=w) for n, s, w in zip("ab", tolerances, spreads, strict=True)]
    t = np.linspace(0.0, 1.0, 50)
    row = np.array(tolerances)

    def course(x: Array) -> Array:
        return np.asarray((math.exp(missing) - math.exp(row @ x)) * t / noise)

    toy = Toy(course, lambda x: np.asarray(-math.exp(row @ x) * np.outer(t, row) / noise), free)
    x, cost, converged = toy.descended(start)
    variance = np.array(spreads) ** 2
    expected = variance * row * missing / (row**2 @ variance)
    assert converged
    assert toy.jacobians <= 10
    np.testing.assert_allclose(x, expected, atol=0.05)
    assert cost == pytest.approx(float(np.sum((expected / spreads) ** 2)), abs=0.1)


@pytest.mark.parametrize("seed", range(12))
def test_small_problems_end_where_scipy_ends(seed: int) -> None:
    """Two decaying oscillations under noise, four parameters, from a start within the tolerances."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 3.0, 80)

    def curve(x: Array) -> Array:
        size, rate, frequency, phase = 1 + 0.2 * x[0], math.exp(0.2 * x[1]), 4 * math.exp(0.05 * x[2]), 0.3 * x[3]
        return np.asarray(size * np.exp(-rate * t) * np.sin(frequency * t + phase))

    truth = random.normal(0.0, 1.0, 4)
    measured = curve(truth) + random.normal(0.0, 0.02, len(t))

    def slopes(x: Array) -> Array:
        return np.column_stack([-(curve(x + h) - curve(x - h)) / (2e-6 * 0.02) for h in 1e-6 * np.eye(4)])

    toy = Toy(lambda x: (measured - curve(x)) / 0.02, slopes, [plain(n) for n in "abcd"])
    start = random.normal(0.0, 0.7, 4)
    x, cost, converged = toy.descended(start)
    assert converged
    assert cost == pytest.approx(toy.cost(x))
    assert cost < toy.lowest(start).fun + 0.11  # a full step would gain no more than a tenth


def test_a_curved_valley_is_followed_to_its_end() -> None:
    """Rosenbrock's, a hundred times as steep; its least cost with the prior by scipy from the known bottom."""
    free = [plain("a", spread=1e3), plain("b", spread=1e3)]
    steep = 1e3

    def valley(x: Array) -> Array:
        return np.array([steep * (x[1] - x[0] ** 2), 30 * (1 - x[0])])

    toy = Toy(valley, lambda x: np.array([[-2 * steep * x[0], steep], [-30.0, 0.0]]), free)
    x, cost, converged = toy.descended([-1.2, 1.0], iterations=60)
    assert converged
    assert cost < toy.lowest([1.0, 1.0]).fun + 0.11
    np.testing.assert_allclose(x, [1.0, 1.0], atol=0.05)


def test_at_a_bound_it_stops_and_the_rest_goes_on() -> None:
    """The best a is -2, and -0.5 is allowed; beside it b is best at -1 rather than at 2."""
    free = [plain("a", low=-0.5, high=3.0, spread=1e3), plain("b", spread=1e3)]
    table = np.array([[10.0, 0.0], [20.0, 10.0], [0.0, 1e-3]])
    y = table @ np.array([-2.0, 2.0])
    toy = Toy(lambda x: y - table @ x, lambda x: -table, free)
    x, cost, converged = toy.descended([1.0, 0.0])
    best = toy.lowest([1.0, 0.0], bounds=[(-0.5, 3.0), (-10.0, 10.0)])
    assert converged
    assert x[0] == -0.5
    assert x[1] == pytest.approx(best.x[1], abs=0.05)
    assert cost == pytest.approx(best.fun, abs=0.11)


@pytest.mark.parametrize("scale", [1e-40, 1e-14, 1.0, 1e14, 1e40])
@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
def test_a_step_reaches_the_radius_where_the_whole_one_is_longer(scale: float, radius: float) -> None:
    """Whatever the size of the slopes: recordings may tell a parameter to any digit, or hardly at all."""
    table = np.array([[3.0, 1.0], [1.0, 2e-6], [0.0, 1.0]])
    y = np.array([1.0, -2.0, 0.5])
    whole = np.linalg.lstsq(table, y, rcond=None)[0]
    far = 1e3 * radius / float(np.linalg.norm(whole))
    local = _LocalModel(-y * scale * far, table * scale, [])
    step = local.step(radius)
    assert np.linalg.norm(step) == pytest.approx(radius, rel=1e-6)
    assert local.gain(step) > 0
    np.testing.assert_allclose(local.step(2e3 * radius), whole * far, rtol=1e-6)


def test_what_may_not_move_stays_and_too_few_steps_are_not_called_converged() -> None:
    # What may not move leaves nothing over, so that the noise is as stated and a promise is what a step would gain.
    aim = np.array([3.0, math.exp(0.5)])
    toy = Toy(lambda x: 10 * (np.exp(x) - aim), lambda x: 10 * np.diag(np.exp(x)), [plain("a"), plain("b")])
    x, _, converged = toy.descended([0.0, 0.5], only=[0])
    assert converged
    assert x[1] == 0.5
    assert toy.cost(x) < minimize_scalar(lambda a: toy.cost([a, 0.5]), bounds=(0, 2)).fun + 0.11
    assert not toy.descended([-4.0, -4.0], iterations=1)[2]


def test_where_another_recording_starts_stays_as_it_is() -> None:
    """Nothing that is fitted tells of it, and the prior alone would draw it to its centre."""
    own, others = plain("angle", recording="own"), plain("angle", recording="held out")
    toy = Toy(lambda x: np.full(50, 10 * (x[0] - 3.0)), lambda x: np.tile([10.0, 0.0], (50, 1)), [own, others])
    x, _, converged = toy.descended([0.0, 0.4])
    assert converged
    assert x[0] == pytest.approx(3.0, abs=0.05)
    assert x[1] == 0.4


def refuse(x: Array) -> Array:
    raise SimulationError("it diverged")


def test_where_the_model_runs_away_nothing_is_claimed() -> None:
    toy = Toy(lambda x: np.full(3, FITTING.huge), refuse, [plain("a")])
    x, cost, converged = toy.descended([1.5])
    assert (x.tolist(), cost, converged) == ([1.5], math.inf, False)


def test_where_the_model_runs_and_has_no_tangents_secants_lead_on() -> None:
    toy = Toy(lambda x: 10 * (x - 1.0), refuse, [plain("a")])
    x, cost, _ = toy.descended([0.2])
    assert x[0] == pytest.approx(1.0, abs=0.1)
    assert cost == pytest.approx(toy.lowest([0.9]).fun, abs=0.1)


def rough(count: int = 2, ripple: float = 1.0) -> tuple[Toy, Array]:
    """A linear model on which a ripple of a thousandth of a tolerance lies, and what it is to find."""
    random = np.random.default_rng(2)
    table, aim = 20 * random.normal(size=(200, count)), random.normal(size=count)
    waves, phases = random.normal(0.0, 1e4, (200, count)), random.uniform(0.0, 6.0, 200)

    def residual(x: Array) -> Array:
        return np.asarray(table @ (x - aim) + ripple * np.sin(waves @ x + phases))

    def jacobian(x: Array) -> Array:
        return np.asarray(table + ripple * np.cos(waves @ x + phases)[:, None] * waves)

    return Toy(residual, jacobian, [plain(str(k)) for k in range(count)]), aim


@pytest.mark.parametrize("count", [1, 2, 5])
def test_where_tangents_tell_of_a_hair_alone_secants_lead_on(count: int) -> None:
    """As where contacts bounce: tangents are right, and 500 times as steep as what lies under the ripple."""
    toy, aim = rough(count)
    x, _, _ = toy.descended(np.zeros(count))
    np.testing.assert_allclose(x, aim, atol=0.03)
    assert np.mean(toy.function(x) ** 2) < 1.5  # of 0.5 that the ripple leaves on average


def test_a_smooth_model_takes_no_secants() -> None:
    toy, aim = rough(2, ripple=0.0)
    x, _, converged = toy.descended(np.zeros(2))
    assert converged
    assert toy.asked == 0
    np.testing.assert_allclose(x, aim, atol=0.01)


LOSS = FreeParameter("loss", 2.0, 0.1, True, 0.0, may_vanish=True)


def test_a_loss_that_may_vanish_reaches_nothing_and_one_that_may_not_does_not() -> None:
    assert LOSS.value(-10.0) == 0.0
    low, high = LOSS.ends
    assert low == pytest.approx(-10.0)
    assert high == math.inf
    assert LOSS.value(-5.0) == pytest.approx(1.0)
    assert LOSS.value(5.0) == pytest.approx(2.0 * math.exp(0.5))
    mass = FreeParameter("mass", 2.0, 0.1, True, 0.0)
    assert mass.value(-100.0) > 0


@pytest.mark.parametrize("x", [-9.5, -3.0, -1e-6, 0.0, 1e-6, 2.0, 20.0])
def test_its_slope_is_that_of_its_value_and_its_position_the_inverse(x: float) -> None:
    h = 1e-7
    slope = (LOSS.value(x + h) - LOSS.value(x - h)) / (2 * h)
    assert LOSS.slope(x) == pytest.approx(slope, rel=1e-4)
    assert LOSS.position(LOSS.value(x)) == pytest.approx(x, abs=1e-9)


def test_a_fit_takes_a_loss_that_is_not_there_to_nothing() -> None:
    """Without noise and with a wide prior it stands at its bound, not near it."""
    free = [FreeParameter("loss", 2.0, 0.1, True, 0.0, may_vanish=True, spread=1e3)]
    toy = Toy(
        lambda x: np.full(5, 100 * (-0.3 - free[0].value(x[0]))),
        lambda x: np.full((5, 1), -100 * free[0].slope(x[0])),
        free,
    )
    x, _, converged = toy.descended([3.0])
    assert converged
    assert free[0].value(x[0]) == 0.0


def test_a_creeping_step_is_made_longer() -> None:
    """Samples ask for 40, the prior for 0, and from 22 on the samples win: near there squares creep.

    With n / (40 - a)^2 the weight of the samples and p that of the prior, a plain step multiplies the distance from
    that point, where the two pull alike, by 2 w / (w + p) = 1.1: it would take more than thirty.
    """
    n, spread = 100_000, 0.0629
    ripple = np.where(np.arange(n) % 2, 1.0, -1.0)
    toy = Toy(lambda x: x[0] - 40.0 + ripple, lambda x: np.ones((n, 1)), [plain("a", spread=spread)])
    _, cost, converged = toy.descended([22.6], iterations=60)
    assert converged
    assert cost < minimize_scalar(lambda a: toy.cost([a]), bounds=(30.0, 45.0), method="bounded").fun + 0.25
    assert toy.jacobians < 16


def test_a_cost_that_the_steps_left_would_not_reach_is_given_up() -> None:
    """Rosenbrock's valley gains little by little: whoever must come far below its bottom need not follow it."""
    free = [plain("a", spread=1e3), plain("b", spread=1e3)]

    def valley(x: Array) -> Array:
        return np.array([1e3 * (x[1] - x[0] ** 2), 30 * (1 - x[0])])

    def begun() -> Toy:
        return Toy(valley, lambda x: np.array([[-2e3 * x[0], 1e3], [-30.0, 0.0]]), free)

    whole, left, able = begun(), begun(), begun()
    end = whole.descended([-1.2, 1.0], iterations=60, noise="stated")
    assert not left.descended([-1.2, 1.0], iterations=60, noise="stated", reach=-1e9)[2]
    assert left.jacobians < whole.jacobians
    same = able.descended([-1.2, 1.0], iterations=60, noise="stated", reach=end[1] + 1.0)
    np.testing.assert_array_equal(same[0], end[0])


@pytest.mark.parametrize(("reach", "steps"), [(-3.1e4, 1), (-2.9e4, 2)])
def test_a_cost_that_many_times_what_is_promised_would_not_reach_is_given_up_at_once(reach: float, steps: int) -> None:
    """A line promises to gain 1000: thirty times as much is 30 thousand."""
    rest = np.full(20, 1e3**0.5)

    def line(x: Array) -> Array:
        return np.array([*rest[:-1], rest[-1] * (1 - x[0])])

    toy = Toy(line, lambda x: np.array([*[0.0] * 19, -rest[-1]])[:, None], [plain("a", spread=1e3)])
    toy.descended([0.0], iterations=60, noise="stated", reach=float(line(np.zeros(1)) @ line(np.zeros(1))) + reach)
    assert toy.jacobians == steps


def test_factoring_a_jacobian_counts_by_its_numbers_and_columns() -> None:
    with counted() as work:
        _LocalModel(np.ones(500), np.random.default_rng(0).normal(size=(500, 3)), [])
    assert work.done == round(FACTORED * 500 * 4 * 3)


@pytest.mark.parametrize(("after", "begun"), [(3.0, 1.0), (30.0, 0.0)])
def test_whole_recordings_are_fitted_from_where_they_are_followed_best(
    monkeypatch: pytest.MonkeyPatch, after: float, begun: float
) -> None:
    """What follows the beginnings of a servo's recordings made its loop unstable: the rest ran away.

    Args:
        after: cost of the whole recordings after the fit to their beginnings; before it they cost 10.
        begun: where the fit to the whole is to begin: 0 is the start, 1 the end of the fit to the beginnings.
    """
    whole = SimpleNamespace(cut=lambda share: "beginning")
    starts: list[float] = []

    def descended(problem: Any, x: Array, experiments: Sequence[Any], *_: Any, **__: Any) -> tuple[Array, float, bool]:
        if list(experiments) == ["beginning"]:
            return np.ones(1), 0.1, True
        starts.append(float(x[0]))
        return x, 1.0, True

    problem: Any = SimpleNamespace(
        training=(whole,),
        held_out=(),
        free=(plain("a"),),
        cost=lambda x, experiments, noise: after if x[0] else 10.0,
        chi2=lambda x, experiments: 1.0,
    )
    monkeypatch.setattr(least_squares, "descend", descended)
    monkeypatch.setattr(least_squares, "with_covariance", lambda made, left: made)
    least_squares.fit(problem, workers=1)
    assert starts == [begun]
