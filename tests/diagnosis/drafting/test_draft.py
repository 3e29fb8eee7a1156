"""Drafts of recordings: logs of simulated rigs whose units, signs, counters and offsets are known, and real ones."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal
import typer
from typer.testing import CliRunner

from diagnosis.compare import compare
from diagnosis.drafting.draft import draft, inserted, text
from diagnosis.drafting.log_file import look, stated_unit
from diagnosis.drafting.match import Match, Matches, _counted_alike, match
from diagnosis.recordings.paths import VARIABLE
from engine.errors import FlexarmError
from engine.simulate import Drive, simulate
from flexarm.cli import app
from flexarm.commands.record import record
from scenarios.load import Scenario, load
from scenarios.schema import TimeRecording

HEADER = "Time [ms],ch1,enc,strain (V),tacho [rpm],temp,junk"


def rig(path: Path, amplitude: float, fastest: float, *, begin: float = 1.0) -> None:
    """A log of the flexible link: square waves after a rest, an inverted 16-bit counter, strain gauge, tachometer."""
    scenario = load("quanser-single-link")
    model = scenario.build(["zone.in"], ["link.hub.angle", "link.tip.deflection", "motor.shaft.speed"])
    rng = np.random.default_rng(0)
    t = np.arange(4000) * 0.002
    phase = (t - begin) * (0.3 + (fastest - 0.3) * (t - begin) / 14)
    u = np.where(t < begin, 0.0, amplitude * np.sign(np.sin(2 * np.pi * phase)))
    made = simulate(model, t[-1], 0.002, drive=Drive(t, u[:, None], ("zero_order",)))
    counts = (70 - np.floor(made["link.hub.angle"] * 4096 / (2 * np.pi))) % 65536
    strain = 2.5 + made["link.tip.deflection"] / 0.0254 + 0.002 * rng.standard_normal(len(t))
    tacho = made["motor.shaft.speed"] * 30 / np.pi + rng.standard_normal(len(t))
    rows = np.column_stack([1000 * t + 5000, u + 0.01, counts, strain, tacho, 20 + 0 * t, rng.standard_normal(len(t))])
    np.savetxt(path, rows, "%.8g", ",", header=HEADER, comments="")


@pytest.fixture(scope="module")
def model() -> Scenario:
    return load("quanser-single-link")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("rig")
    for k, (amplitude, fastest) in enumerate([(2.0, 3.0), (4.0, 2.0), (1.0, 5.0)]):
        rig(folder / f"run{k}.csv", amplitude, fastest)
    return [folder / f"run{k}.csv" for k in range(3)]


@pytest.fixture(scope="module")
def found(model: Scenario, logs: list[Path]) -> Matches:
    return match(model, look(logs[0]))


def test_a_log_says_its_time_rest_wraps_and_noise(logs: list[Path]) -> None:
    log = look(logs[0])
    assert (log.time.column, log.time.unit, log.time.sure) == ("Time [ms]", "ms", True)
    assert log.constant == ["temp"]
    assert 480 <= log.still <= 505
    enc, tacho = log.signal("enc"), log.signal("tacho [rpm]")
    assert (enc.counts, enc.wrap, enc.rest) == (True, 65536.0, 70.0)
    assert tacho.noise == pytest.approx(1.0, rel=0.1)


def test_a_machine_no_longer_rests_once_its_command_has_changed(tmp_path: Path) -> None:
    """Though it is read to move some rows later: the mean of the command until then was taken for an offset."""
    t = np.arange(600) * 0.005
    u = np.where(t % 1 < 0.4, 4.0, -2.0)
    u[:40] = 0.0
    moved = np.floor(2e4 * np.maximum(t - t[41], 0) ** 2)
    np.savetxt(tmp_path / "log.csv", np.column_stack([t, u, moved]), "%.8g", ",", header="t,u,enc", comments="")
    log = look(tmp_path / "log.csv")
    assert log.still == 39
    assert log.signal("u").rest == 0.0


@pytest.mark.parametrize(
    ("speed", "gain", "counts"),
    [
        ("speed [rpm]", 0.891, 4096.0),
        ("speed [rpm]", 0.914, 4000.0),
        ("speed", 0.891, 4000.0),
        ("speed [rpm]", 0.3, 4000.0),
    ],
)
def test_an_encoder_moves_as_far_as_a_sensor_of_a_stated_unit_says(
    tmp_path: Path, speed: str, gain: float, counts: float
) -> None:
    """The model as given may be a tenth off; one that is three times off has another unit, and says nothing."""
    t = np.arange(300) * 0.005
    moved = np.floor(2e3 * np.sin(3 * t))
    rows = np.column_stack([t, np.cos(t), moved, 300 * np.cos(3 * t)])
    header = f"t,u,enc [counts],{speed}"
    np.savetxt(tmp_path / "log.csv", rows, "%.8g", ",", header=header, comments="")
    given = (
        Match("enc [counts]", "motor.shaft.angle", "count", 1, "", 4000.0, 1.0, 0.914, 0.0, 0, "likely"),
        Match(speed, "motor.shaft.speed", "rpm", 1, "", 0.0, 1.0, gain, 0.0, 0, "likely"),
    )
    enc, other = _counted_alike(look(tmp_path / "log.csv"), given)
    assert enc.counts_per_rev == counts
    assert enc.gain * enc.counts_per_rev == pytest.approx(0.914 * 4000)
    assert other is given[1]


COUPLED = """\
schema: 1
name: coupled
blocks:
  source: {{type: Step, height: 5 V}}
  motor: {{type: DCMotor, resistance: 2.6 ohm, torque_constant: 0.05, rotor_inertia: 2e-5}}
  coupling: {{type: SpringDamper, stiffness: 3, damping: 2e-3}}
  load: {{type: Inertia, inertia: 4e-4}}
