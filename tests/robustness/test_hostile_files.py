"""Explicit cases of foreign files, names and surroundings, by the command line: exit 1 with cause and remedy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flexarm
from blocks.controllers.input_shaper import InputShaper
from blocks.sources.multisine import Multisine
from blocks.sources.spline import Spline
from blocks.sources.trajectory import Trajectory
from diagnosis.recordings.columns import read_columns
from engine.errors import FlexarmError, ParameterError
from engine.files import json_text
from engine.system import System
from scenarios.load import load

MOTOR = """\
schema: 1
name: NAME
description: "$x_{$"
blocks:
  source: {type: Step, height: 1 V}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7,
          viscous_friction: 1e-6}
connect:
  - [source.out, motor.voltage]
simulate: {stop: 0.01 s, record: [motor.shaft.angle, motor.shaft.speed]}
analyses:
  plant: {kind: linearise, inputs: [motor.voltage], outputs: [motor.shaft.speed]}
"""


@pytest.fixture
def motor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "motor.yaml"
    path.write_text(MOTOR.replace("NAME", json.dumps("$\\undefined{a}$")))
    return path


def call(*words: object, stdout: str = "", **environment: str) -> tuple[int, str, str]:
    """Exit code, output and messages of a command in a process of its own."""
    line = [sys.executable, "-m", "flexarm", *map(str, words)]
    here = {**os.environ, **environment, "PYTHONPATH": str(Path(flexarm.__file__).parent.parent)}
    if stdout:
        with Path(stdout).open("w") as target:
            done = subprocess.run(line, stdout=target, stderr=subprocess.PIPE, env=here, check=False)
        return done.returncode, "", done.stderr.decode()
    done = subprocess.run(line, capture_output=True, env=here, check=False)
    return done.returncode, done.stdout.decode("latin-1"), done.stderr.decode()


def test_a_full_disk_is_told(motor: Path) -> None:
    code, _, said = call("blocks", stdout="/dev/full")
    assert code == 1
    assert "No space left on device" in said
    assert "Traceback" not in said
    assert "Exception ignored" not in said


def test_an_output_that_lacks_characters_gets_escapes(motor: Path) -> None:
    motor.write_text(MOTOR.replace("NAME", '"ΩΔ 机器人"'))
    for encoding in ("latin-1", "cp1252"):  # ASCII is taken for a mistake, and written as UTF-8
        code, out, said = call("check", motor, PYTHONIOENCODING=encoding)
        assert (code, said) == (0, "")
        assert "\\u03a9\\u0394 \\u673a" in out


def test_surroundings_that_are_wrong(motor: Path) -> None:
    code, _, said = call("run", motor, "--plot", "a.png", MPLBACKEND="nope", FLEXARM_CC="'cc")
    assert code == 0
    assert "FLEXARM_CC is not a command: no closing quotation" in said
    assert Path("a.png").stat().st_size > 1000


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_a_dollar_in_a_name_begins_no_formula(motor: Path, kind: str) -> None:
    code, _, said = call("run", motor, "--plot", f"a.{kind}")
    assert (code, said) == (0, "")
    assert Path(f"a.{kind}").stat().st_size > 1000


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("x" * 3000, "at most 100 characters"),
        ("a\nb", "one line"),
        ("a\x07b", "control character U+0007"),
        ("a\u202eb", "control character U+202E"),
        ("a\ufffeb", "control character U+FFFE"),
    ],
)
def test_names_that_no_file_can_hold(motor: Path, name: str, said: str) -> None:
    motor.write_text(MOTOR.replace("NAME", json.dumps(name)))
    with pytest.raises(FlexarmError) as caught:
        load(motor)
    assert said in str(caught.value)
    assert "motor.yaml:2" in str(caught.value)
    with pytest.raises(FlexarmError):
        load(motor, text=MOTOR.replace("NAME", "a").replace("motor", "m" * 101))


def test_names_of_a_system_made_in_python(motor: Path) -> None:
    from engine.assemble import build

    for system in (System({}, [], name="a\x07"), System({}, [], description="\x00")):
        with pytest.raises(FlexarmError, match="control character"):
            build(system)


@pytest.mark.parametrize("length", [240, 300, 5000])
def test_file_names_that_are_too_long(motor: Path, length: int) -> None:
    name = "a" * length
    for words in (
        ["run", f"{name}.yaml"],
        ["run", motor, "-o", f"{name}{'b' * 60}.csv"],
        ["run", motor, "--report", f"{name}{'b' * 60}.html"],
        ["compare", motor, f"{name}.csv"],
    ):
        code, _, said = call(*words)
        assert code == 1, words
        assert "Traceback" not in said
    for file in (f"{name}.csv", "a\0b.csv", "", "/dev/zero", "."):
        with pytest.raises(FlexarmError):
            read_columns(Path(file))
        with pytest.raises(FlexarmError):
            flexarm.read(file)


def test_values_out_of_all_proportion(tmp_path: Path) -> None:
    table = tmp_path / "tab.csv"
    table.write_text("time,u\n0,0\n0.001,1\n0.004,2\n0.02,3\n")
    for unit in (1e-300, 5e-324, 1e-160):
        with pytest.raises(ParameterError, match="slopes that no number can hold"):
            Spline(file=str(table), column="u", time_unit=unit)
    limits = {"velocity_limit": 1, "acceleration_limit": 5e-324, "jerk_limit": 1, "snap_limit": 1}
    with pytest.raises(ParameterError, match="out of all proportion"):
        Trajectory(end_position=1, **limits)
    with pytest.raises(ParameterError, match="first must be"):
        Multisine(base_frequency=1, first=10**40)
    for shaper in ("ZV", "ZVD"):
        with pytest.raises(ParameterError, match="samples of 1e-09 s; at most 20000"):
            InputShaper(shaper=shaper, frequency=1.0, period=1e-9)


def test_a_point_out_of_all_proportion(motor: Path) -> None:
    code, _, said = call("linearise", motor, "--at", "motor.shaft.speed=1e308", "-o", "a.json")
    assert code == 1
    assert "the rate of state 'motor.shaft.speed' is not finite" in said
    assert not Path("a.json").exists()


def test_json_holds_no_infinity() -> None:
    given = {"a": [1.0, float("inf"), (float("nan"), -float("inf"))], "b": np.float64("nan"), "c": {"d": "NaN"}}
    assert json.loads(json_text(given)) == {"a": [1.0, None, [None, None]], "b": None, "c": {"d": "NaN"}}


@pytest.mark.parametrize(
    "said", [b"{", b"[]", b"null", b'{"units": [1]}', b'{"units": {"u": 3}}', b"\xff\xfe", b"[" * 9999]
)
def test_metadata_of_another_maker_is_none_of_ours(said: bytes, tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({"t": [0.0, 1.0], "u": [1.0, 2.0]}).replace_schema_metadata({b"flexarm": said})
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    columns = read_columns(tmp_path / "a.parquet")
    assert columns.number("u").tolist() == [1.0, 2.0]
    assert columns.units == {}


def test_parquet_that_unpacks_out_of_proportion(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    zeros = pyarrow.array(np.zeros(12_000_000))
    pyarrow.parquet.write_table(pyarrow.table({"t": zeros}), tmp_path / "a.parquet", compression="gzip")
    with pytest.raises(FlexarmError, match="12000000 rows of 1 columns, out of all proportion"):
        read_columns(tmp_path / "a.parquet")


def test_a_file_that_is_no_table_is_not_repeated(tmp_path: Path) -> None:
    secret = tmp_path / "passwd"
    secret.write_text("root:x:0:0:root:/root:/bin/bash\nmail:x:8:8:mail:/var/mail:/sbin/nologin\n")
    scenario = tmp_path / "s.yaml"
    text = "schema: 1\nname: s\nblocks:\n  dut: {type: TYPE, file: passwd, column: u}\nsimulate: {stop: 1 s}\n"
    for kind in ("Table", "Spline"):
        scenario.write_text(text.replace("TYPE", kind))
        with pytest.raises(FlexarmError) as caught:
            load(scenario)
        assert "root" not in str(caught.value).replace(str(tmp_path), "")
        assert "no column of the file holds a number" in caught.value.message


def test_a_message_obeys_no_terminal() -> None:
    said = str(FlexarmError("a\x1b[31mb\u202ec\ud800", remedy="one\ntwo"))
    assert said == "a\\x1b[31mb\\u202ec\\ud800\n  one\ntwo"
