"""What effects promise, alone and in pairs, against least squares; sizes that speak for each other."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.fft import dct

from diagnosis.api import gather
from diagnosis.effects.catalogue import candidates
from diagnosis.effects.effect import Candidate, EffectParameter
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.parameters import prior
from diagnosis.search.board import Board
from diagnosis.search.fitter import CandidateFitter
from diagnosis.search.partial_fit import standing
from diagnosis.search.screening import _gains, courses, together
from diagnosis.thresholds import FITTING, SEARCH
from scenarios.load import load
from tests.diagnosis import plants
from tests.diagnosis.plants import case


def bench(folder: Any, **more: Any) -> CandidateFitter:
    scenario = load(case(folder, **more))
    return CandidateFitter(scenario, gather(scenario, [], []), 1)


def test_the_gain_of_every_pair_is_that_of_least_squares() -> None:
    random = np.random.default_rng(4)
    table, r = random.normal(size=(200, 9)), 3 * random.normal(size=200)
    r += table @ random.uniform(-1.0, 3.0, 9)
    low = np.where(np.arange(9) < 3, 0.0, 1 / SEARCH.factor_of_two)  # three are the least of their effects
    gains, factor = _gains(table.T @ table, -table.T @ r, low)
    some = 0
    for i, j in itertools.combinations(range(9), 2):
        factors, left, *_ = np.linalg.lstsq(table[:, [i, j]], -r, rcond=None)
        able = bool(((factors > low[[i, j]]) & (factors < SEARCH.factor_of_two)).all())
        assert gains[i, j] == pytest.approx(float(r @ r - left[0]) if able else 0.0)
        assert (factor[i, j], factor[j, i]) == pytest.approx(tuple(factors) if able else (1.0, 1.0))
        some += able
    assert 0 < some < 36


def test_courses_that_are_one_and_the_same_make_no_pair() -> None:
    sensitivity = np.linspace(0.0, 1.0, 50)
    table = np.column_stack([sensitivity, 2 * sensitivity])
    assert _gains(table.T @ table, -table.T @ (-sensitivity), np.zeros(2))[0][0, 1] == 0.0


def test_a_course_reaches_the_likelihood_that_whitened_least_squares_with_the_prior_gives(tmp_path: Path) -> None:
    """The residual of the model's tangents and of one course, by numpy; derivatives are differences of simulations."""
    fitter = bench(tmp_path, seed=3, coulomb=1.5e-4)
    origin = fitter.origin((), standing(fitter.refit.fit))
    assert origin is not None
    made, x = origin.problem, origin.x
    friction = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "coulomb_friction")
    # Bands of all recordings that are fitted, each value of a cosine with the number of its band.
    bands = np.concatenate(
        [
            np.repeat([b for b, _ in rows], [p.stop - p.start for _, p in rows])
            for rows in (e.bands(4) for e in made.training)
        ]
    )

    def cosines(problem: Any, there: Any) -> Any:
        return np.concatenate([dct(problem.residual(there, e)[:, 0], norm="ortho") for e in problem.training])

    def strengths(rows: Any) -> dict[int, float]:
        return {int(b): max(float(np.mean(rows[bands == b] ** 2)), 1.0) for b in set(bands.tolist())}

    def likelihood(rest: Any) -> float:
        """Of a whitened residual with the prior at its end."""
        rows, own = rest[: len(bands)] * noise, rest[len(bands) :]
        each = np.array([strengths(rows)[int(b)] for b in bands])
        return float(-0.5 * np.sum(np.log(each) + rows**2 / each) - 0.5 * own @ own)

    begin = strengths(cosines(made, x))
    noise = np.sqrt([begin[int(b)] for b in bands])

    def left(problem: Any, there: Any, n: int = len(x)) -> Any:
        return np.concatenate([cosines(problem, there) / noise, there[:n]])

    h = 1e-4
    tangents = np.column_stack([(left(made, x + d) - left(made, x - d)) / (2 * h) for d in h * np.eye(len(x))])
    r = left(made, x)
    without = r + tangents @ np.linalg.lstsq(tangents, -r, rcond=None)[0]
    assert origin.likelihood == pytest.approx(likelihood(without), abs=0.01)
    found = courses(origin, friction)
    assert len(found) > 2
    assert [c.likelihood for c in found] == sorted((c.likelihood for c in found), reverse=True)
    some = 0
    for course in found:
        amended = fitter.build((friction,), (course.sizes,))
        names = [f.name for f in amended.free]
        there = np.array([x[[f.name for f in made.free].index(n)] if n.startswith("motor.") else 0.0 for n in names])
        added = left(amended, there)[: len(bands)] - r[: len(bands)]
        table = np.column_stack([tangents, np.concatenate([added, np.zeros(len(x))])])
        step = np.linalg.lstsq(table, -r, rcond=None)[0]
        low = 0.0 if course.least else 0.1 / SEARCH.factor
        inside = low < step[-1] < SEARCH.factor
        # Where the factor is out of reach, it stands at the end of what is allowed.
        factor = min(max(step[-1], low), SEARCH.factor)
        beside = r + factor * table[:, -1]
        rest = beside + tangents @ np.linalg.lstsq(tangents, -beside, rcond=None)[0]
        assert course.likelihood == pytest.approx(likelihood(rest), abs=0.5)
        some += inside
    assert some
    assert min(found, key=lambda c: float(c.values @ c.values)).least


