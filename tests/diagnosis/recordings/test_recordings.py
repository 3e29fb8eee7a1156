"""Recordings of every kind: uneven time, windows, periods that lead in, free starts, loops, files outside."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diagnosis.api import fit
from diagnosis.binding import find_recording, row_interval
from diagnosis.compare import compare
from diagnosis.effects.scales import operating_scales
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import problem
from diagnosis.recordings.between_samples import between_samples
from diagnosis.recordings.columns import read_columns
from diagnosis.recordings.feedback import plant_inputs
from diagnosis.recordings.time_axis import even_time
from diagnosis.recordings.types import Recording
from engine.errors import FlexarmError
from scenarios.load import load

J, B, K = 0.5, 0.3, 12.0

PENDULUM = """\
schema: 1
name: swing
blocks:
  arm: {{type: Inertia, inertia: 0.5 kg.m2}}
  bearing: {{type: BearingFriction, viscous_friction: {damping}}}
  spring: {{type: GroundSpring, stiffness: 12 N.m/rad}}
connect:
  - [arm.shaft, bearing.shaft, spring.shaft]
tolerances: {{arm.inertia: 0, spring.stiffness: 0}}
simulate: {{stop: 3 s, step: 10 ms}}
recordings:
  one:
    file: one.csv
    time: {{column: t}}
    measurements: {{arm.shaft.angle: {{column: y, unit: rad, noise: 1e-4}}}}
    initial: {{free: [arm.shaft.angle, arm.shaft.speed]}}
  two:
    file: two.csv
    time: {{column: t}}
    measurements: {{arm.shaft.angle: {{column: y, unit: rad, noise: 1e-4}}}}
    initial: {{free: [arm.shaft.angle, arm.shaft.speed]}}
    role: hold_out
"""


def decay(t: np.ndarray, angle: float, speed: float) -> np.ndarray:
    """The free swing in closed form."""
    a, w = B / (2 * J), np.sqrt(K / J - (B / (2 * J)) ** 2)
    found: np.ndarray = np.exp(-a * t) * (angle * np.cos(w * t) + (speed + a * angle) / w * np.sin(w * t))
    return found


def store(path: Path, **columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """Two free decays, sampled at instants drawn at random."""
    random = np.random.default_rng(4)
    for name, angle, speed in (("one", 0.4, -1.0), ("two", -0.2, 2.0)):
        t = np.sort(random.uniform(0.0, 3.0, 300))
        t -= t[0]
        store(tmp_path / f"{name}.csv", t=t, y=decay(t, angle, speed))
    (tmp_path / "swing.yaml").write_text(PENDULUM.format(damping="0.2 N.m.s/rad"))
    return tmp_path / "swing.yaml"


def test_uneven_free_decays_are_fitted_with_their_own_starts(swing: Path) -> None:
    """Damping, and the state in which each recording begins, held-out ones too, against the closed form."""
    made, scores = fit(swing, workers=1)
    assert made.parameters()["bearing.viscous_friction"] == pytest.approx(B, rel=0.01)
    assert made.problem.values(made.x, made.problem.experiments[0])[1] == pytest.approx(
        {"arm.shaft.angle": 0.4, "arm.shaft.speed": -1.0}, abs=2e-3
    )
    assert scores["fitted"] < 1.0
    assert any("uneven" in note for note in find_recording(load(swing), "one").notes)
    experiment = made.problem.experiments[0]
    assert isinstance(experiment, TimeExperiment)
    assert experiment.uneven


def test_outputs_at_uneven_instants_are_those_of_the_model(swing: Path) -> None:
    scenario = load(swing, ["bearing.viscous_friction=0.3"])
    made = problem(scenario, [find_recording(scenario, "one")])
    x = np.array(
        [f.position({"arm.shaft.angle": 0.4, "arm.shaft.speed": -1.0}.get(f.name, f.start)) for f in made.free]
    )
    residual = made.residual(x, made.experiments[0]) * made.experiments[0].sigma
    # Linear interpolation between rows h apart leaves up to h^2 max|y''| / 8, y'' of about w^2 0.45.
    experiment = made.experiments[0]
    assert isinstance(experiment, TimeExperiment)
    bound = experiment.step**2 * (K / J) * 0.5 / 8
    assert np.abs(residual).max() < 1.2 * bound


def test_slopes_at_uneven_instants_are_differences(swing: Path) -> None:
    scenario = load(swing)
    made = problem(scenario, [find_recording(scenario, "one")])
    e, zero = made.experiments[0], np.zeros(len(made.free))
    _, jacobian = made.linearised(zero, e)
    for k in range(len(zero)):
        step = np.zeros(len(zero))
        step[k] = 1e-5
        difference = (made.residual(zero + step, e) - made.residual(zero - step, e)).ravel() / 2e-5
        np.testing.assert_allclose(jacobian[:, k], difference, rtol=0, atol=1e-5 * np.abs(difference).max())


def test_starts_begin_at_the_first_sample_and_its_slope(swing: Path) -> None:
    scenario = load(swing)
    (e,) = problem(scenario, [find_recording(scenario, "two")]).experiments
    assert e.initial["arm.shaft.angle"] == pytest.approx(-0.2, abs=1e-9)
    assert e.initial["arm.shaft.speed"] == pytest.approx(2.0, abs=0.3)
    wrong = load(swing, text=PENDULUM.format(damping=0.2).replace("arm.shaft.speed", "arm.shaft.spead"))
    with pytest.raises(FlexarmError, match=r"'arm.shaft.spead' in 'initial: free' of recording 'two'") as caught:
        problem(wrong, [find_recording(wrong, "two")])
    assert "arm.shaft.speed" in caught.value.remedy


PRELOADED = """\
schema: 1
name: preloaded
blocks:
  source: {type: Step, height: 0 N.m}
  motor: {type: Torque}
  arm: {type: Inertia, inertia: 0.5 kg.m2}
  bearing: {type: BearingFriction, coulomb_friction: 1 N.m}
  spring: {type: GroundSpring, stiffness: 12 N.m/rad}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, arm.shaft, bearing.shaft, spring.shaft]
