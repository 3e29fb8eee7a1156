"""What is wrong with a recording is said before any search: a motor in closed form, recorded with one fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from diagnosis.api import diagnose
from diagnosis.binding import find_recording
from diagnosis.problems import problem
from diagnosis.recordings import quality
from diagnosis.verdict.recording_checks import Remark, _clipped, screen
from scenarios.load import load

R, KT, J, B = 2.6, 0.03, 2.46e-5, 1e-5
STEP = 2e-3

MOTOR = """\
schema: 1
name: motor
blocks:
  source: {type: Step, height: 0 V}
  motor: {type: DCMotor, resistance: 2.7 ohm, torque_constant: 30 mN.m/A, rotor_inertia: 4.6e-6, viscous_friction: 1e-5}
  load: {type: Inertia, inertia: 1.9e-5}
connect:
  - [source.out, motor.voltage]
  - [motor.shaft, load.shaft]
simulate: {stop: 2 s, step: 2 ms}
recordings:
"""
RECORDING = """\
  NAME:
    file: NAME.csv
    time: {column: t}
    drive: {motor.voltage: {column: u, unit: V}}
    measurements:
      motor.shaft.speed: {column: w, unit: rad/s}
      motor.shaft.angle: {column: a, unit: rad}
"""
Rows = np.ndarray


def recorded(number: int, least: float = -3, most: float = 3) -> Rows:
    """Time, a voltage of random steps, speed and angle of an exact motor, with noise."""
    random = np.random.default_rng(number)
    count = 1500
    t = STEP * np.arange(count)
    u = np.repeat(random.uniform(least, most, count // 50), 50)
    matrix = np.array([[-(KT**2 / R + B) / J, 0.0], [1.0, 0.0]])
    system = cont2discrete((matrix, np.array([[KT / R / J], [0.0]]), np.eye(2), np.zeros((2, 1))), STEP)
    w, a = dlsim(system, u)[1].T
    return np.column_stack([t, u, w + random.normal(0, 0.05, count), a + random.normal(0, 1e-3, count)])


def remarks(folder: Path, change: Callable[[Rows], Rows], text: str = MOTOR) -> list[Remark]:
    for number, name in enumerate(("one", "two")):
        columns = change(recorded(number))
        np.savetxt(folder / f"{name}.csv", columns, delimiter=",", header="t,u,w,a", comments="")
        text += RECORDING.replace("NAME", name)
    (folder / "motor.yaml").write_text(text)
    scenario = load(folder / "motor.yaml")
    return screen(problem(scenario, [find_recording(scenario, name) for name in ("one", "two")]))


def late(rows: Rows) -> Rows:
    rows[:, 1] = np.roll(rows[:, 1], 4)
    return rows[10:]


def spiked(rows: Rows) -> Rows:
    random = np.random.default_rng(5)
    rows[random.choice(len(rows), len(rows) // 50, replace=False), 2] += 60.0
    return rows


def frozen(rows: Rows) -> Rows:
    rows[400:440, 3] = rows[400, 3]
    return rows


def wrapped(rows: Rows) -> Rows:
    rows[:, 3] = np.angle(np.exp(1j * rows[:, 3]))
    return rows


def column(number: int, factor: float) -> Callable[[Rows], Rows]:
    return lambda rows: rows * np.where(np.arange(4) == number, factor, 1.0)


@pytest.mark.parametrize(
    ("change", "pieces", "grave"),
    [
        (late, ["every signal is 4 samples ahead", "drive's column is late"], True),
        (column(1, 0.5), ["every signal is 2", "logged at 0.5", "torque constant, resistance"], False),
        (column(3, 57.3), ["'motor.shaft.angle'", "degrees taken for radians"], True),
        (column(3, 1.36), ["'motor.shaft.angle'", "moves 1.36", "is one of them scaled wrongly"], True),
        (column(0, 1.02), ["'motor.shaft.angle'", "moves 0.98", "does the clock run wrong"], False),
        (spiked, ["30 of|29 of", " 1500 samples of 'motor.shaft.speed'", "spikes and were left out"], False),
        (frozen, ["'motor.shaft.angle'", "from 0.8 s to 0.8", "was the sensor stuck"], True),
        (wrapped, ["'motor.shaft.angle'", "2 pi of the logged", "does it wrap"], True),
    ],
    ids=["late", "half", "degrees", "scale", "clock", "spikes", "frozen", "wrapped"],
)
def test_each_fault_is_named(change: Callable[[Rows], Rows], pieces: list[str], grave: bool, tmp_path: Path) -> None:
    found = remarks(tmp_path, change)
    fitting = [r for r in found if all(any(p in r.text for p in piece.split("|")) for piece in pieces)]
    assert fitting, found
    assert any(r.grave for r in fitting) == grave


@pytest.mark.parametrize(
    ("signal", "scale", "met"),
    [
        ("motor.shaft.angle", 1.36, True),
        ("motor.shaft.speed", 1 / 1.36, True),
        ("motor.shaft.angle", 1.02, False),
        ("motor.shaft.angle", -1.36, False),
        ("load.shaft.angle", 1.36, False),
    ],
)
def test_a_scale_that_is_found_is_what_a_position_and_its_speed_say(
    signal: str, scale: float, met: bool, tmp_path: Path
) -> None:
    found = [r for r in remarks(tmp_path, column(3, 1.36)) if "scaled wrongly" in r.text]
    assert found
    assert all(r.is_met_by(signal, scale) == met for r in found)


@pytest.mark.parametrize(("factor", "status"), [(1.36, "tie"), (57.3, "unknown")])
def test_a_sensor_whose_scale_is_wrong_is_told_but_for_a_wrong_unit(factor: float, status: str, tmp_path: Path) -> None:
    """The recordings say so by themselves, position against speed; which of the two is wrong, the motor's tolerances
    leave open. Degrees are to be mapped, not to be modelled.
    """
    remarks(tmp_path, column(3, factor))
    (found,) = diagnose(tmp_path / "motor.yaml", workers=1).findings
    assert (found["status"], found["place"]) == (status, "motor.shaft.angle")
    assert found["indistinguishable_from"] == (["sensor_scale at motor.shaft.speed"] if status == "tie" else [])


def test_a_sensor_that_shows_no_signs_is_named_though_a_recording_runs_against_the_model(tmp_path: Path) -> None:
    """Where the motor turns backward alone, the column looks turned. An inertia that is far off makes parameters bend,
    which may hide a wrong sign, but not what was found: that says the same of the signal.
    """
    text = MOTOR.replace("inertia: 1.9e-5", "inertia: 4.4e-5")
    for name, rows in (("one", recorded(0, -3, -0.5)), ("two", recorded(1))):
        rows[:, 2] = np.abs(rows[:, 2])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,w,a", comments="")
        text += RECORDING.replace("NAME", name)
    (tmp_path / "motor.yaml").write_text(text)
    made = diagnose(tmp_path / "motor.yaml", workers=1)
    assert [(f["status"], f["effect"], f["place"]) for f in made.findings] == [
        ("named", "rectified_sensor", "motor.shaft.speed")
    ]
    assert any("runs against the model in 1 of 2 recordings" in warning for warning in made.warnings)
    assert made.study.chosen.far_off


def test_sound_recordings_of_a_model_that_is_a_little_off_give_no_remark(tmp_path: Path) -> None:
    assert remarks(tmp_path, lambda rows: rows) == []


def test_a_clock_that_only_the_dynamics_tell(tmp_path: Path) -> None:
    """A known oscillator beside its drive: 2 % is far more than its parameters are known to."""
    t = 2e-3 * np.arange(4000)
    w, z = 30.0, 0.02
    text = """\
