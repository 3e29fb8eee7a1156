"""Where recordings begin: at their samples, with the rest of the model in equilibrium, against statics by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from diagnosis.api import fit
from diagnosis.binding import find_recording
from diagnosis.estimation.initial_states import _slope
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import problem, variant
from diagnosis.thresholds import FITTING
from engine.errors import FlexarmError
from engine.start import start_values
from scenarios.amend import Between
from scenarios.load import load

K, M, G, R = 40.0, 0.8, 9.81, 0.5

ARM = """\
schema: 1
name: arm
blocks:
  source: {type: Step, height: 0 N.m}
  motor: {type: Torque}
  rotor: {type: Inertia, inertia: 0.02 kg.m2}
  joint: {type: SpringDamper, stiffness: 40 N.m/rad, damping: 0.05}
  link: {type: Inertia, inertia: 0.2 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 0.3 N.m.s/rad}
  weight: {type: GravityTorque, mass: 0.8 kg, radius: 0.5 m, gravity: 9.81}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, rotor.shaft, joint.a]
  - [joint.b, link.shaft, bearing.shaft, weight.shaft]
simulate: {stop: 1 s, step: 5 ms}
recordings:
  run:
    file: run.csv
    time: {column: t}
    drive: {motor.torque: {column: u, unit: N.m}}
    measurements:
      MEASUREMENTS
    initial: START
"""
MOTOR = "rotor.shaft.angle: {column: a, unit: rad, noise: 1e-3}"
LINK = "link.shaft.angle: {column: b, unit: rad, noise: 1e-3}"
TWIST = "joint.twist: {column: e, unit: rad, noise: 1e-4}"


def sagging(motor: float) -> float:
    """Angle of the link at which spring and weight balance."""
    return float(brentq(lambda b: K * (motor - b) - M * G * R * np.sin(b), -2, 2))


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Columns of a motor that turns from 0.3 rad at 2 rad/s."""
    random = np.random.default_rng(1)
    t = 5e-3 * np.arange(200)
    a, b = 0.3 + 2 * t + random.normal(0, 1e-3, 200), 0.1 + 0.5 * t + random.normal(0, 1e-3, 200)
    columns = np.column_stack([t, 0 * t + 1.0, a, b, a - b])
    np.savetxt(tmp_path / "run.csv", columns, delimiter=",", header="t,u,a,b,e", comments="")
    return tmp_path / "arm.yaml"


def experiment(path: Path, measured: list[str], start: str) -> TimeExperiment:
    path.write_text(ARM.replace("MEASUREMENTS", "\n      ".join(measured)).replace("START", start))
    scenario = load(path)
    (found,) = problem(scenario, [find_recording(scenario, "run")]).experiments
    assert isinstance(found, TimeExperiment)
    return found


def state(e: TimeExperiment, path: Path) -> dict[str, float]:
    """Every state at the first instant."""
    model = load(path).build(["motor.torque"], ["joint.twist"])
    x = start_values(model, model.parameter_values, e.begin.complete(e.initial))
    return {s.name: float(v) for s, v in zip(model.states, x, strict=True)}


def test_an_unmeasured_link_hangs_from_the_motor_as_it_stands(arm: Path) -> None:
    """The motor at its sample, with its noise as prior; the link where spring and weight balance."""
    e = experiment(arm, [MOTOR], "{free: [rotor.shaft.angle]}")
    first = float(e.measured[0, 0])
    assert e.initial["rotor.shaft.angle"] == first
    assert e.deviations["rotor.shaft.angle"] == pytest.approx(1e-3)
    positions = [v for name, v in state(e, arm).items() if name.endswith("angle")]
    assert sorted(positions) == pytest.approx(sorted([first, sagging(first)]), abs=1e-9)