tolerances: {arm.inertia: 0, spring.stiffness: 0, bearing.coulomb_friction: 0}
simulate: {stop: 1 s, step: 1 ms}
recordings:
  run:
    file: run.csv
    time: {column: t}
    drive: {motor.torque: {column: u, unit: N.m, hold: linear}}
    measurements: {arm.shaft.angle: {column: y, unit: rad, zero: first, noise: 1e-4}}
    initial: {free: [arm.shaft.angle]}
"""


def test_the_preload_of_a_stuck_joint_is_found(tmp_path: Path) -> None:
    """A rising torque breaks the joint away the sooner the more the spring pushes: u(t) + k p = Fc at the instant."""
    preload, t = 0.05, 0.002 * np.arange(901)
    leave = 1.0 - K * preload  # s, with a torque of 1 N.m/s and a Coulomb friction of 1 N.m
    w, after = np.sqrt(K / J), np.maximum(t - (1.0 - K * preload), 0.0)
    moved = np.where(t > leave, (after - np.sin(w * after) / w) / K, 0.0)
    store(tmp_path / "run.csv", t=t, u=t, y=moved)
    (tmp_path / "s.yaml").write_text(PRELOADED.replace("arm.shaft.angle]", "arm.shaft.angle]\n"))
    made, scores = fit(tmp_path / "s.yaml", workers=1)
    # The spring pulls an arm at p back by k p: a torque in the positive sense breaks it away sooner where p < 0.
    assert made.problem.values(made.x, made.problem.experiments[0])[1]["arm.shaft.angle"] == pytest.approx(
        -preload, abs=2e-4
    )
    assert scores["fitted"] < 1.0


def test_comparing_starts_where_the_recording_does(swing: Path) -> None:
    """Held out or not: the starts are fitted to the recording, as a diagnosis fits those of held-out ones."""
    for name in ("one", "two"):
        error = compare(load(swing, ["bearing.viscous_friction=0.3"]), name)
        assert error.signals["arm.shaft.angle"].nrmse > 99.9
        assert any("starting values fitted to it" in note and "rad/s" in note for note in error.notes)


def test_windows_and_resampling(tmp_path: Path) -> None:
    t = 5.0 + 0.01 * np.arange(301)
    store(tmp_path / "one.csv", t=t, y=decay(t - 5.0, 0.4, 0.0))
    store(tmp_path / "two.csv", t=t, y=decay(t - 5.0, 0.4, 0.0))
    text = PENDULUM.format(damping=0.3)
    (tmp_path / "s.yaml").write_text(
        text.replace("    time:", "    window: [5.5 s, 7 s]\n    resample: 50 ms\n    time:")
    )
    scenario = load(tmp_path / "s.yaml")
    recording = find_recording(scenario, "one")
    assert isinstance(recording, Recording)
    assert len(recording.time) == 151
    assert "151 of 301 rows lie within the window from 5.5 s to 7 s" in recording.notes[0]
    (e,) = problem(scenario, [recording]).experiments
    np.testing.assert_allclose(e.time, 0.05 * np.arange(31), atol=1e-12)
    np.testing.assert_allclose(e.measured[:, 0], decay(0.5 + e.time, 0.4, 0.0), rtol=1e-9)
    (f,) = problem(scenario, [replace(recording, resample=0.025)]).experiments
    np.testing.assert_allclose(f.time, 0.025 * np.arange(61), atol=1e-12)
    assert f.measured[1, 0] == pytest.approx((recording.measurements[0].values[2:4]).mean(), rel=1e-12)
    for key, piece in (
        ("window: [1 s, 2 s]", "the recording holds 5 s to 8 s"),
        ("window: [2 s]", "more entries"),
        ("resample: 0 s", "one.resample: 0 s is not above zero"),
        ("resample: 5 ms", "one.resample: resample is 0.005 s, where samples are 0.01 s apart"),
    ):
        with pytest.raises(FlexarmError) as caught:
            find_recording(load(tmp_path / "s.yaml", text=text.replace("    time:", f"    {key}\n    time:")), "one")
        assert piece in f"{caught.value.where}: {caught.value.message} {caught.value.remedy}"
    scenario = load(tmp_path / "s.yaml", text=text.replace("    time:", "    resample: 9 ms\n    time:"))
    recording = find_recording(scenario, "one")
    assert isinstance(recording, Recording)
    assert recording.resample == pytest.approx(9e-3)


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("{column: y, unit: count, counts_per_rev: 0}", "counts_per_rev: 0 is not above zero"),
        ("{column: y, unit: count, counts_per_rev: -4096}", "counts_per_rev: -4096 is not above zero"),
        ("{column: y, unit: rad, noise: 0}", "noise: 0 is not above zero"),
        ("{column: y, unit: rad, noise: -1 deg}", "noise: -1 deg is not above zero"),
    ],
)
def test_what_must_be_above_zero(tmp_path: Path, column: str, said: str) -> None:
    t = 0.01 * np.arange(301)
    store(tmp_path / "one.csv", t=t, y=decay(t, 0.4, 0.0))
    text = PENDULUM.format(damping=0.3).replace("{column: y, unit: rad, noise: 1e-4}", column)
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(FlexarmError) as caught:
        find_recording(load(tmp_path / "s.yaml"), "one")
    assert f"s.yaml:15: recordings.one.measurements.arm.shaft.angle.{said}" in str(caught.value)


def test_a_jitter_of_the_clock_is_told_and_ignored(tmp_path: Path) -> None:
    t = 0.01 * np.arange(301)
    store(tmp_path / "one.csv", t=t + 3e-6 * np.sin(7 * np.arange(301)), y=decay(t, 0.4, 0.0))
    (tmp_path / "s.yaml").write_text(PENDULUM.format(damping=0.3))
    recording = find_recording(load(tmp_path / "s.yaml"), "one")
    assert isinstance(recording, Recording)
    assert any("jitter" in note for note in recording.notes)
    np.testing.assert_allclose(np.diff(recording.time), recording.time[1], rtol=1e-12)


def test_a_clock_that_jitters_has_the_interval_it_was_set_to_whatever_its_last_stamp_says(tmp_path: Path) -> None:
    """Rows of a simulation then meet the samples: an acceleration beside a step of the drive is on the right side."""
    jitter = np.random.default_rng(1).uniform(-9e-6, 9e-6, 1090)
    for last in (-9e-6, 9e-6):
        jitter[[0, -1]] = 0.0, last
        time, notes = even_time(0.01 * np.arange(1090) + jitter)
        np.testing.assert_array_equal(time, 0.01 * np.arange(1090))
        assert "0.01 s apart" in notes[0]
        assert row_interval(time, 1e-3) == (1e-3, 10)


DRIVEN = """\
schema: 1
name: driven
blocks:
  source: {type: Sine, amplitude: 1 N.m, frequency: 1 Hz}
  motor: {type: Torque}
  arm: {type: Inertia, inertia: 0.5 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 0.3 N.m.s/rad}
  spring: {type: GroundSpring, stiffness: 12 N.m/rad}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, arm.shaft, bearing.shaft, spring.shaft]