connect: [[source.out, motor.voltage], [motor.shaft, coupling.a], [coupling.b, load.shaft]]
simulate: {{stop: 2 s, step: 2 ms, record: [{record}]}}
"""


@pytest.mark.parametrize("recorded", ["motor.shaft.angle", "load.shaft.angle"])
@pytest.mark.parametrize("column", ["angle [deg]", "motor_shaft_angle [deg]"])
def test_two_places_that_move_alike_are_both_named(recorded: str, column: str, tmp_path: Path) -> None:
    """The motor's own angle, by scipy; that the load's is what the scenario records says nothing of the sensor."""
    t, (R, k, J, c, d, M) = np.arange(1000) * 0.002, (2.6, 0.05, 2e-5, 3.0, 2e-3, 4e-4)
    A = np.array(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-c / J, c / J, -(d + k * k / R) / J, d / J], [c / M, -c / M, d / M, -d / M]]
    )
    plant = scipy.signal.StateSpace(A, np.array([[0], [0], [k / R / J], [0]]), np.eye(4), np.zeros((4, 1)))
    u = np.where(t < 0.2, 0.0, np.where(t % 0.7 < 0.35, 5.0, -4.0))
    states = scipy.signal.lsim(plant, u, t, interp=False)[1]
    rows = np.column_stack([t, u, np.degrees(states[:, 0])])
    np.savetxt(tmp_path / "log.csv", rows, "%.8g", ",", header=f"t,u [V],{column}", comments="")
    (tmp_path / "rig.yaml").write_text(COUPLED.format(record=recorded))
    (row,) = match(load(tmp_path / "rig.yaml"), look(tmp_path / "log.csv")).measurements
    places = ("motor.shaft.angle", "coupling.a.angle"), ("load.shaft.angle", "coupling.b.angle")
    if column.startswith("motor"):
        assert (row.end, row.sure, row.elsewhere) == ("motor.shaft.angle", "sure", ())
    else:
        (other,) = row.elsewhere
        assert row.end == recorded
        assert other in places[1 - (recorded in places[1])]
        assert row.sure == "likely"
        assert f"follows {other} as closely" in row.evidence


def test_columns_are_told_apart_by_the_model(found: Matches) -> None:
    (drive,) = found.drive
    assert (drive.column, drive.end, drive.unit, drive.sign) == ("ch1", "zone.in", "V", 1)
    rows = {row.column: row for row in found.measurements}
    enc, strain, tacho = rows["enc"], rows["strain (V)"], rows["tacho [rpm]"]
    assert (enc.end, enc.unit, enc.counts_per_rev, enc.sign) == ("link.hub.angle", "count", 4096, -1)
    assert (strain.end, strain.unit, strain.sign) == ("link.tip.deflection", "V", 1)
    assert float(strain.scale.split()[0]) == pytest.approx(0.0254, rel=0.01)
    assert strain.scale.endswith(" m/V")
    assert (tacho.end, tacho.unit, tacho.sign) == ("motor.shaft.speed", "rpm", 1)
    assert tacho.sure == "sure"
    assert found.unused == ("junk",)


def test_the_draft_is_a_scenario_that_fits(model: Scenario, logs: list[Path], found: Matches, tmp_path: Path) -> None:
    made = draft(model, [look(path) for path in logs], found)
    # The strongest is fitted.
    assert [entry.role for entry in made.entries] == ["hold_out", "train", "train"]
    (tmp_path / "drafted.yaml").write_text(inserted(model.path.read_text(), text(made, tmp_path)))
    drafted = load(tmp_path / "drafted.yaml")
    for name in drafted.recordings:
        comparison = compare(drafted, name)
        assert all(signal.nrmse > 99 for signal in comparison.signals.values()), name


def test_one_file_is_cut_in_two(model: Scenario, logs: list[Path], found: Matches) -> None:
    made = draft(model, [look(logs[0])], found)
    first, later = made.entries
    assert (first.role, later.role) == ("train", "hold_out")
    assert first.window is not None
    assert later.window is not None
    assert first.window[1] == later.window[0]
    assert "{state: as_measured}" in text(made, logs[0].parent)


def test_long_rests_are_cut_off(model: Scenario, found: Matches, tmp_path: Path) -> None:
    rig(tmp_path / "late.csv", 2.0, 3.0, begin=5.0)
    log = look(tmp_path / "late.csv")
    made = draft(model, [log, log], found)
    assert made.entries[0].window is not None
    # The file's clock begins at 5 s, and the motion 5 s later.
    assert 9.0 < made.entries[0].window[0] < 9.6


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("angle [deg]", "deg"),
        ("speed (rad/s)", "rad/s"),
        ("motor_rpm", "rpm"),
        ("u_mV", "mV"),
        ("enc counts", "count"),
        ("x [furlongs_]", ""),
        ("position", ""),
        ("torque_Nm", "N.m"),
    ],
)
def test_units_in_names(name: str, unit: str) -> None:
    assert stated_unit(name, {}) == unit


TIMES: list[tuple[str, Any, str]] = [
    ("stamp", 1.7e18 + 2e6 * np.arange(100), "ns"),
    ("t", 0.002 * np.arange(100), "s"),
    ("x", 2.0 * np.arange(100), "ms"),
    ("time_us", 2000.0 * np.arange(100), "us"),
]


@pytest.mark.parametrize(("name", "values", "unit"), TIMES)
def test_times_in_every_unit(name: str, values: Any, unit: str, tmp_path: Path) -> None:
    rows = np.column_stack([np.arange(100), values, np.sin(0.1 * np.arange(100))])
    np.savetxt(tmp_path / "a.csv", rows, "%.18g", ",", header=f"sample,{name},y", comments="")
    log = look(tmp_path / "a.csv")
    assert (log.time.column, log.time.unit) == (name, unit)
    assert log.time.seconds[-1] == pytest.approx(99 * 0.002, rel=1e-5)


def test_a_file_without_time_says_what_to_give(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", np.random.default_rng(0).normal(size=(50, 2)), "%g", ",", header="a,b", comments="")
    with pytest.raises(FlexarmError, match=r"(?s)no column.*increases.*--interval"):
        look(tmp_path / "a.csv")
    assert look(tmp_path / "a.csv", interval=0.01).time.seconds[-1] == pytest.approx(0.49)


SECTIONS = {
    "none": ("a: 1\n", "a: 1\n\nrecordings:\n  new:\n    x: 1\n"),
    "before others": (
        "recordings:\n    old:\n      x: 0\n\n# next\nb: 2\n",
        "recordings:\n    old:\n      x: 0\n    new:\n      x: 1\n\n# next\nb: 2\n",
    ),
}


@pytest.mark.parametrize("case", SECTIONS)
def test_entries_are_put_behind_those_that_are_there(case: str) -> None:
    source, wanted = SECTIONS[case]
    assert inserted(source, "  new:\n    x: 1\n") == wanted


def test_the_command_writes_a_scenario_and_says_what_it_left_out(logs: list[Path], tmp_path: Path) -> None:
    given = ["record", *map(str, logs), "-m", "quanser-single-link", "--yes", "-o", str(tmp_path / "s.yaml")]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 0, done.output
    assert "not used: junk" in done.stderr
    assert "needs a hand" not in done.stderr
    assert list(load(tmp_path / "s.yaml").recordings) == ["run0", "run1", "run2"]


def test_the_command_asks_in_a_terminal(logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter(["", "motor.voltage", "-", "", "link.tip.deflection", "gear.input.speed rad/s", "source.outt", ""])
    asked: list[str] = []

    def prompt(question: str, **_: object) -> str:
        asked.append(question)
        return next(answers)

    monkeypatch.setattr(typer, "prompt", prompt)
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    record([logs[0]], "quanser-single-link", output=tmp_path / "s.yaml")
    made = load(tmp_path / "s.yaml").recordings["run0"]
    assert isinstance(made, TimeRecording)
    assert {end: row.column for end, row in made.drive.items()} == {"motor.voltage": "ch1"}
    assert {end: (row.column, row.unit) for end, row in made.measurements.items()} == {
        "link.tip.deflection": ("strain (V)", "V"),
        "gear.input.speed": ("tacho [rpm]", "rad/s"),
    }
    assert next(answers, None) is None
    assert "'junk' is not used" in asked[-1]


def test_a_file_that_is_given_twice_is_refused(logs: list[Path]) -> None:
    twice = [str(logs[0]), str(logs[0].parent / "." / logs[0].name)]
    answer = CliRunner().invoke(app, ["record", *twice, "-m", "quanser-single-link", "--yes"])
    assert isinstance(answer.exception, FlexarmError)
    assert "run0.csv' is given twice" in str(answer.exception)


def test_without_a_terminal_it_wants_yes(logs: list[Path]) -> None:
    with pytest.raises(FlexarmError, match=r"(?s)no terminal.*--yes"):
        CliRunner().invoke(app, ["record", str(logs[0]), "-m", "quanser-single-link"], catch_exceptions=False)


@pytest.mark.skipif(VARIABLE not in os.environ, reason=f"{VARIABLE} is not set")
def test_a_real_axis_whose_columns_state_no_units() -> None:
    log = look(Path(os.environ[VARIABLE]) / "emps" / "DATA_EMPS.mat")
    found = match(load("emps-open-loop"), log)
    (drive,), (measured,) = found.drive, found.measurements
    assert (drive.column, drive.end, drive.unit, drive.sign) == ("vir", "motor.force", "1", 1)
    # Of volts into force 35.15 N/V are published; the model lacks the dry friction, which takes half of it.
    assert 10 < float(drive.scale.split()[0]) < 36
    assert drive.sure != "sure"
    assert (measured.column, measured.end, measured.unit, measured.sign) == ("qm", "carriage.flange.position", "m", 1)


@pytest.mark.skipif(VARIABLE not in os.environ, reason=f"{VARIABLE} is not set")
def test_a_real_damper_whose_columns_have_no_names() -> None:
    """Displacement in inches, force in thousands of pounds; by the source's description columns 2 and 3."""
    log = look(Path(os.environ[VARIABLE]) / "brfd_friction_backlash" / "dataset-1_0.5Hz20lbtension.json")
    found = match(load("friction-damper"), log)
    (drive,) = found.drive
    assert (log.time.column, drive.column, drive.end) == ("data[1]", "data[2]", "actuator.position")
    assert {row.column: row.end for row in found.measurements}["data[3]"] == "actuator.force"


