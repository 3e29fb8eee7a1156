"""Several files of one recording: each with its own clock, joined on that of the first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.recordings.alignment import align
from diagnosis.recordings.mapping import from_scenario
from diagnosis.recordings.types import Recording
from engine.errors import FlexarmError
from scenarios.load import load

SCENARIO = """\
schema: 1
name: joined
blocks:
  source: {type: Torque}
  arm: {type: Inertia, inertia: 0.5 kg.m2}
connect:
  - [source.shaft, arm.shaft]
recordings:
  one:
    file: drive.csv
    time: {column: t}
    files:
      - FURTHER
    drive: {source.torque: {column: DRIVE, unit: N.m, hold: zero_order}}
    measurements:
      arm.shaft.angle: {column: MEASURED, unit: deg WRAP}
"""
OFFSET, RATE = 3.2137, 1.0004
A = 0.001 * np.arange(20001)
"""Time of the leading file, s."""
B = 0.01 * np.arange(1400) + 0.0033
"""Of the camera, on its own clock."""


def angle(t: np.ndarray) -> np.ndarray:
    """A motion that repeats nowhere, deg."""
    found: np.ndarray = 40 * np.sin(2.1 * t + 0.3 * np.sin(0.7 * t)) + 15 * np.sin(5.3 * t + t**2 / 15) + 2 * t
    return found


def torque(t: np.ndarray) -> np.ndarray:
    """Steps of a command."""
    found: np.ndarray = np.round(3 * np.sin(1.3 * t + t**2 / 30))
    return found


def store(path: Path, **columns: Any) -> None:
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(f"{x:.12g}" for x in row) for row in rows)]) + "\n")


def read(folder: Path, further: str, drive: str = "u", measured: str = "x", wrap: str = "") -> Recording:
    text = SCENARIO.replace("FURTHER", further).replace("DRIVE", drive).replace("MEASURED", measured)
    (folder / "joined.yaml").write_text(text.replace(" WRAP", wrap))
    made = from_scenario(load(folder / "joined.yaml"), "one")
    assert isinstance(made, Recording)
    return made


@pytest.fixture
def files(tmp_path: Path) -> Path:
    rng = np.random.default_rng(3)
    store(tmp_path / "drive.csv", t=A, u=torque(A), enc=angle(A) + 0.05 * rng.standard_normal(len(A)))
    seen = angle(OFFSET + RATE * B)
    store(tmp_path / "camera.csv", t=B, x=seen, y=-seen, w=(seen + 20) % 40 - 20, n=rng.standard_normal(len(B)))
    return tmp_path


STATED = f"{{file: camera.csv, time: {{column: t}}, offset: {OFFSET} s, rate: {RATE}}}"
SOUGHT = "{file: camera.csv, time: {column: t}, offset: auto, rate: auto, alike: {column: x, to: enc}}"


def test_samples_of_a_slower_file_go_to_the_nearest_instants_once(files: Path) -> None:
    made = read(files, STATED)
    values, there = np.degrees(made.measurements[0].values), np.isfinite(made.measurements[0].values)
    assert len(B) - 2 <= there.sum() <= len(B)  # the first and the last may fall beyond what was measured
    np.testing.assert_allclose(values[there], angle(np.asarray(made.time)[there]), atol=2e-4)


@pytest.mark.parametrize("column", ["x", "y"])
def test_offset_and_rate_are_found_and_told(files: Path, column: str) -> None:
    made = read(files, SOUGHT.replace("column: x", f"column: {column}"))
    values, there = np.degrees(made.measurements[0].values), np.isfinite(made.measurements[0].values)
    # A millisecond of this motion is 0.15 deg.
    assert np.abs(values[there] - angle(np.asarray(made.time)[there])).max() < 0.1
    told = [note for note in made.notes if "its clock begins" in note]
    assert len(told) == 1
    assert f"'{column}' with 'enc'" in told[0]
    offset = float(told[0].split("begins ")[1].split(" s after")[0])
    rate = float(told[0].split("runs at ")[1].split(" of the")[0])
    assert offset == pytest.approx(OFFSET, abs=1e-3)
    assert rate == pytest.approx(RATE, abs=1e-4)


def test_a_wrapped_column_is_made_continuous_before_it_is_moved(files: Path) -> None:
    made = read(files, STATED, measured="w", wrap=", wrap: 40 deg")
    values, there = np.degrees(made.measurements[0].values), np.isfinite(made.measurements[0].values)
    apart = values[there] - angle(np.asarray(made.time)[there])
    assert np.ptp(apart) < 1e-3


def test_a_drive_of_a_further_file_is_held_and_the_recording_cut_to_it(tmp_path: Path) -> None:
    own = 0.005 * np.arange(1000)
    store(tmp_path / "drive.csv", t=A, x=angle(A))
    store(tmp_path / "command.csv", stamp=1e3 * own, u=torque(own))
    made = read(tmp_path, "{file: command.csv, time: {column: stamp, unit: ms}, offset: 2 s}")
    assert made.time[-1] == pytest.approx(own[-1], abs=0.006)
    place = np.floor(np.asarray(made.time) / 0.005 + 1e-6).astype(int)
    np.testing.assert_array_equal(made.drive[0].values, torque(own)[np.minimum(place, 999)])
    assert any("before or after what the drive's file holds" in note for note in made.notes)


def test_a_faster_file_gives_each_instant_its_value(tmp_path: Path) -> None:
    store(tmp_path / "drive.csv", t=A[::20], u=torque(A[::20]))
    store(tmp_path / "camera.csv", t=A + 0.0004, x=angle(A + 0.0004))
    made = read(tmp_path, "{file: camera.csv, time: {column: t}}")
    values = np.degrees(made.measurements[0].values)
    np.testing.assert_allclose(values[1:], angle(A[::20])[1:], atol=1e-5)


WRONG = [
    ("{file: camera.csv, time: {column: t}, offset: auto}", "u", "alike: {column: x, to: position}"),
    (SOUGHT.replace("column: x,", "column: n,"), "u", r"'n' with 'enc' agrees by 0\.\d\d at best"),
    (SOUGHT.replace("to: enc", "to: encc"), "u", "(?s)no column 'encc'.*enc"),
    (STATED.replace(str(RATE), "-1"), "u", "a rate of -1"),
    (STATED.replace("camera.csv", "cam.csv"), "u", "(?s)no recording.*camera.csv"),
    (STATED.replace(str(OFFSET), "300"), "x", "no time in common"),
    (STATED, "t", "(?s)'t' is a column of several files.*name: camera"),
    (STATED, "uu", "(?s)no file of the recording has a column 'uu'"),
]


@pytest.mark.parametrize(("further", "drive", "said"), WRONG)
def test_what_cannot_be_joined_is_said(files: Path, further: str, drive: str, said: str) -> None:
    with pytest.raises(FlexarmError, match=said):
        read(files, further, drive=drive, measured="y" if drive == "x" else "x")


def test_a_named_file_gives_names_to_its_columns(files: Path) -> None:
    made = read(files, STATED.replace("{file", "{name: camera, file"), measured="camera.x")
    assert np.isfinite(made.measurements[0].values).sum() > 0.99 * len(B)


def test_a_motion_that_repeats_itself_has_a_rival() -> None:
    t = np.linspace(0, 29.99, 3000)
    found = align(t, np.sin(6 * t), t[:1000], np.sin(6 * t[:1000] + 1))
    assert found is not None
    assert found.rival > 0.97


def test_topics_of_one_bag_are_joined_by_themselves(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "bag.h5", "w") as file:
        for group, time, name, values in (("cmd", A[::5], "u", torque(A[::5])), ("state", A[::2], "x", angle(A[::2]))):
            made = file.create_group(group)
            made["time"], made[name] = time, values
    text = SCENARIO.replace("drive.csv", "bag.h5").replace("column: t}", "column: cmd.time}")
    text = text.replace("    files:\n      - FURTHER\n", "").replace("DRIVE", "cmd.u").replace("MEASURED", "state.x")
    (tmp_path / "joined.yaml").write_text(text.replace(" WRAP", ""))
    joined = from_scenario(load(tmp_path / "joined.yaml"), "one")
    assert isinstance(joined, Recording)
    np.testing.assert_allclose(np.degrees(joined.measurements[0].values), angle(A[::5]), atol=1e-6)
    assert "columns of the clock 'state.time' are joined on time" in joined.notes