simulate: {stop: 3 s, step: 10 ms}
recordings:
  period:
    file: p.dat
    time: {interval: 10 ms}
    drive: {motor.torque: {column: "[1]", unit: N.m, hold: linear}}
    measurements: {arm.shaft.angle: {column: "[2]", unit: rad, noise: 1e-4}}
    lead_in: 20
"""


def test_a_periodic_recording_is_led_in(tmp_path: Path) -> None:
    """The steady answer to a periodic torque, by harmonics, needs no free start."""
    n = 200
    t, w = 0.01 * np.arange(n), 2 * np.pi / 2.0
    u, y = np.zeros(n), np.zeros(n)
    for k, amplitude in ((1, 1.0), (3, 0.5)):
        answer = amplitude / (K - J * (k * w) ** 2 + 1j * B * k * w)
        u += amplitude * np.cos(k * w * t)
        y += (answer * np.exp(1j * k * w * t)).real
    np.savetxt(tmp_path / "p.dat", np.column_stack([u, y]))
    (tmp_path / "d.yaml").write_text(DRIVEN)
    scenario = load(tmp_path / "d.yaml")
    recording = find_recording(scenario, "period")
    assert isinstance(recording, Recording)
    assert len(recording.time) == 21 * n
    made = problem(scenario, [recording])
    residual = made.residual(np.zeros(len(made.free)), made.experiments[0]) * 1e-4
    assert (residual[: 20 * n] == 0).all()
    assert np.abs(residual).max() < 2e-3 * np.abs(y).max()
    bare = load(tmp_path / "d.yaml", text=DRIVEN.replace("    lead_in: 20\n", ""))
    start = problem(bare, [find_recording(bare, "period")])
    assert np.abs(start.residual(np.zeros(len(start.free)), start.experiments[0])).max() * 1e-4 > 0.2 * np.abs(y).max()


LOOP = """\
schema: 1
name: loop
blocks:
  wanted: {type: Step, height: 1 rad}
  controller: {type: PID, proportional_gain: 8 N.m/rad, derivative_gain: 1 N.m.s/rad, unit: N.m}
  motor: {type: Torque}
  arm: {type: Inertia, inertia: 0.5 kg.m2}
  bearing: {type: BearingFriction, viscous_friction: 0.2 N.m.s/rad}
