"""The evidence of a model against closed forms: Parseval, white noise, and exact marginal likelihoods."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import chi2, multivariate_normal, norm

from diagnosis.estimation.leftover import Bands, Leftover, Noise, left_by
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.search.evidence import ChosenSize, evidence
from diagnosis.thresholds import EVIDENCE, SEARCH
from engine.errors import SimulationError

Array = NDArray[np.float64]
STEP = 2e-3


def recorded(measured: Array, name: str = "run", role: str = "train", time: Any = None) -> TimeExperiment:
    """A recording in units of its noise, shape (samples, signals)."""
    samples, signals = measured.shape
    t = np.asarray(STEP * np.arange(samples) if time is None else time, dtype=float)
    return TimeExperiment(
        name=name,
        role=role,
        time=t,
        measured=measured,
        sigma=np.ones(signals),
        step=STEP,
        every=1,
        drive=None,
        from_first=(False,) * signals,
    )


class Linear:
    """y = H x + noise of variance 1, with normal priors of x about nothing.

    Args:
        experiments: what was recorded, one signal each.
        tables: H of each, shape (samples, n).
        spreads: standard deviations of the priors, shape (n,).
    """

    def __init__(self, experiments: list[TimeExperiment], tables: list[Array], spreads: Array) -> None:
        self.experiments, self.spreads = experiments, spreads
        self.tables = {e.name: table for e, table in zip(experiments, tables, strict=True)}
        self.model = SimpleNamespace(outputs=[None] * experiments[0].measured.shape[1])
        self.free = [FreeParameter(str(k), 0.0, 1.0, False) for k in range(len(spreads))]

    @property
    def training(self) -> list[TimeExperiment]:
        return [e for e in self.experiments if e.role == "train"]

    def residual(self, x: Array, e: TimeExperiment) -> Array:
        return np.asarray(e.measured - (self.tables[e.name] @ x)[:, None])

    def residuals(self, x: Array, experiments: list[TimeExperiment], *_: Any) -> list[Array]:
        return [self.residual(x, e) for e in experiments]

    def linearised(self, x: Array, e: TimeExperiment, only: Any = None) -> tuple[Array, Array]:
        return self.residual(x, e).ravel(), -self.tables[e.name]

    def leftover(self, x: Array, experiments: list[TimeExperiment]) -> Leftover:
        return left_by(experiments, [self.residual(x, e) for e in experiments])

    def prior(self, x: Array) -> tuple[Array, Array]:
        return x / self.spreads, np.diag(1 / self.spreads)

    def best(self) -> Array:
        """The most probable x, by numpy."""
        rows = [self.tables[e.name] for e in self.training]
        y = np.concatenate([e.measured[:, 0] for e in self.training] + [np.zeros(len(self.spreads))])
        return np.asarray(np.linalg.lstsq(np.vstack([*rows, np.diag(1 / self.spreads)]), y, rcond=None)[0])


class Hanging(Linear):
    """y = a sin(q + b) + noise of variance 1, with normal priors of a and b about nothing; each table is a row of q."""

    def residual(self, x: Array, e: TimeExperiment) -> Array:
        return np.asarray(e.measured - (x[0] * np.sin(self.tables[e.name] + x[1]))[:, None])

    def residuals(self, x: Array, experiments: list[TimeExperiment], *ways: Any) -> list[Array]:
        split = ways[0] if ways else lambda _, r: r
        return [split(e, self.residual(x, e)) for e in experiments]

    def residuals_of(self, cases: list[tuple[Array, TimeExperiment]], *ways: Any) -> list[Array]:
        return [self.residuals(x, [e], *ways)[0] for x, e in cases]

    def linearised(self, x: Array, e: TimeExperiment, only: Any = None) -> tuple[Array, Array]:
        q = self.tables[e.name] + x[1]
        return self.residual(x, e).ravel(), -np.column_stack([np.sin(q), x[0] * np.cos(q)])

    def prior_cost(self, x: Array) -> float:
        return float(np.sum((x / self.spreads) ** 2))


def found(problem: Any, x: Array) -> tuple[float, Leftover]:
    left = problem.leftover(x, problem.experiments)
    return evidence(problem, x).log, left


@pytest.mark.parametrize("samples", [8, 101, 1000])
def test_cosines_hold_the_energy_of_the_samples_and_every_cosine_is_in_one_band(samples: int) -> None:
    rows = np.random.default_rng(samples).normal(size=(samples, 3))
    e = recorded(rows)
    assert np.sum(e.components(rows) ** 2, axis=0) == pytest.approx(np.sum(rows**2, axis=0))
    covered = np.concatenate([np.arange(samples)[part] for _, part in e.bands(EVIDENCE.fewest)])
    np.testing.assert_array_equal(covered, np.arange(samples))
    numbers = [number for number, _ in e.bands(EVIDENCE.fewest)]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("noise", ["white", "stated"])
def test_where_noise_is_white_samples_stand_for_their_cosines(uneven: bool, noise: Any) -> None:
    """Energies, and products of residuals with slopes, are those of the cosines, as the fit with coloured noise has."""
    random = np.random.default_rng(1)
    time = np.sort(random.uniform(0.0, 1.0, 300))
    e = recorded(random.normal(size=(300, 2)), time=time - time[0])
    e = replace(e, uneven=uneven)
    bands = Bands([e], noise=noise)
    rows, slopes = random.normal(size=(300, 2)), random.normal(size=(300, 2, 4))
    short, long = bands.components(e, rows), e.components(rows)
    np.testing.assert_allclose(bands.energies([short]), bands.energies([long]))
    several = bands.components(e, slopes), e.components(slopes)
    for k in range(2):
        one, other = several[0][:, k].T @ short[:, k], several[1][:, k].T @ long[:, k]
        np.testing.assert_allclose(one, other, atol=1e-9)
        columns = np.column_stack([e.components(slopes[:, :, j])[:, k] for j in range(4)])
        np.testing.assert_allclose(several[1][:, k], columns, atol=1e-12)


def test_a_sine_is_in_the_band_of_its_frequency() -> None:
    """Bands are thirds of an octave from 1 Hz, whatever the length of the recording."""
    for seconds in (1.0, 4.0):
        t = np.arange(0.0, seconds, STEP)
        e = recorded(np.sin(2 * np.pi * 40.0 * t)[:, None], time=t)
        power = {number: float(np.sum(e.components(e.measured)[part] ** 2)) for number, part in e.bands(4)}
        assert max(power, key=lambda number: power[number]) == int(np.floor(3 * np.log2(40.0)))


@pytest.mark.parametrize("variance", [1.5, 4.0, 100.0])
def test_the_likelihood_of_white_noise_is_that_of_its_samples(variance: float) -> None:
    """Strengths are fitted, which gains half a unit a band on average; against the density of the samples by scipy."""
    random = np.random.default_rng(3)
    gains = []
    for _ in range(20):
        rows = random.normal(0.0, np.sqrt(variance), size=(1000, 1))
        problem: Any = Linear([recorded(rows)], [np.zeros((1000, 1))], np.ones(1))
        left = problem.leftover(np.zeros(1), problem.experiments)
        exact = float(np.sum(norm.logpdf(rows, scale=np.sqrt(variance)))) + 500 * np.log(2 * np.pi)
        gains.append(left.log_likelihood - exact)
    bands = len(left.count)
    assert left.count.sum() == 1000
    assert 0.3 * bands < np.mean(gains) < 0.8 * bands


def test_below_the_stated_noise_the_likelihood_is_that_of_the_stated_noise() -> None:
    """It is not credited without bound where the residual is small: half the energy, and no logarithm of it."""
    rows = 0.3 * np.random.default_rng(5).normal(size=(1000, 1))
    problem: Any = Linear([recorded(rows)], [np.zeros((1000, 1))], np.ones(1))
    left = problem.leftover(np.zeros(1), problem.experiments)
    assert left.strength.tolist() == [1.0] * len(left.count)
    exact = float(np.sum(norm.logpdf(rows))) + 500 * np.log(2 * np.pi)
    assert left.log_likelihood == pytest.approx(exact)
    assert left.unexplained == 0.0


def test_a_size_that_is_only_chosen_costs_what_a_parameter_does() -> None:
    """Of two linear models one has its last parameter chosen beforehand, at the value at which the other is fitted."""
    random = np.random.default_rng(7)
    tables = [random.normal(size=(400, 3)) for _ in range(2)]
    spreads = np.array([2.0, 0.5, 3.0])
    e = [
        recorded((table @ [1.0, -0.3, 2.0])[:, None] + random.normal(size=(400, 1)), f"run{k}")
        for k, table in enumerate(tables)
    ]
    whole: Any = Linear(e, tables, spreads)
    best = whole.best()
    fitted, _ = found(whole, best)
    rest = [
        recorded(one.measured - (table[:, 2:] @ best[2:])[:, None], one.name)
        for one, table in zip(e, tables, strict=True)
    ]
    part: Any = Linear(rest, [table[:, :2] for table in tables], spreads[:2])
    size = ChosenSize(tuple(-table[:, 2:] for table in tables), float(best[2]), float(spreads[2]))
    assert evidence(part, best[:2], [size]).log == pytest.approx(fitted)
    assert evidence(part, best[:2]).log > fitted + 3.0


def test_what_no_model_explains_decides_nothing() -> None:
    """Two models differ at high frequencies alone; a mismatch at low ones takes nothing from their difference."""
    random = np.random.default_rng(7)
    t = STEP * np.arange(1000)
    fast = 3 * np.sin(2 * np.pi * 80 * t)[:, None] + random.normal(size=(1000, 1))
    apart = []
    for mismatch in (0.0, 1e3):
        slow = mismatch * np.cos(np.pi * 3 * (np.arange(1000) + 0.5) / 1000)[:, None]
        pair = []
        for share in (0.0, 1.0):
            rows = fast + slow - share * 3 * np.sin(2 * np.pi * 80 * t)[:, None]
            problem: Any = Linear([recorded(rows)], [np.zeros((1000, 1))], np.ones(1))
            pair.append(problem.leftover(np.zeros(1), problem.experiments).log_likelihood)
        apart.append(pair[1] - pair[0])
    assert apart[0] > 30
    assert apart[1] == pytest.approx(apart[0], abs=0.5)


@pytest.mark.parametrize("count", [1, 3, 5, 20, 200])
def test_noise_alone_is_unexplained_as_seldom_as_three_standard_deviations(count: int) -> None:
    """The least energy that counts, found by bisection, has the tail of a normal deviate under chi-square."""

    def shown(energy: float) -> bool:
        there, values = np.array([energy]), np.array([float(count)])
        return Leftover(there, values, np.ones(1), ((0, 0),), there[None, :], values[None, :]).unexplained > 0

    low, high = float(count), 100.0 * count
    assert shown(high)
    assert not shown(low)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if shown(middle) else (middle, high)
    assert chi2.sf(high, count) == pytest.approx(norm.sf(EVIDENCE.chance), rel=0.25)


@pytest.mark.parametrize("seed", range(4))
def test_coloured_noise_does_not_vary_and_a_mismatch_of_one_recording_does(seed: int) -> None:
    """Noise of a first-order filter, five times as strong at low frequency, in four recordings; a sine in one more."""
    random = np.random.default_rng(seed)
    rows = lfilter([1.0], [1.0, -0.6], random.normal(size=(5, 2000, 1)), axis=1)
    ring = np.sin(2 * np.pi * 7 * STEP * np.arange(2000))[:, None]

    def left(amplitude: float) -> Leftover:
        told = [recorded(r + amplitude * (k == 4) * ring, f"run{k}") for k, r in enumerate(rows)]
        return left_by(told, [e.measured for e in told])

    assert left(0.0).unexplained > 500
    assert left(0.0).varying < 5
    assert left(3.0).varying > 20


@pytest.mark.parametrize("seed", range(4))
def test_what_a_hairs_breadth_moves_at_random_is_no_more_than_the_right_model_leaves(seed: int) -> None:
    """Runs that part at random differ by twice the variance of each, and so does a run from a recording."""
    random = np.random.default_rng(seed)
    course = np.cumsum(random.normal(size=(3000, 1)), axis=0)
    drawn = [3.0 * random.normal(size=(3000, 1)) for _ in range(4)]
    e = recorded(course + drawn[3] + random.normal(size=(3000, 1)))
    right, after, before = (e.measured - course - one for one in drawn[:3])
    left = left_by([e], [right], [[after], [before]])
    alone = [left_by([e], [rows]) for rows in (right, after, before)]
    assert alone[0].luck == 0.0
    assert float(np.sum((left.noise - alone[0].noise) * left.count)) / 3000 == pytest.approx(2 * 9.0, rel=0.1)
    assert float(np.sum(left.energy)) > 10 * 3000
    assert abs(float(np.sum(left.energy - left.noise * left.count))) < 0.1 * float(np.sum(left.energy))
    most = max(abs(one.log_likelihood - alone[0].log_likelihood) for one in alone[1:])
    assert left.luck == pytest.approx(most, abs=10.0)  # a band of few values may seem to answer in proportion


def test_what_answers_in_proportion_to_a_hairs_breadth_is_steady() -> None:
    random = np.random.default_rng(0)
    e, course = recorded(random.normal(size=(3000, 1))), np.cumsum(random.normal(size=(3000, 1)), axis=0)
    left = left_by([e], [e.measured], [[e.measured + 0.2 * course], [e.measured - 0.2 * course * (1 + 1e-3 * course)]])
    assert left.luck == 0.0
    assert left.noise.tolist() == left_by([e], [e.measured]).noise.tolist()


@pytest.mark.parametrize("seed", range(4))
def test_at_the_floor_the_evidence_is_the_marginal_likelihood(seed: int) -> None:
    """y = H x + e, all normal: ln p(y) by scipy, with two recordings, the prior integrated out in closed form."""
    random = np.random.default_rng(seed)
    spreads = np.array([1.0, 0.3, 5.0])
    tables = [random.normal(size=(120, 3)) for _ in range(2)]
    truth = spreads * random.normal(size=3)
    # Noise a little weaker than stated, so that no band exceeds it.
    runs = [
        recorded((table @ truth + 0.3 * random.normal(size=120))[:, None], f"run{k}") for k, table in enumerate(tables)
    ]
    problem: Any = Linear(runs, tables, spreads)
    ours, left = found(problem, problem.best())
    assert left.strength.max() == 1.0
    H, y = np.vstack(tables), np.concatenate([e.measured[:, 0] for e in runs])
    covariance = np.eye(len(y)) + H @ np.diag(spreads**2) @ H.T
    exact = float(multivariate_normal.logpdf(y, np.zeros(len(y)), covariance)) + len(y) / 2 * np.log(2 * np.pi)
    assert ours == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_held_out_recordings_are_foretold_with_parameters_that_are_uncertain(seed: int) -> None:
    """The marginal likelihood of all recordings by scipy, with x fitted to the first alone, which hardly shows it."""
    random = np.random.default_rng(seed)
    spreads = np.array([1.0, 0.3, 5.0])
    tables = [random.normal(size=(12, 3)), random.normal(size=(300, 3))]
    truth = spreads * random.normal(size=3)
    runs = [
        recorded((table @ truth + 0.3 * random.normal(size=len(table)))[:, None], role, role)
        for table, role in zip(tables, ("train", "hold_out"), strict=True)
    ]
    problem: Any = Linear(runs, tables, spreads)
    ours, left = evidence(problem, problem.best()), problem.leftover(problem.best(), runs)

    def exact(count: int) -> float:
        H, y = np.vstack(tables[:count]), np.concatenate([e.measured[:, 0] for e in runs[:count]])
        covariance = np.eye(len(y)) + H @ np.diag(spreads**2) @ H.T
        likely = float(multivariate_normal.logpdf(y, np.zeros(len(y)), covariance))
        return likely + len(y) / 2 * float(np.log(2 * np.pi))

    assert left.strength.max() < 1.5
    assert ours.log == pytest.approx(exact(2), abs=0.3)
    assert ours.foretold == pytest.approx(exact(2) - exact(1), abs=0.3)


def test_what_only_held_out_recordings_tell_is_several_steps_away() -> None:
    """A pendulum that hangs still when it is fitted, and swings when it is not: only its weight's moment is told first.

    Against the integral of the likelihood over amplitude and angle, on a grid. One Gauss-Newton step leads nowhere.
    """
    random = np.random.default_rng(1)
    spreads, angles = np.array([30.0, 1.0]), [np.zeros(200), np.linspace(-1.5, 1.5, 200)]
    truth = np.array([12.0, 0.45])
    runs = [
        recorded((truth[0] * np.sin(q + truth[1]) + 0.3 * random.normal(size=200))[:, None], role, role)
        for q, role in zip(angles, ("train", "hold_out"), strict=True)
    ]
    problem: Any = Hanging(runs, angles, spreads)
    held = truth[0] * np.sin(truth[1])
    begun = np.array([held / np.sin(1.3), 1.3])  # the same torque where it was fitted
    near, ours = evidence(problem, begun), evidence(problem, begun, followed=True)
    a, b = np.meshgrid(np.linspace(11.0, 13.0, 801), np.linspace(0.4, 0.5, 801))
    log = -0.5 * (a / spreads[0]) ** 2 - 0.5 * (b / spreads[1]) ** 2 - np.log(2 * np.pi * spreads[0] * spreads[1])
    for e, q in zip(runs, angles, strict=True):
        y = e.measured[:, 0]
        # The sum of squares, term by term, so that the grid need not hold every sample.
        one, other = np.sin(q), np.cos(q)
        s, c = a * np.cos(b), a * np.sin(b)
        squares = y @ y - 2 * (s * (one @ y) + c * (other @ y))
        squares += s**2 * (one @ one) + 2 * s * c * (one @ other) + c**2 * (other @ other)
        log -= 0.5 * squares
    cell = (a[0, 1] - a[0, 0]) * (b[1, 0] - b[0, 0])
    exact = float(log.max() + np.log(np.exp(log - log.max()).sum() * cell))
    edges = np.concatenate([log[0], log[-1], log[:, 0], log[:, -1]])
    assert edges.max() < log.max() - 12  # all of it lies within the grid
    assert ours.log == pytest.approx(exact, abs=0.3)
    np.testing.assert_allclose(ours.x, truth, atol=0.05)
    assert near.log < exact - 30
    assert near.owed > SEARCH.slow


def test_what_the_fitted_recordings_leave_open_refutes_no_model() -> None:
    """A second parameter that only the held-out recording tells: followed worse with it, and foretold better."""
    random = np.random.default_rng(4)
    train, judged = random.normal(size=(200, 2)), random.normal(size=(200, 2))
    train[:, 1] *= 0.002
    truth = np.array([1.0, 6.0])
    rows = [(table @ truth)[:, None] + 0.3 * random.normal(size=(200, 1)) for table in (train, judged)]
    rows[0] -= 20 * train[:, 1:]  # an eighth of the noise
    runs = [recorded(rows[0]), recorded(rows[1], "other", "hold_out")]
    rich: Any = Linear(runs, [train, judged], np.array([10.0, 100.0]))
    plain: Any = Linear(runs, [train[:, :1], judged[:, :1]], np.array([10.0]))
    best = rich.best()
    with_it, without = evidence(rich, best), evidence(plain, plain.best())
    energies = [float(np.sum(m.residual(x, runs[1]) ** 2)) for m, x in ((rich, best), (plain, plain.best()))]
    assert energies[0] > energies[1]
    assert with_it.foretold > without.foretold + 50
    np.testing.assert_allclose(with_it.x, truth, atol=0.2)


def test_what_is_left_of_some_recordings_is_what_these_alone_leave() -> None:
    random = np.random.default_rng(6)
    runs = [recorded(random.normal(0.0, k + 1.0, size=(200 * (k + 1), 2)), f"run{k}") for k in range(3)]
    left = left_by(runs, [e.measured for e in runs])
    for some in ([0], [2, 0], [0, 1, 2]):
        alone = left_by([runs[k] for k in some], [runs[k].measured for k in some])
        assert left.of(some).names == alone.names
        np.testing.assert_allclose(left.of(some).energies, alone.energies)
        np.testing.assert_allclose(left.of(some).counts, alone.counts)
        assert left.of(some).log_likelihood == pytest.approx(alone.log_likelihood)


def test_a_parameter_that_the_recordings_do_not_show_costs_nothing() -> None:
    random = np.random.default_rng(2)
    table = random.normal(size=(200, 2))
    run = recorded((table @ np.array([0.5, -1.0]) + 0.3 * random.normal(size=200))[:, None])
    two: Any = Linear([run], [table], np.array([1.0, 1.0]))
    three: Any = Linear([run], [np.column_stack([table, np.zeros(200)])], np.array([1.0, 1.0, 7.0]))
    assert found(three, three.best())[0] == pytest.approx(found(two, two.best())[0])


def test_held_out_recordings_count_in_the_likelihood() -> None:
    random = np.random.default_rng(9)
    table = random.normal(size=(200, 1))
    train = recorded((0.5 * table[:, 0] + 0.3 * random.normal(size=200))[:, None])
    scores = []
    for truth in (0.5, 3.0):
        judged = recorded((truth * table[:, 0] + 0.3 * random.normal(size=200))[:, None], "other", "hold_out")
        problem: Any = Linear([train, judged], [table, table], np.ones(1))
        scores.append(found(problem, problem.best())[0])
    assert scores[0] > scores[1] + 50


def test_a_model_whose_simulation_fails_is_the_least_likely_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coloured noise takes a large error at one frequency for a single value; one run that failed was a constant."""
    measured = 1e3 * np.sin(2 * np.pi * 3.0 * STEP * np.arange(500))[:, None]
    problem = Problem(SimpleNamespace(), SimpleNamespace(), (recorded(measured),), ())  # type: ignore[arg-type]

    def answers(_: Problem, x: Array, e: TimeExperiment) -> Array:
        if len(x):
            raise SimulationError("it diverged")
        return np.zeros_like(e.measured)

    def nothing_to_run(*_: Any) -> None:
        raise SimulationError("there is no model")

    monkeypatch.setattr(Problem, "values", lambda *_: ({}, {}))
    monkeypatch.setattr(TimeExperiment, "job", nothing_to_run)
    monkeypatch.setattr(Problem, "simulate", answers)
    for noise in get_args(Noise):
        standing, failed = (problem.misfit(x, problem.training, noise=noise) for x in (np.zeros(0), np.zeros(1)))
        assert failed > standing


def test_an_evidence_that_is_no_number_speaks_for_nothing() -> None:
    """Nothing tells a parameter, neither its prior nor the recordings: the volume that is left to it is none."""
    table = np.column_stack([np.ones(500), np.zeros(500)])
    problem: Any = Linear([recorded(np.zeros((500, 1)))], [table], np.array([1.0, np.inf]))
    with np.errstate(divide="ignore", invalid="ignore"):
        assert evidence(problem, np.zeros(2)).log == -np.inf
