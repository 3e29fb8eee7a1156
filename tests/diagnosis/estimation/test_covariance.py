"""Intervals: what they make of noise, of an input that is not what it says, and of what recordings do not show."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import gather
from diagnosis.estimation.covariance import covariance
from diagnosis.estimation.least_squares import Fit, Interval, descend, interval_in_words, with_covariance
from diagnosis.estimation.parameters import FreeParameter
from diagnosis.problems import problem, variant
from diagnosis.thresholds import INTERVALS
from engine.threads import Threads
from scenarios.load import load

INERTIA, DAMPING, NOISE, STEP, COUNT = 2.0, 0.5, 0.01, 0.01, 400

TEXT = """
schema: 1
name: wheel
blocks:
  push: {{type: Torque}}
  limit: {{type: Saturation, lower: -3, upper: 3}}
  wheel: {{type: Inertia, inertia: 2 kg.m2}}
  oil: {{type: BearingFriction, viscous_friction: {damping} N.m.s/rad}}
connect:
  - [limit.out, push.torque]
  - [push.shaft, wheel.shaft, oil.shaft]
simulate: {{stop: 4 s, step: 10 ms}}
tolerances: {{wheel.inertia: 1000 %, oil.viscous_friction: 0}}
recordings:
  one:
    file: one.csv
    time: {{column: t, unit: s}}
    drive: {{limit.in: {{column: u, unit: N.m, hold: zero_order}}}}
    measurements: {{wheel.shaft.speed: {{column: w, unit: rad/s, noise: {noise}}}}}
    role: train
"""


def wheel(folder: Any, noise: Any = NOISE, seed: int = 0, damping: Any = DAMPING, gain: float = 0.0) -> tuple[Any, Any]:
    """A wheel with oil, by hand: w' = ((1 + gain) u - b w) / J with u constant over each sample."""
    t = STEP * np.arange(COUNT)
    u = np.sign(np.sin(2.5 * t + 0.3))
    keep = math.exp(-damping * STEP / INERTIA)
    w = np.zeros(COUNT)
    for k in range(COUNT - 1):
        w[k + 1] = keep * w[k] + (1 - keep) * (1 + gain) * u[k] / damping
    w += noise * np.random.default_rng(seed).standard_normal(COUNT)
    rows = "\n".join(f"{a:.6f},{b:.6f},{c:.9f}" for a, b, c in zip(t, u, w, strict=True))
    folder.mkdir(exist_ok=True)
    (folder / "one.csv").write_text(f"t,u,w\n{rows}\n")
    (folder / "wheel.yaml").write_text(TEXT.format(noise=noise, damping=damping))
    scenario = load(folder / "wheel.yaml")
    return scenario, gather(scenario, [], [])


def slopes(made: Any, x: Any) -> Any:
    e = made.training[0]
    return made.linearised(x, e)


def test_an_input_that_may_be_three_per_cent_off_leaves_an_inertia_uncertain_by_as_much(tmp_path: Path) -> None:
    """Without friction the speed is the torque over the inertia: an error of the one is an error of the other."""
    made = problem(*wheel(tmp_path, noise=1e-5, damping=1e-7))
    (free,) = made.free
    spread, _, flat = covariance(made, np.zeros(1))
    assert free.scale * math.sqrt(spread[0, 0]) == pytest.approx(INTERVALS.input_size, rel=0.2)
    assert not flat


def test_white_noise_alone_gives_the_textbook_interval(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the input exact and nothing left out: at least sigma^2 (J'J)^-1, and not much more."""
    exact = replace(INTERVALS, input_size=0.0, input_timing=0.0, least_left=0.0)
    monkeypatch.setattr("diagnosis.estimation.covariance.INTERVALS", exact)
    made = problem(*wheel(tmp_path, noise=0.05))
    _, J = slopes(made, np.zeros(1))
    textbook = 1 / (1 + float((J.T @ J)[0, 0]))
    spread, _, _ = covariance(made, np.zeros(1))
    assert textbook * (1 - 1e-9) <= spread[0, 0] < 3 * textbook


def test_intervals_hold_the_inertia_through_gain_errors(tmp_path: Path) -> None:
    """Thirty rigs whose amplifiers are off by up to 5 %: 88 to 100 % of the intervals hold the true value."""
    inside = 0
    for seed in range(30):
        gain = np.random.default_rng(100 + seed).uniform(-0.05, 0.05)
        made = problem(*wheel(tmp_path / str(seed), seed=seed, gain=gain))
        with Threads(1) as pool:
            x, cost, converged = descend(made, np.zeros(1), made.training, pool)
        found = with_covariance(Fit(made, x, cost, 1.0, converged, np.zeros((1, 1))), 0.0)
        (interval,) = found.intervals()
        inside += interval.low <= INERTIA <= interval.high
    assert inside >= 0.88 * 30


def test_a_limit_that_is_never_reached_is_bounded_on_one_side_alone(tmp_path: Path) -> None:
    """The recorded torque goes to 1 N.m: a limit below it would show, one above it changes nothing."""
    scenario, recorded = wheel(tmp_path)
    limits = [
        FreeParameter(f"limit.{end}", value, 0.3, True, min(0.0, 1e6 * value), max(0.0, 1e6 * value), prior=False)
        for end, value in (("lower", -1.7), ("upper", 1.4))
    ]
    made = variant(problem(scenario, recorded), (), limits)
    spread, weak, flat = covariance(made, np.zeros(3))
    names = [f.name for f in made.free]
    assert {names[i] for i, *_ in flat} == {"limit.lower", "limit.upper"}
    found = Fit(made, np.zeros(3), 0.0, 1.0, True, spread, weak, flat).intervals()
    lower, upper = (next(i for i in found if i.name == f"limit.{end}") for end in ("lower", "upper"))
    assert (lower.low, upper.high) == (-math.inf, math.inf)
    assert -1.0 < lower.high < -0.95
    assert 0.95 < upper.low < 1.0
    assert lower.numbers()["low"] is None
    assert interval_in_words(upper.numbers()) == f"at least {upper.low:.4g}"


def test_an_interval_in_words() -> None:
    assert interval_in_words(Interval("a", 1.0, 0.5, 2.0, "V", 1.0).numbers()) == "0.5 to 2"
    assert interval_in_words(Interval("a", 1.0, 0.01, 2.0, "V", 1.0).numbers()) == "not determined by these recordings"
    assert interval_in_words(Interval("a", -0.1, -0.3, -0.002, "rad", 0.0, False).numbers()) == "-0.3 to -0.002"
    assert interval_in_words(Interval("a", 1.0, -math.inf, 2.0, "V", 1.0).numbers()) == "at most 2"
    assert (
        interval_in_words(Interval("a", 1.0, -math.inf, math.inf, "V", 1.0).numbers())
        == "not determined by these recordings"
    )
