"""The integration step of a fit where a spring hardens: against an independent solver, and against the rate by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.api import gather
from diagnosis.compare import compare
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import problem
from engine.errors import SimulationError
from engine.step import STEP_PER_RATE
from scenarios.load import load

ROTOR, LOAD, K, CUBIC, DAMPING, INTERVAL, NOISE = 1e-4, 1e-2, 1.0, 2e5, 2e-2, 2e-3, 1e-4

JOINT = """\
schema: 1
name: stiffening
blocks:
  source: {type: Step, height: 1 N.m}
  motor: {type: Torque}
  rotor: {type: Inertia, inertia: 1e-4 kg.m2}
  joint: {type: HardeningSpring, stiffness: 1 N.m/rad, cubic_stiffness: 2e5 N.m/rad3, damping: 0.02 N.m.s/rad}
  load: {type: Inertia, inertia: 1e-2 kg.m2}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, rotor.shaft, joint.a]
  - [joint.b, load.shaft]
simulate: {stop: 0.4 s, step: 2 ms}
recordings:
  run:
    file: run.csv
    time: {column: t, unit: s}
    drive: {motor.torque: {column: u, unit: N.m, hold: zero_order}}
    measurements: {rotor.shaft.angle: {column: a, unit: rad, noise: 1e-4}}
    role: train
"""


def _recorded(torque: float, t: np.ndarray) -> tuple[np.ndarray, float]:
    """Angle of the rotor at the samples, and the largest twist, by another solver."""

    def rates(_: float, x: np.ndarray) -> list[float]:
        twist, rate = x[0] - x[1], x[2] - x[3]
        spring = K * twist + CUBIC * twist**3 + DAMPING * rate
        return [x[2], x[3], (torque - spring) / ROTOR, spring / LOAD]

    found = solve_ivp(rates, (0, t[-1]), np.zeros(4), t_eval=t, method="DOP853", rtol=1e-11, atol=1e-14, max_step=1e-4)
    return found.y[0], float(np.abs(found.y[0] - found.y[1]).max())


def test_the_step_suits_a_spring_where_it_is_twisted_most(tmp_path: Path) -> None:
    """At rest the spring is soft; under load it is a hundred times as stiff, and swings ten times as fast."""
    t, torque = INTERVAL * np.arange(200), 1.0
    angle, twist = _recorded(torque, t)
    noisy = angle + NOISE * np.random.default_rng(2).standard_normal(len(t))
    rows = np.column_stack([t, 0 * t + torque, noisy])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,u,a", comments="", fmt="%.9g")
    path = tmp_path / "joint.yaml"
    path.write_text(JOINT, encoding="utf-8")
    scenario = load(path)
    made = problem(scenario, gather(scenario, (), ()))
    given = np.zeros(len(made.free))
    reduced = ROTOR * LOAD / (ROTOR + LOAD)
    soft, stiff = (math.sqrt(k / reduced) for k in (K, K + 3 * CUBIC * twist**2))
    assert stiff > 8 * soft
    # A coarse run tells how far it is twisted, to a few parts in a hundred.
    assert made.internal_step is not None
    assert INTERVAL / 8 <= made.internal_step < 1.1 * STEP_PER_RATE / stiff
    # Damped as it is, the swing is followed to a noise's breadth; with the step of its soft beginning it is not.
    assert made.chi2(given, made.training) < 1.3
    assert compare(scenario, "run").signals["rotor.shaft.angle"].rmse < 1.2 * NOISE
    beginning = replace(made, internal_step=min(INTERVAL, STEP_PER_RATE / soft))
    assert beginning.chi2(given, made.training) > 100


def test_what_runs_away_whatever_the_step_keeps_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    t = INTERVAL * np.arange(20)
    np.savetxt(tmp_path / "run.csv", np.column_stack([t, 0 * t, t**2]), delimiter=",", header="t,u,a", comments="")
    path = tmp_path / "joint.yaml"
    path.write_text(JOINT, encoding="utf-8")
    scenario = load(path)
    tried: list[float] = []

    def runs_away(e: Any, model: Any, parameters: Any, starts: Any, longest: float) -> Any:
        tried.append(longest)
        raise SimulationError("the run diverged")

    monkeypatch.setattr(TimeExperiment, "visited", runs_away)
    made = problem(scenario, gather(scenario, (), ()))
    assert made.internal_step == tried[0]
    assert tried == [tried[0] / 2**k for k in range(4)]