connect:
  - [wanted.out, controller.reference]
  - [arm.shaft.angle, controller.measurement]
  - [controller.out, motor.torque]
  - [motor.shaft, arm.shaft, bearing.shaft]
simulate: {stop: 3 s, step: 10 ms}
recordings:
  run:
    file: run.csv
    time: {column: t}
    drive: {DRIVE}
    measurements: {arm.shaft.angle: {column: y, unit: rad, noise: 1e-4}}
    loop: LOOP
"""


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    """An arm under control, integrated by scipy: reference, torque and angle."""
    t = 0.01 * np.arange(301)
    kp, kd, corner = 8.0, 1.0, 100.0

    def law(time: float, state: np.ndarray) -> list[float]:
        angle, speed, filtered = state
        error = np.sin(2 * time) - angle
        torque = kp * error + kd * corner * (error - filtered)
        return [speed, (torque - 0.3 * speed) / 0.5, corner * (error - filtered)]

    found = solve_ivp(law, (0, 3), [0, 0, 0], t_eval=t, rtol=1e-10, atol=1e-12, max_step=1e-3).y
    error = np.sin(2 * t) - found[0]
    store(tmp_path / "run.csv", t=t, r=np.sin(2 * t), u=kp * error + kd * corner * (error - found[2]), y=found[0])
    return tmp_path / "run.yaml"


@pytest.mark.parametrize(
    ("kind", "drive", "known"),
    [
        ("closed", "motor.torque: {column: u, unit: N.m, hold: linear}", ("arm.inertia",)),
        (
            "reference",
            "controller.reference: {column: r, unit: rad, hold: linear}",
            (
                "arm.inertia",
                *(f"controller.{g}" for g in ("proportional_gain", "derivative_gain", "derivative_corner")),
            ),
        ),
    ],
)
def test_both_sides_of_the_loop_show_the_same_friction(
    kind: str, drive: str, known: tuple[str, ...], loop: Path
) -> None:
    """Driven by the logged torque, or by the reference with the controller simulated."""
    tolerances = ", ".join(f"{name}: 0" for name in known)
    loop.write_text(LOOP.replace("LOOP", kind).replace("DRIVE", drive) + f"tolerances: {{{tolerances}}}\n")
    made, _ = fit(loop, workers=1)
    assert made.parameters()["bearing.viscous_friction"] == pytest.approx(0.3, rel=0.02)


def test_places_in_the_loop(loop: Path) -> None:
    """Where the controller meets the plant an effect may act too."""
    reference = "controller.reference: {column: r, unit: rad, hold: linear}"
    loop.write_text(LOOP.replace("LOOP", "reference").replace("DRIVE", reference))
    scenario = load(loop)
    assert plant_inputs(scenario.system, ["controller.reference"]) == ["motor.torque"]
    assert plant_inputs(scenario.system, ["motor.torque"]) == []
    scales = operating_scales(problem(scenario, [find_recording(scenario, "run")]))
    assert set(scales.inputs) == {"controller.reference", "motor.torque"}
    assert scales.units["motor.torque"] == "N.m"


def test_a_loop_that_is_none(loop: Path) -> None:
    torque = "motor.torque: {column: u, unit: N.m}"
    loop.write_text(LOOP.replace("LOOP", "reference").replace("DRIVE", torque))
    scenario = load(loop)
    with pytest.raises(FlexarmError, match=r"'loop: reference', but motor\.torque drives no feedback loop"):
        problem(scenario, [find_recording(scenario, "run")])
    loop.write_text(LOOP.replace("LOOP", "closed").replace("    drive: {DRIVE}\n", ""))
    scenario = load(loop)
    with pytest.raises(FlexarmError, match="'loop: closed' but no drive") as caught:
        problem(scenario, [find_recording(scenario, "run")])
    assert "the plant's input" in caught.value.remedy


@pytest.mark.parametrize(
    ("column", "factor", "meant"),
    [("t", 1e3, "ms"), ("t", 1e6, "us"), ("t", 1.0, ""), ("t, unit: s", 1e3, ""), ("t, unit: ms", 1e3, "")],
)
def test_a_time_that_looks_like_another_unit_is_noted(column: str, factor: float, meant: str, swing: Path) -> None:
    t = np.arange(200) * 0.01
    store(swing.parent / "one.csv", t=factor * t, y=decay(t, 0.4, -1.0))
    text = PENDULUM.format(damping=0.2).replace("time: {column: t}", f"time: {{column: {column}}}", 1)
    notes = [note for note in find_recording(load(swing, text=text), "one").notes if "no unit is stated" in note]
    assert len(notes) == bool(meant)
    assert not meant or f"write unit: {meant} under time:" in notes[0]


def test_rows_that_are_fitted_are_not_held_out_as_well(swing: Path) -> None:
    scenario = load(swing)
    assert fit(scenario, workers=1)[0].converged
    (swing.parent / "two.csv").write_bytes((swing.parent / "one.csv").read_bytes())
    with pytest.raises(FlexarmError, match="'one', which is fitted, and 'two', which is held out, hold the same rows"):
        fit(load(swing), workers=1)
    with pytest.raises(FlexarmError, match="hold the same rows"):
        fit(scenario, ["one"], hold_out=["one"], workers=1)


def test_files_outside_the_repository(swing: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = PENDULUM.format(damping=0.2).replace("file: one.csv", "file: $FLEXARM_RECORDINGS/one.csv")
    scenario = load(swing, text=text)
    monkeypatch.delenv("FLEXARM_RECORDINGS", raising=False)
    with pytest.raises(FlexarmError, match="environment variable FLEXARM_RECORDINGS, which is not set") as caught:
        find_recording(scenario, "one")
    assert "docs/real-recordings.md" in caught.value.remedy
    found = find_recording(scenario, "two")
    assert isinstance(found, Recording)
    assert len(found.time) == 300
    monkeypatch.setenv("FLEXARM_RECORDINGS", str(swing.parent / "nowhere"))
    with pytest.raises(FlexarmError, match="which is not a folder"):
        find_recording(scenario, "one")
    monkeypatch.setenv("FLEXARM_RECORDINGS", str(swing.parent))
    found = find_recording(scenario, "one")
    assert isinstance(found, Recording)
    assert len(found.time) == 300
    with pytest.raises(FlexarmError, match=r"'\$FLEXARM_RECORDING' is not known"):
        find_recording(load(swing, text=text.replace("RECORDINGS/", "RECORDING/")), "one")


def test_an_offset_is_taken_away_and_a_source_switched_off(tmp_path: Path) -> None:
    t = 1e-2 * np.arange(100)
    store(tmp_path / "run.csv", t=t, u=1.0 + np.sin(9 * t), y=2.5 + np.cos(9 * t), on=(t < 0.5).astype(float))
    (tmp_path / "run.yaml").write_text(
        PRELOADED.replace("unit: N.m, hold: linear", "unit: mN.m, hold: linear, offset: 1, enable: on").replace(
            "unit: rad, zero: first, noise: 1e-4", "unit: deg, offset: 2500e-3 deg"
        )
    )
    found = find_recording(load(tmp_path / "run.yaml"), "run")
    assert isinstance(found, Recording)
    np.testing.assert_allclose(found.drive[0].values, np.where(t < 0.5, 1e-3 * np.sin(9 * t), 0.0), atol=1e-12)
    np.testing.assert_allclose(found.measurements[0].values, np.deg2rad(np.cos(9 * t)), atol=1e-12)


@pytest.mark.parametrize("suffix", ["json", "jsonl"])
def test_a_list_of_records_is_a_table(suffix: str, tmp_path: Path) -> None:
    """Servo loggers write one object an instant, with objects and lists in it, beside what holds for all."""
    import json

    entries = [{"stamp": 0.01 * k, "goal": {"pos": 2.0 * k}, "volts": [k, -k], "on": k < 3} for k in range(5)]
    entries[2] = {**entries[2], "note": "x"}
    lines = "\n".join(json.dumps(entry) for entry in entries)
    (tmp_path / f"a.{suffix}").write_text(lines if suffix == "jsonl" else json.dumps(entries))
    read = read_columns(tmp_path / f"a.{suffix}")
    assert read.names == ["stamp", "goal.pos", "volts[1]", "volts[2]", "on"]
    np.testing.assert_array_equal(read.number("volts[2]"), -np.arange(5.0))
    np.testing.assert_array_equal(read.number("on"), [1, 1, 1, 0, 0])
    (tmp_path / "b.json").write_text(json.dumps({"mass": 0.5, "entries": entries}))
    assert read_columns(tmp_path / "b.json").names[0] == "entries.stamp"


def test_a_band_limited_input_is_what_a_generator_sent(tmp_path: Path) -> None:
    """Sines up to 0.35 of the sampling frequency between their samples; held and straight are far off."""
    t = np.float64(0.01) * np.arange(400)

    def sent(at: np.ndarray) -> np.ndarray:
        return np.asarray(np.sin(2 * np.pi * 35 * at + 0.3) + 0.5 * np.cos(2 * np.pi * 12 * at))

    fine, values = between_samples(t, np.column_stack([sent(t), sent(t)]), ("band_limited", "zero_order"))
    inner = slice(16 * 60, -16 * 60)
    assert np.abs(values[inner, 0] - sent(fine)[inner]).max() < 2e-5
    np.testing.assert_array_equal(values[::16], np.column_stack([sent(t), sent(t)]))
    assert np.abs(values[inner, 1] - sent(fine)[inner]).max() > 1
    with pytest.raises(FlexarmError, match="not evenly spaced"):
        between_samples(np.array([0.0, 1.0, 3.0]), np.zeros((3, 1)), ("band_limited",))


def test_a_band_limited_drive_reaches_the_model(tmp_path: Path) -> None:
    """An inertia driven at a third of the sampling frequency: y = -a / (J w^2) sin(w t) beside its drift."""
    t = 1e-2 * np.arange(600)
    w = 2 * np.pi * 33.0
    u = np.sin(w * t) * np.minimum(1, t / 2)
    store(tmp_path / "run.csv", t=t, u=u, y=u)
    text = PRELOADED.replace("initial: {free: [arm.shaft.angle]}", "role: train").replace(
        "coulomb_friction: 1", "coulomb_friction: 0"
    )
    spans = []
    for hold in ("linear", "band_limited"):
        (tmp_path / "run.yaml").write_text(text.replace("hold: linear", f"hold: {hold}"))
        made = compare(load(tmp_path / "run.yaml"), "run").signals["arm.shaft.angle"].simulated
        fast = made[400:] - np.convolve(made, np.ones(50) / 50, "same")[400:]
        spans.append(float(np.std(fast[50:-50])) * np.sqrt(2) * J * w**2)
    assert spans[1] == pytest.approx(1.0, rel=0.02)
    # Straight lines hold sinc^2 of the sine and of its images, which fold back where the answer is sampled.
    images = 0.33 + np.arange(-20, 21)
    assert spans[0] == pytest.approx(float(np.sum((np.sinc(images) * 0.33 / images) ** 2)), rel=0.02)