def test_the_link_follows_where_a_fit_moves_the_motor(arm: Path) -> None:
    """A step of the motor's start moves the link by d b / d a = k / (k + m g r cos b), here and in the Jacobian."""
    e = experiment(arm, [MOTOR], "{free: [rotor.shaft.angle]}")
    scenario = load(arm)
    posed = problem(scenario, [find_recording(scenario, "run")])
    ((_, slopes),) = e.begin.follows.items()
    link = sagging(float(e.measured[0, 0]))
    assert slopes["rotor.shaft.angle"] == pytest.approx(K / (K + M * G * R * np.cos(link)), rel=1e-9)
    zero = np.zeros(len(posed.free))
    column = [f.recording for f in posed.free].index("run")
    step = np.eye(len(zero))[column] * 1e-3
    there = (posed.residual(step, posed.experiments[0]) - posed.residual(-step, posed.experiments[0])).ravel() / 2e-3
    for only in (None, [column]):
        jacobian = posed.linearised(zero, posed.experiments[0], only)[1]
        np.testing.assert_allclose(jacobian[:, column], there, rtol=0, atol=1e-5 * np.abs(there).max())
    assert not np.delete(jacobian, column, axis=1).any(), "what was not asked for is not worked out"


def test_absolute_angles_follow_from_relative_sensors(arm: Path) -> None:
    """The twist is a - b: the link begins at the motor's sample less the twist's, with both deviations."""
    e = experiment(arm, [MOTOR, TWIST], "{free: [link.shaft.angle, rotor.shaft.angle]}")
    motor, twist = e.measured[0]
    assert e.initial["link.shaft.angle"] == pytest.approx(motor - twist, abs=1e-12)
    assert e.deviations["link.shaft.angle"] == pytest.approx(np.hypot(1e-3, 1e-4), rel=1e-6)


def test_all_that_is_measured_begins_at_its_samples(arm: Path) -> None:
    e = experiment(arm, [MOTOR, LINK], "{state: as_measured}")
    assert sorted(e.free) == sorted(
        [f"{body}.shaft.{what}" for body in ("rotor", "link") for what in ("angle", "speed")]
    )
    for body, speed in (("rotor", 2.0), ("link", 0.5)):
        away = e.initial[f"{body}.shaft.speed"] - speed
        assert abs(away) < 4 * e.deviations[f"{body}.shaft.speed"] < 1.0
    relative = experiment(arm, [MOTOR, TWIST], "{state: as_measured}")
    assert len(relative.free) == 4
    assert relative.initial["rotor.shaft.angle"] == pytest.approx(relative.measured[0, 0], abs=1e-12)


def test_starting_values_may_be_given(arm: Path) -> None:
    e = experiment(arm, [MOTOR], "{values: {rotor.shaft.angle: 10 deg}}")
    assert e.free == ()
    assert sorted(v for name, v in state(e, arm).items() if name.endswith("angle")) == pytest.approx(
        sorted([np.deg2rad(10), sagging(np.deg2rad(10))]), abs=1e-9
    )
    with pytest.raises(FlexarmError, match=r"'rotor\.shaft\.angel' has no starting value") as caught:
        experiment(arm, [MOTOR], "{values: {rotor.shaft.angel: 10 deg}}")
    assert "rotor.shaft.angle" in caught.value.remedy
    with pytest.raises(FlexarmError, match=r"N\.m"):
        experiment(arm, [MOTOR], "{values: {rotor.shaft.angle: 1 N.m}}")


def test_a_free_start_does_not_absorb_what_the_model_lacks(tmp_path: Path, arm: Path) -> None:
    """A model whose damping is ten times too small: the start stays within a few deviations of its sample."""
    e = experiment(arm, [MOTOR, LINK], "{state: as_measured}")
    made, _ = fit(load(arm), workers=1)
    for f, x in zip(made.problem.free, made.x, strict=True):
        assert f.prior != bool(f.recording)
        if f.name.endswith("angle"):
            assert abs(f.value(x) - e.initial[f.name]) <= FITTING.start_reach * 1e-3