def test_two_effects_that_are_concealed_together_are_among_the_first_pairs(tmp_path: Path) -> None:
    """A motor with 25 mV of dead zone and 1.5e-5 N.m of dry friction, integrated without flexarm."""
    fitter = bench(tmp_path, seed=3, coulomb=1.5e-5, dead=0.025)
    refit = fitter.refit
    origin = fitter.origin((), standing(refit.fit))
    assert origin is not None
    listed = [c for c in candidates(operating_scales(fitter.base)) if not c.freed]
    found = [course for c in listed for course in courses(origin, c)[: SEARCH.sizes]]
    pairs = together(found, origin, 16)
    keys = [{c.effect for c in pair} for pair in pairs]
    assert {"dead_zone", "coulomb_friction"} in keys
    pair = pairs[keys.index({"dead_zone", "coulomb_friction"})]
    assert all(len(c.starts) == 1 for c in pair)
    made = fitter.finish(fitter.partial_fit(pair, [standing(refit.fit)]))
    assert made.hold_out < 1.1 < refit.hold_out
    alone = [fitter.finish(fitter.partial_fit((c,), [standing(refit.fit)])) for c in pair]
    # What the two promise is more than either has come to, and no more than both together have.
    better = [{c.effect for c in pair} for pair in together(found, origin, 16, max(map(fitter.likelier, alone)))]
    assert {"dead_zone", "coulomb_friction"} in better
    assert not together(found, origin, 16, fitter.likelier(made) + 10)
    sizes = made.added()
    assert sizes["coulomb_friction.coulomb_friction"] == pytest.approx(1.5e-5, rel=0.2)
    assert sizes["dead_zone.upper"] == pytest.approx(0.025, rel=0.2)


def test_a_fit_that_ends_where_a_block_refuses_is_no_model(tmp_path: Path) -> None:
    fitter = bench(tmp_path, seed=3, coulomb=1.5e-4)
    listed = candidates(operating_scales(fitter.base))
    known = Board(fitter, fitter.refit, listed, None).known
    zone = next(c for c in listed if c.effect == "dead_zone")

    def ending(lower: float, upper: float) -> Any:
        sizes = {f"{zone.name}.lower": lower, f"{zone.name}.upper": upper}
        fit = SimpleNamespace(parameters=lambda: sizes)
        return SimpleNamespace(effects=(zone,), sizes=(zone.starts[0],), fit=fit)

    assert known._has_meaning(ending(-0.1, 0.1))
    assert not known.failures
    assert not known._has_meaning(ending(0.2, 0.1))
    ((key, why),) = known.failures
    assert key == zone.key
    assert "lower" in why


def one_way(t: Any) -> dict[str, Any]:
    """Inputs that reach the upper limit alone."""
    return {
        "steps": ("train", np.where(t % 1.0 < 0.5, 1.5, -0.8)),
        "chirp": ("train", 0.3 + 1.2 * np.sin(2 * np.pi * (0.5 + t) * t)),
        "slow": ("hold_out", 1.5 * np.sin(2 * np.pi * 0.9 * t)),
    }


def test_of_an_amplifier_that_reached_one_limit_the_other_is_taken_to_be_as_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plants.limit_amplifier(monkeypatch, one_way)
    fitter = bench(tmp_path, seed=5)
    limits = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "saturation")
    made = fitter.finish(fitter.partial_fit((limits,), [standing(fitter.refit.fit)]))
    found = made.added()
    assert found["saturation.upper"] == pytest.approx(1.0, rel=0.01)
    assert found["saturation.lower"] == pytest.approx(-found["saturation.upper"], rel=1e-3)
    assert made.hold_out < 1.2  # it meets both limits