def test_topics_of_a_bag_are_told_apart_and_joined(model: Scenario, logs: list[Path], tmp_path: Path) -> None:
    """The command in one topic at half the rate of the sensors' in another, as a bag holds them."""
    h5py = pytest.importorskip("h5py")
    rows = np.loadtxt(logs[0], delimiter=",", skiprows=1)
    with h5py.File(tmp_path / "bag.h5", "w") as file:
        for group, part, columns in (("cmd", rows[::2], {"data": 1}), ("state", rows, {"enc": 2, "tacho_rpm": 4})):
            made = file.create_group(group)
            made["time"] = part[:, 0] / 1000
            for name, k in columns.items():
                made[name] = part[:, k]
    log = look(tmp_path / "bag.h5")
    assert log.time.column == "state.time"
    found = match(model, log)
    assert [row.column for row in found.drive] == ["cmd.data"]
    assert {row.column: row.end for row in found.measurements} == {
        "state.enc": "link.hub.angle",
        "state.tacho_rpm": "motor.shaft.speed",
    }
    (tmp_path / "s.yaml").write_text(inserted(model.path.read_text(), text(draft(model, [log, log], found), tmp_path)))
    drafted = load(tmp_path / "s.yaml")
    assert compare(drafted, "bag").signals["link.hub.angle"].nrmse > 97
