"""Comparing with recordings: units, signs, zero, gaps, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.recordings.types import Recording
from engine.errors import FlexarmError


def errors(answer: Any) -> dict[str, dict[str, float]]:
    assert answer.code == 0, answer.err
    found: dict[str, dict[str, float]] = json.loads(answer.out)["recordings"][0]["signals"]
    return found


def test_own_recording_is_met(recorded: Path, command: Callable[..., Any]) -> None:
    """Encoder counts with the wrong sign and an arbitrary zero, a tachometer in volts, time in ms, input in mV."""
    found = errors(command("compare", recorded.name, "one", "--json"))
    for name in ("motor.shaft.angle", "motor.shaft.speed"):
        assert found[name]["rmse"] < 1e-12
        assert found[name]["nrmse"] == pytest.approx(100)
    by_file = errors(command("compare", recorded.name, "one.csv", "--json"))
    assert by_file == found


def test_all_recordings_by_default(recorded: Path, command: Callable[..., Any]) -> None:
    assert errors(command("compare", recorded.name, "--json")) == errors(
        command("compare", recorded.name, "one", "--json")
    )
    text = recorded.read_text()
    recorded.write_text(text[: text.index("recordings:")])
    answer = command("compare", recorded.name)
    assert answer.code == 1
    assert "recorded describes no recordings" in answer.err


def test_check_says_that_no_input_was_recorded(recorded: Path, command: Callable[..., Any]) -> None:
    said = "no input was recorded; the scenario's own sources drive the simulation"
    assert said not in command("check", recorded.name).out
    lines = recorded.read_text().splitlines(keepends=True)
    recorded.write_text("".join(line for line in lines if "drive:" not in line))
    assert said in command("check", recorded.name).out


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("motor.shaft.sped", "names no signal"),
        ("moter.shaft.speed", "names no block"),
        ("motor.shaft", "names no signal"),
    ],
)
def test_a_measurement_of_no_signal_is_placed(
    wrong: str, message: str, recorded: Path, command: Callable[..., Any]
) -> None:
    recorded.write_text(recorded.read_text().replace("      motor.shaft.speed:", f"      {wrong}:"))
    for name in ("compare", "check"):
        answer = command(name, recorded.name)
        assert answer.code == 1
        assert f"recorded.yaml:17: recordings.one.measurements.{wrong}: '{wrong}' {message}" in answer.err


def test_a_model_that_cannot_be_built_does_not_blame_a_measurement(recorded: Path, command: Callable[..., Any]) -> None:
    text = recorded.read_text().replace("  motor:", "  push: {type: Torque}\n  motor:", 1)
    recorded.write_text(text.replace("      motor.shaft.speed:", "      motor.shaft.sped:"))
    answer = command("compare", recorded.name)
    assert answer.code == 1
    assert "'push.torque' is not connected" in answer.err
    assert "measurements" not in answer.err


def test_a_response_of_no_signal_is_placed(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("table.csv").write_text("w,y\n1,1\n2,1\n")
    Path("s.yaml").write_text(
        "schema: 1\nname: s\nblocks:\n  push: {type: Torque}\n  arm: {type: Inertia, inertia: 1}\n"
        "connect: [[push.shaft, arm.shaft]]\nrecordings:\n  table:\n    kind: frequency_response\n"
        "    file: table.csv\n    drive: push.torque\n    frequency: {column: w, unit: rad/s}\n"
        "    amplitude: {value: 1, unit: N.m}\n    response:\n      arm.shaft.sped: {column: y, unit: rad/s}\n"
    )
    answer = command("compare", "s.yaml")
    assert answer.code == 1
    assert "s.yaml:15: recordings.table.response.arm.shaft.sped: 'arm.shaft.sped' names no signal" in answer.err
    assert "did you mean 'arm.shaft.speed'?" in answer.err


def test_errors_are_what_they_say(recorded: Path, command: Callable[..., Any]) -> None:
    """rmse and nrmse = 100 (1 - |e| / |y - mean y|), against a direct computation."""
    from diagnosis.compare import compare
    from scenarios.load import load

    scenario = load(recorded, ["motor.viscous_friction=4e-6"])
    error = compare(scenario, "one").signals["motor.shaft.speed"]
    e, y = error.simulated - error.measured, error.measured
    assert error.rmse == pytest.approx(np.sqrt(np.mean(e**2)), rel=1e-12)
    assert error.nrmse == pytest.approx(100 * (1 - np.linalg.norm(e) / np.linalg.norm(y - y.mean())), rel=1e-12)
    assert 0 < error.nrmse < 99
    printed = command("compare", recorded.name, "one", "--set", "motor.viscous_friction=4e-6")
    assert f"{error.nrmse:.3f}" in printed.out
    assert "bypassed by the recorded input: source" in printed.out


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat"])
def test_results_can_be_read_back_without_a_mapping(suffix: str, recorded: Path, command: Callable[..., Any]) -> None:
    assert command("run", recorded.name, "-o", f"r.{suffix}").code == 0
    answer = command("compare", recorded.name, f"r.{suffix}")
    assert answer.code == 0, answer.err
    assert "drives motor.voltage" in answer.out
    found = errors(command("compare", recorded.name, f"r.{suffix}", "--json"))
    assert set(found) == {"motor.shaft.angle", "motor.shaft.speed"}
    assert all(signal["rmse"] < 1e-12 for signal in found.values())


def test_units_of_headers_are_heeded(recorded: Path, command: Callable[..., Any]) -> None:
    assert command("run", recorded.name, "-o", "r.csv").code == 0
    _, *lines = (recorded.parent / "r.csv").read_text().splitlines()
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    table *= [1e3, 1e3, 180 / np.pi, 30 / np.pi]
    text = ["time [ms];source.out [mV];motor.shaft.angle [deg];motor.shaft.speed [rpm];what [kg]"]
    text += [";".join(f"{value:.17g}" for value in row) + ";1" for row in table]
    (recorded.parent / "r.csv").write_text("\n".join(text))
    answer = command("compare", recorded.name, "r.csv")
    assert "what [kg] is not used" in answer.out
    found = errors(command("compare", recorded.name, "r.csv", "--json"))
    assert found["motor.shaft.speed"]["rmse"] < 1e-10
    (recorded.parent / "r.csv").write_text("\n".join(text).replace("[deg]", "[m]"))
    wrong = command("compare", recorded.name, "r.csv")
    assert wrong.code == 1
    assert "'rad' is expected" in wrong.err


def test_uneven_samples_and_gaps(recorded: Path, command: Callable[..., Any]) -> None:
    """Rows left out by ``gaps: skip`` make the time axis uneven; the simulation still meets the rest.

    A measurement without a number is not compared there, and needs no leave to be so.
    """
    lines = (recorded.parent / "one.csv").read_text().splitlines()
    t, u, _, tach = lines[20].split(",")
    lines[20] = f"{t},{u},nan,{tach}"
    t, _, enc, tach = lines[30].split(",")
    lines[30] = f"{t},nan,{enc},{tach}"
    del lines[40:43]
    (recorded.parent / "one.csv").write_text("\n".join(lines))
    refused = command("compare", recorded.name, "one")
    assert refused.code == 1
    assert "one.csv:31" in refused.err
    assert "gaps: skip" in refused.err
    answer = command("compare", recorded.name, "one", "--set", "recordings.one.gaps=skip")
    assert "1 of 98 rows hold no number and are left out: line 31" in answer.out
    assert "column 'enc' holds no number in 1 of 97 rows, where it is not compared: line 21" in answer.out
    assert "2 gaps in time" in answer.out
    found = errors(command("compare", recorded.name, "one", "--set", "recordings.one.gaps=skip", "--json"))
    assert found["motor.shaft.speed"]["rmse"] < 1e-9


def test_wrapped_angle(tmp_path: Path) -> None:
    from diagnosis.recordings.mapping import from_scenario
    from scenarios.load import load

    turns = np.linspace(0, 3, 31)
    rows = "\n".join(f"{k},{(turn * 4096) % 4096}" for k, turn in enumerate(turns))
    (tmp_path / "w.csv").write_text(f"t,enc\n{rows}\n")
    (tmp_path / "w.yaml").write_text(
        "schema: 1\nname: w\nblocks:\n  load: {type: Inertia, inertia: 1}\n"
        "recordings:\n  w:\n    file: w.csv\n    time: {column: t}\n    measurements:\n"
        "      load.shaft.angle: {column: enc, unit: count, counts_per_rev: 4096, wrap: true}\n"
    )
    recording = from_scenario(load(tmp_path / "w.yaml"), "w")
    assert isinstance(recording, Recording)
    np.testing.assert_allclose(recording.measurements[0].values, 2 * np.pi * turns, atol=1e-12)


BAD_ROWS = {
    "NaN": ("5,1000,", "5,nan,", ["one.csv:7", "column 'u'", "line 7", "gaps"]),
    "empty cell": ("5,1000,", "5,,", ["one.csv:7", "column 'u'", "line 7"]),
    "a word": ("5,1000,", "5,abc,", ["one.csv:7", "a text", "column 'u'", "nan"]),
    "a unit": ("5,1000,", "5,10 V,", ["one.csv:7", "a number with a text behind it", "column 'u'", "units"]),
    "time backwards": (
        "\n5,",
        "\n3,",
        ["one.csv:7", "time runs backwards", "column 't'", "0.003 s after 0.004 s", "sort"],
    ),
    "time stands still": ("\n5,", "\n4,", ["one.csv:7", "time stands still"]),
    "too many cells": ("5,1000,", "5,1000,7,", ["one.csv:7", "5 values", "4 columns"]),
    "missing column": ("enc", "encoder", ["recorded.yaml:16", "measurements.motor.shaft.angle.column", "'encoder'?"]),
    "twice the same column": ("t,u,", "u,u,", ["one.csv", "'u'", "rename"]),
    "no header": ("t,u,enc,tach\n", "", ["recorded.yaml:13", "one.csv", "'t'", "[1], [2], [3], [4]"]),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_bad_recording(name: str, recorded: Path, command: Callable[..., Any]) -> None:
    old, new, pieces = BAD_ROWS[name]
    path = recorded.parent / "one.csv"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    for verb in (["compare", recorded.name, "one"], ["check", recorded.name]):
        answer = command(*verb)
        assert answer.code == 1
        assert "Traceback" not in answer.err
        for piece in pieces:
            assert piece in answer.err


def test_a_word_outside_the_window_is_not_blamed_for_a_gap_inside(recorded: Path, command: Callable[..., Any]) -> None:
    path = recorded.parent / "one.csv"
    text = path.read_text()
    path.write_text(text.replace("90,0,", "90,abc,", 1).replace("5,1000,", "5,,", 1))
    recorded.write_text(recorded.read_text().replace("file: one.csv", "file: one.csv\n    window: [0 s, 0.05 s]"))
    answer = command("compare", recorded.name, "one")
    assert answer.code == 1
    assert "one.csv:7: column 'u' holds no finite number in line 7" in answer.err


@pytest.mark.parametrize(("rows", "piece"), [(0, "empty"), (1, "empty"), (2, "at least two")])
def test_too_short(rows: int, piece: str, recorded: Path, command: Callable[..., Any]) -> None:
    path = recorded.parent / "one.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:rows]))
    answer = command("compare", recorded.name, "one")
    assert answer.code == 1
    assert piece in answer.err


def test_dead_column(recorded: Path, command: Callable[..., Any]) -> None:
    path = recorded.parent / "one.csv"
    header, *lines = path.read_text().splitlines()
    path.write_text("\n".join([header, *(",".join([*line.split(",")[:2], "3", line.split(",")[3]]) for line in lines)]))
    answer = command("compare", recorded.name, "one")
    assert answer.code == 1
    for piece in ("column 'enc' is constant", "101 rows", "leave 'motor.shaft.angle' out"):
        assert piece in answer.err


BAD_MAPS = {
    "unit of the input": ("unit: mV", "unit: m", ["recorded.yaml:14", "drive.motor.voltage", "in m but"]),
    "unit of a signal": ("0.1 rad/s/V", "0.1 m/V", ["recorded.yaml:17", "motor.shaft.speed", "in m but", "scale"]),
    "unit of the time": ("unit: ms", "unit: V", ["recorded.yaml:13", "time.unit", "'s' is expected"]),
    "input": ("motor.voltage: {col", "motor.voltgae: {col", ["recorded.yaml:14", "did you mean 'motor.voltage'?"]),
    "signal": (
        "motor.shaft.speed: {",
        "motor.shaft.sped: {",
        ["recorded.yaml:17", "did you mean 'motor.shaft.speed'?"],
    ),
    "key": ("column: tach", "colum: tach", ["recorded.yaml:17", "unknown key 'colum'", "did you mean 'column'?"]),
    "file": ("one.csv", "tow.csv", ["recorded.yaml:12", "tow.csv", "did you mean 'one.csv'?"]),
    "sign": ("sign: -1", "sign: 2", ["recorded.yaml:16", "sign", "-1"]),
    "kind": ("file: one.csv", "file: one.csv\n    kind: spectrum", ["kind", "spectrum", "frequency_response"]),
}


@pytest.mark.parametrize("name", BAD_MAPS)
def test_bad_mapping(name: str, recorded: Path, command: Callable[..., Any]) -> None:
    old, new, pieces = BAD_MAPS[name]
    text = recorded.read_text()
    assert old in text
    recorded.write_text(text.replace(old, new))
    for verb in (["compare", recorded.name, "one"], ["check", recorded.name]):
        answer = command(*verb)
        assert answer.code == 1
        for piece in pieces:
            assert piece in answer.err


def test_unknown_recording(recorded: Path, command: Callable[..., Any]) -> None:
    answer = command("compare", recorded.name, "oen")
    assert answer.code == 1
    assert "did you mean 'one'?" in answer.err
    (recorded.parent / "other.csv").write_text("t,x\n0,1\n1,2\n")
    answer = command("compare", recorded.name, "other.csv")
    assert answer.code == 1
    assert "recordings:" in answer.err


def test_matlab_structures(tmp_path: Path) -> None:
    from scipy.io import savemat

    from diagnosis.recordings.columns import read_columns

    t = np.arange(5.0)
    savemat(tmp_path / "m.mat", {"run": {"t": t, "y": np.column_stack([t, 2 * t])}, "fs": 1000.0, "note": "text"})
    columns = read_columns(tmp_path / "m.mat")
    assert columns.names == ["run.t", "run.y[1]", "run.y[2]"]
    np.testing.assert_array_equal(columns.number("run.y[2]"), 2 * t)
    (tmp_path / "junk.mat").write_bytes(b"junk" * 100)
    with pytest.raises(FlexarmError, match="MATLAB"):
        read_columns(tmp_path / "junk.mat")


def test_it_warns_of_what_a_diagnosis_warns_of_and_first(recorded: Path, command: Callable[..., Any]) -> None:
    clean = command("compare", recorded.name, "one")
    assert clean.code == 0, clean.err
    assert "warning:" not in clean.out
    # The encoder was mapped with the right sign; turned round, the motion runs backwards.
    text = recorded.read_text()
    assert "sign: -1" in text
    recorded.write_text(text.replace("sign: -1", "sign: 1", 1))
    answer = command("compare", recorded.name, "one")
    assert answer.out.startswith("warning: "), answer.out
    assert "motor.shaft.angle" in answer.out.splitlines()[0]
    stated = json.loads(command("compare", recorded.name, "one", "--json").out)["warnings"]
    assert stated == [line.removeprefix("warning: ") for line in answer.out.splitlines() if line.startswith("warning")]


def test_rows_of_a_table_show_the_amplitude(tmp_path: Path, command: Callable[..., Any]) -> None:
    """A first-order lag at 1 rad/s: 20 log10 of 1 / sqrt(2) against a reading of 1."""
    (tmp_path / "table.csv").write_text("f,a,y\n1,2.5,1.767767\n1,0.5,0.5\n", encoding="utf-8")
    (tmp_path / "lag.yaml").write_text(
        """\
schema: 1
name: lag
blocks:
  source: {type: Constant, value: 0 V}
  lag: {type: LowPass, corner_frequency: 1 rad/s}
connect:
  - [source.out, lag.in]
recordings:
  table:
    kind: frequency_response
    file: table.csv
    frequency: {column: f, unit: rad/s}
    drive: lag.in
    amplitude: {column: a, unit: V}
    response: {lag.out: {column: y, unit: V}}
""",
        encoding="utf-8",
    )
    answer = command("compare", str(tmp_path / "lag.yaml"), "--rows")
    assert answer.code == 0, answer.err
    heads, *rows = [line.split() for line in answer.out.splitlines()[-3:]]
    assert heads[:3] == ["rad/s", "amplitude", "[V]"]
    assert [row[1] for row in rows] == ["2.5", "0.5"]
    assert float(rows[0][-1]) == pytest.approx(0, abs=2e-3)
    assert float(rows[1][-1]) == pytest.approx(20 * np.log10(1 / np.sqrt(2)), abs=2e-3)