def test_recordings_may_differ_in_declared_values(arm: Path) -> None:
    """The same rig with two weights is one study: each recording is simulated with its own."""
    experiment(arm, [MOTOR], "{values: {rotor.shaft.angle: 0.3}}")
    text = arm.read_text()
    heavy = text[text.index("  run:") :].replace("  run:", "  heavy:") + "    set: {weight.mass: 1600 g}\n"
    arm.write_text(text + heavy)
    scenario, other = load(arm), load(arm, ["weight.mass=1.6"])
    one = problem(scenario, [find_recording(scenario, name) for name in ("run", "heavy")])
    alone = problem(other, [find_recording(other, "run")])
    zero, none = np.zeros(len(one.free)), np.zeros(len(alone.free))
    own = one.simulate(zero, one.experiments[1])
    assert np.abs(own - one.simulate(zero, one.experiments[0])).max() > 0.05
    np.testing.assert_allclose(own, alone.simulate(none, alone.experiments[0]), atol=1e-6)
    column = [f.name for f in one.free].index("weight.mass")
    moved = [one.linearised(zero, e)[1][:, column].any() for e in one.experiments]
    assert moved == [True, False]
    arm.write_text(text + heavy.replace("weight.mass", "weight.mas"))
    wrong = load(arm)
    with pytest.raises(FlexarmError, match=r"'weight\.mas' is no number that the model depends on") as caught:
        problem(wrong, [find_recording(wrong, "heavy")])
    assert "weight.mass" in caught.value.remedy


def with_a_tip(arm: Path) -> Problem:
    """The arm with a tip on a spring, which the scenario holds fast to the link."""
    arm.write_text(
        arm.read_text()
        .replace("connect:", "  tip: {type: Inertia, inertia: 0.1 kg.m2}\nconnect:")
        .replace("link.shaft, bearing", "link.shaft, tip.shaft, bearing")
    )
    scenario = load(arm)
    base = problem(scenario, [find_recording(scenario, "run")])
    spring = {"stiffness": 60.0, "damping": 0.01}
    return variant(base, [Between("give", "SpringDamper", "tip.shaft", "a", "b", spring)])


def test_an_amended_model_begins_in_its_own_equilibrium(arm: Path) -> None:
    """A spring between the link and its tip adds a coordinate: the tip begins beside the link, not at zero."""
    experiment(arm, [MOTOR], "{free: [rotor.shaft.angle]}")
    amended = with_a_tip(arm)
    (e,) = amended.experiments
    assert isinstance(e, TimeExperiment)
    model = amended.model
    x = start_values(model, model.parameter_values, e.begin.complete(e.initial))
    positions = sorted(x[: model.coordinates])
    motor = float(e.measured[0, 0])
    assert positions == pytest.approx(sorted([motor, sagging(motor), sagging(motor)]), abs=1e-9)


@pytest.mark.parametrize(("free", "added"), [("rotor.shaft.angle", 0), ("rotor.shaft.angle, link.shaft.angle", 1)])
def test_where_a_recording_begins_out_of_equilibrium_what_an_amended_model_adds_does_too(
    arm: Path, free: str, added: int
) -> None:
    """The link is let go of, as nothing measures it: so is the tip that a spring sets free of it."""
    experiment(arm, [MOTOR], f"{{free: [{free}]}}")
    amended = with_a_tip(arm)
    (e,) = amended.experiments
    assert isinstance(e, TimeExperiment)
    assert len(e.free) == len(free.split(",")) + added
    assert len(e.begin.follows) == (0 if added else 2)
    assert len([f for f in amended.free if f.recording]) == len(e.free)


@pytest.mark.parametrize("samples_a_period", [7.0, 9.0, 14.0, 30.0, 200.0])
def test_a_start_in_mid_swing_is_known_no_better_than_its_samples_tell(samples_a_period: float) -> None:
    """The slope of a sine at any phase lies within what is said of it, however few samples a period has."""
    t, sigma = np.linspace(0.0, 0.015, 16), 1e-3
    w = 2 * math.pi / samples_a_period / 1e-3
    random = np.random.default_rng(6)
    off = []
    for phase in np.linspace(0, 2 * math.pi, 24, endpoint=False):
        found, deviation = _slope(t, np.sin(w * t + phase) + sigma * random.standard_normal(16), sigma)
        off.append(abs(found - w * math.cos(phase)) / deviation)
    assert np.quantile(off, 0.9) < 3
    assert max(off) < 8


def test_the_slope_of_a_parabola_is_as_sure_as_the_noise_allows() -> None:
    t, sigma = np.linspace(0.0, 0.015, 16), 1e-3
    random = np.random.default_rng(7)
    found = [_slope(t, 3 * t - 40 * t**2 + sigma * random.standard_normal(16), sigma) for _ in range(200)]
    off = np.array([slope - 3 for slope, _ in found])
    assert np.median([deviation for _, deviation in found]) == pytest.approx(off.std(), rel=0.3)