schema: 1
name: swing
blocks:
  source: {type: Step, height: 0 N.m}
  motor: {type: Torque}
  arm: {type: Inertia, inertia: 0.01 kg.m2}
  spring: {type: GroundSpring, stiffness: 9 N.m/rad, damping: 0.012 N.m.s/rad}
connect:
  - [source.out, motor.torque]
  - [motor.shaft, arm.shaft, spring.shaft]
tolerances: {arm.inertia: 0.001, spring.stiffness: 0.001, spring.damping: 0.2}
simulate: {stop: 8 s, step: 2 ms}
recordings:
  run:
    file: run.csv
    time: {column: t}
    drive: {motor.torque: {column: u, unit: N.m}}
    measurements: {arm.shaft.angle: {column: y, unit: rad}}
"""
    random = np.random.default_rng(2)
    u = np.repeat(random.uniform(-1, 1, 40), 100)
    system = cont2discrete(
        (np.array([[0, 1], [-(w**2), -2 * z * w]]), np.array([[0], [100.0]]), np.eye(2), np.zeros((2, 1))), 2e-3
    )
    y = dlsim(system, u)[1][:, 0] + random.normal(0, 1e-4, len(t))
    for factor, there in ((1.0, False), (1.002, False), (1.02, True), (0.98, True)):
        np.savetxt(
            tmp_path / "run.csv", np.column_stack([factor * t, u, y]), delimiter=",", header="t,u,y", comments=""
        )
        (tmp_path / "swing.yaml").write_text(text)
        scenario = load(tmp_path / "swing.yaml")
        found = [r.text for r in screen(problem(scenario, [find_recording(scenario, "run")]))]
        told = [text for text in found if "is the clock right?" in text]
        assert bool(told) == there, (factor, found)
        if there:
            assert ("shorter" if factor > 1 else "longer") in told[0]


def test_a_joint_held_still_by_friction_is_not_clipped(tmp_path: Path) -> None:
    """A coarse encoder on a joint that rests at its farthest angle: it came there slowly, and the model stays there."""

    def held(rows: Rows) -> Rows:
        t = rows[:, 0]
        angle = 5 * (1 - np.cos(np.minimum(t, 1.5) * np.pi / 1.5)) / 2
        rows[:, 2], rows[:, 3] = np.gradient(angle, t), np.round(angle / 0.05) * 0.05
        return rows

    assert not any("end of its range" in r.text for r in remarks(tmp_path, held))


def test_a_coarse_encoder_is_not_clipped_and_one_at_its_end_is() -> None:
    """Within a count, a model goes beyond what was recorded; beyond a cut it goes as well, and there it tells."""
    levels = np.repeat(np.random.default_rng(1).uniform(-1.4, 1.4, 40), 12)
    swing = np.convolve(levels, np.ones(3) / 3, "same")
    for counts, cut, told in ((1, 2.0, 0), (2000, 2.0, 0), (2000, 0.8, 2), (200, 0.8, 2)):
        seen = np.round(np.clip(swing, -cut, cut) * counts) / counts
        assert len(_clipped("the angle", seen, swing)) == told, (counts, cut)


def test_clocks() -> None:
    t = np.float64(1e-3) * np.arange(4000)
    random = np.random.default_rng(0)
    assert quality.clock(t).remarks == []
    jittering = quality.clock(t + random.uniform(-2e-4, 2e-4, 4000))
    assert jittering.jitter == pytest.approx(2e-4, rel=0.1)
    assert len(jittering.remarks) == 1
    assert quality.clock(np.delete(t, [100, 200, 201])).dropped == 3
    assert quality.clock(t + t**2 / 8000).drift == pytest.approx(1e-3, rel=0.01)
    assert quality.clock(np.cumsum(random.uniform(1, 9, 500))).dropped == 0


def test_counters_that_overflow_and_edges_that_do_not() -> None:
    t = 1e-3 * np.arange(4000)
    counts = np.round(60000 * np.sin(3 * t))
    found = quality.wraps((counts + 32768) % 65536 - 32768, 1.0)
    assert found is not None
    assert found[2] == "2^16"
    for sound in (counts, np.sign(np.sin(9 * t)), np.abs(np.sin(9 * t)), np.round(np.sin(t) * 5)):
        assert quality.wraps(sound, 1.0) is None


def test_what_a_signal_moves_while_samples_are_missing_is_no_overflow() -> None:
    """2.048 counts a row, and 500 rows are missing each time: as much as a counter of ten bits."""
    rows = np.arange(4000)
    gaps = np.where(rows // 500 % 2 == 1, np.nan, np.round(2.048 * rows))
    assert quality.wraps(gaps, 1.0) is None
    sparse = np.where(rows % 3 == 0, np.round(60 * rows) % 65536, np.nan)
    found = quality.wraps(sparse, 1.0)
    assert found is not None
    assert (found[1], found[2]) == (3, "2^16")


def test_inputs_that_come_after_their_answer() -> None:
    """A random input and the answer of a known filter, whose rows are moved against it; no model is needed."""
    random = np.random.default_rng(3)
    u = np.repeat(random.normal(size=800), 5)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.95 * y[k - 1] + 0.05 * u[k - 1]
    y += random.normal(0, 1e-3, len(u))
    assert quality.early(y, [u]) == 0
    early = quality.early(y[4:], [u[:-4]])
    assert early in (3, 4)
    assert quality.early(y[:-4], [u[4:]]) == 0
    # A drive that was logged twice, or another one beside it, says no more and no less.
    assert quality.early(y[4:], [u[:-4], 3 * u[:-4]]) == early
    assert quality.early(y[4:], [random.normal(size=len(u) - 4), u[:-4]]) == early


def test_a_line_that_no_input_holds() -> None:
    t = 1e-3 * np.arange(4000)
    y = np.sin(20 * t) + np.random.default_rng(1).normal(0, 1e-3, 4000)
    assert quality.lines(y, [], 1e-3) == []
    (found,) = quality.lines(y + 5e-3 * np.sin(2 * np.pi * 400 * t), [], 1e-3)
    assert found == pytest.approx(400, abs=0.3)