def test_two_ends_that_the_recordings_know_may_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 and -0.7 V the recordings speak against the prior by thousands, and win."""
    speed = plants.speed
    monkeypatch.setattr(plants, "speed", lambda t, u, **more: speed(t, np.clip(u, -0.7, 1.0), **more))
    fitter = bench(tmp_path, seed=5)
    limits = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "saturation")
    found = fitter.finish(fitter.partial_fit((limits,), [standing(fitter.refit.fit)])).added()
    assert (found["saturation.lower"], found["saturation.upper"]) == pytest.approx((-0.7, 1.0), rel=0.01)


def test_the_prior_counts_how_far_two_sizes_are_apart_and_its_slopes_are_exact(tmp_path: Path) -> None:
    fitter = bench(tmp_path, seed=1)
    limits = next(c for c in candidates(operating_scales(fitter.base)) if c.effect == "saturation")
    made = fitter.build((limits,), ({"lower": -0.5, "upper": 1.5},))
    x = np.random.default_rng(2).normal(size=len(made.free))
    values = made.values(x)[0]
    r, J = prior(made.free, x)
    ratio = values["found_saturation.upper"] / -values["found_saturation.lower"]
    assert r[-1] == pytest.approx(math.log(ratio) / FITTING.alike)
    steps = [(prior(made.free, x + h)[0] - prior(made.free, x - h)[0]) / 2e-6 for h in 1e-6 * np.eye(len(x))]
    np.testing.assert_allclose(np.column_stack(steps), J, atol=1e-8)


def test_heights_on_a_line_cost_nothing_and_a_kink_what_it_bends() -> None:
    """Heights 0.1, 0.4 and 0.5 bend by -0.2, a fifth of the standard deviation: 0.5 times the reference of 2."""
    names = ["a", "b", "c"]
    heights = [
        EffectParameter(n, 2.0, signed=True, spread=1e6, like=like, apart=0.5)
        for n, like in zip(names, [(), (), ("b", "a")], strict=True)
    ]
    curve = Candidate("unknown", "p", "p", "law", lambda v: [], tuple(heights))
    free = curve.free({"a": 0.1, "b": 0.4, "c": 0.5})
    for values, bend in (((0.1, 0.4, 0.5), -0.2), ((-1.0, 4.0, 9.0), 0.0), ((0.0, 1.0, 4.0), 2.0)):
        x = np.array([f.position(v) for f, v in zip(free, values, strict=True)])
        r, J = prior(free, x)
        assert r[-1] == pytest.approx(bend / (0.5 * 2.0), abs=1e-12)
        np.testing.assert_allclose(J[-1] / [f.scale for f in free], [1.0, -2.0, 1.0])


@pytest.mark.parametrize("start", [-0.5, 0.5])
def test_a_size_of_either_sign_goes_as_far_as_it_may(start: float) -> None:
    spring = Candidate(
        "stray_spring", "a", "a", "found", lambda v: [], (EffectParameter("rest", 2.0, signed=True, most=3.0),)
    )
    (row,) = spring.free({"rest": start})
    assert (row.low, row.high) == (-6.0, 6.0)
    assert (row.value(-1e3), row.value(0.0), row.value(1e3)) == (-6.0, start, 6.0)


ARM = """\
schema: 1
name: arm
blocks:
  source: {type: Step, height: 1 N.m}
  drive: {type: Torque}
  arm: {type: Inertia, inertia: 20 kg.m2}
connect: [[source.out, drive.torque], [drive.shaft, arm.shaft]]
simulate: {stop: 2 s, step: 10 ms}
recordings:
"""


def test_a_weight_whatever_its_angle_promises_what_the_constant_torque_does_that_it_is(tmp_path: Path) -> None:
    """An arm that moves little: gravity is a constant torque there if it hangs at a right angle.

    At its other angles it is hardly anything, beside which what is small at a right angle does not look small.
    """
    t, random = np.arange(0.0, 2.0, 0.01), np.random.default_rng(5)
    text = ARM
    for name, role in (("one", "train"), ("two", "train"), ("three", "hold_out")):
        torque = np.repeat(random.choice([-3.0, 3.0], 10), 20)
        speed = np.concatenate([[0.0], np.cumsum((torque[:-1] - 1e-4) / 20.0 * 0.01)])
        angle = np.concatenate([[0.0], np.cumsum(0.01 * (speed[:-1] + speed[1:]) / 2)])
        rows = np.column_stack([t, torque, angle + 1e-6 * random.standard_normal(len(t))])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,angle", comments="")
        text += (
            f"  {name}: {{file: {name}.csv, time: {{column: t, unit: s}}, drive: {{drive.torque: {{column: u, unit: "
            f"N.m}}}}, measurements: {{arm.shaft.angle: {{column: angle, unit: rad, noise: 1e-6}}}}, role: {role}}}\n"
        )
    (tmp_path / "arm.yaml").write_text(text, encoding="utf-8")
    scenario = load(tmp_path / "arm.yaml")
    fitter = CandidateFitter(scenario, gather(scenario, [], []), 1)
    origin = fitter.origin((), standing(fitter.refit.fit))
    assert origin is not None
    listed = candidates(operating_scales(fitter.base))
    effects = {name: next(c for c in listed if c.effect == name) for name in ("gravity", "offset")}
    gains = {name: courses(origin, c)[0].likelihood - origin.likelihood for name, c in effects.items()}
    assert gains["offset"] > 20
    assert gains["gravity"] == pytest.approx(gains["offset"], rel=0.05)
