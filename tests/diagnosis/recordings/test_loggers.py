"""Formats of loggers: each written by a library of its own, read back, and compared with the numbers."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.recordings.columns import read_columns
from diagnosis.recordings.loggers import host
from engine.errors import FlexarmError

T = 0.01 * np.arange(200)
U = np.round(np.sin(9 * T), 6)
W = np.round(100 * np.cos(3 * T), 4)
X = np.column_stack([U, W, U * W])
NS = (1e9 * T).round().astype(np.int64)
START = 1_700_000_000_123_456_789
"""Of a bag's clock (ns); no float64 holds it."""


def hdf5(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        run = file.create_group("run")
        run["t"], run["u"] = T, U
        run.create_dataset("w", data=W.astype("f8"), compression="gzip").attrs["unit"] = "rad/s"
        run["x"] = X
        run["table"] = np.array(list(zip(T, W, strict=True)), dtype=[("at", "f8"), ("w", "f8")])


def matlab_7_3(path: Path) -> None:
    matio = pytest.importorskip("matio")
    matio.save_to_mat(str(path), {"run": {"t": T, "u": U, "w": W, "x": X}}, version="v7.3")


def timetable(version: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        matio, pandas = pytest.importorskip("matio"), pytest.importorskip("pandas")
        time = pandas.to_timedelta(T, unit="s").astype("timedelta64[ms]").rename("Time")
        matio.save_to_mat(str(path), {"run": pandas.DataFrame({"u": U, "w": W}, index=time)}, version=version)

    return write


def tdms(path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    wave = {"wf_increment": 0.01, "wf_start_offset": 0.0, "wf_start_time": np.datetime64("2026-01-01T00:00:00", "us")}
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("run", "u", U, {**wave, "unit_string": "V"}),
                nptdms.ChannelObject("run", "w", W, {**wave, "unit_string": "rad/s"}),
            ]
        )


def mdf(path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(U, T, name="u", unit="V"), asammdf.Signal(W, T, name="w", unit="rad/s")])
        file.append([asammdf.Signal(U[::10], T[::10], name="slow")])
        file.save(str(path), overwrite=True)


def excel(path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Logger X"])
    sheet.append(["t", "u", "w"])
    sheet.append(["s", "V", "rad/s"])
    for row in zip(T, U, W, strict=True):
        sheet.append([float(cell) for cell in row])
    book.create_sheet("empty")
    book.save(path)


JOINTS = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def mcap(path: Path, *, finish: bool = True) -> None:
    writer = pytest.importorskip("mcap_ros2.writer")
    with path.open("wb") as file:
        made = writer.Writer(file, chunk_size=4096)
        schema = made.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        number = made.register_msgdef("std_msgs/msg/Float64", "float64 data")
        for k, t in enumerate(NS.tolist()):
            now = START + t
            stamp = {"sec": (now - 5000) // 10**9, "nanosec": (now - 5000) % 10**9}
            content = {
                "header": {"stamp": stamp, "frame_id": "x"},
                "name": ["hub", "tip"],
                "position": [U[k], W[k]],
                "velocity": [],
                "effort": [],
            }
            made.write_message("/joint_states", schema, content, now, now)
            if k % 4 == 0:
                made.write_message("/command", number, {"data": U[k]}, now + 1000, now + 1000)
        if finish:
            made.finish()


def mcap_json(path: Path) -> None:
    writer = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        made = writer.Writer(file)
        made.start()
        schema = made.register_schema("any", "jsonschema", b'{"type": "object"}')
        channel = made.register_channel("run", "json", schema)
        for t, u, w in zip(NS.tolist(), U.tolist(), W.tolist(), strict=True):
            made.add_message(channel, START + t, json.dumps({"u": u, "w": w}).encode(), START + t)
        made.finish()


def rosbag(path: Path, version: int = 9) -> None:
    """By rosbags, which shares no code with the reader; of version 8 without definitions of messages."""
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    joints, header = kinds["sensor_msgs/msg/JointState"], kinds["std_msgs/msg/Header"]
    none = np.zeros(0)
    with rosbag2.Writer(path, version=version) as writer:
        connection = writer.add_connection("/joint_states", joints.__msgtype__, typestore=store)
        for k, t in enumerate(NS.tolist()):
            now = START + t
            stamp = kinds["builtin_interfaces/msg/Time"](sec=now // 10**9, nanosec=now % 10**9)
            content = joints(
                header=header(stamp=stamp, frame_id="x"),
                name=["hub", "tip"],
                position=np.array([U[k], W[k]]),
                velocity=none,
                effort=none,
            )
            writer.write(connection, now, store.serialize_cdr(content, joints.__msgtype__))


def parts(path: Path) -> None:
    """A folder with metadata, as ``ros2 bag record`` leaves it for MCAP."""
    path.mkdir()
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    mcap(path / "bag_0.mcap")


CASES: dict[str, tuple[str, Callable[[Path], None], tuple[str, str, str]]] = {
    "HDF5": ("run.h5", hdf5, ("run.t", "run.u", "run.w")),
    "columns of HDF5": ("run.hdf5", hdf5, ("run.t", "run.x[1]", "run.x[2]")),
    "a compound of HDF5": ("run.h5", hdf5, ("run.table.at", "run.u", "run.table.w")),
    "MATLAB 7.3": ("run.mat", matlab_7_3, ("run.t", "run.u", "run.w")),
    "a matrix in MATLAB 7.3": ("run.mat", matlab_7_3, ("run.t", "run.x[1]", "run.x[2]")),
    "a timetable in MATLAB 7.3": ("run.mat", timetable("v7.3"), ("run.Time", "run.u", "run.w")),
    "a timetable in MATLAB 7": ("run.mat", timetable("v7"), ("run.Time", "run.u", "run.w")),
    "TDMS": ("run.tdms", tdms, ("run.time", "run.u", "run.w")),
    "MDF": ("run.mf4", mdf, ("group1.time", "u", "w")),
    "Excel": ("run.xlsx", excel, ("t", "u", "w")),
    "MCAP": ("run.mcap", mcap, ("/joint_states.time", "/joint_states.position[1]", "/joint_states.position[2]")),
    "MCAP of JSON": ("run.mcap", mcap_json, ("run.time", "run.u", "run.w")),
    "rosbag2": ("bag", rosbag, ("/joint_states.time", "/joint_states.position[1]", "/joint_states.position[2]")),
    "rosbag2 of Humble": (
        "bag",
        lambda path: rosbag(path, 8),
        ("/joint_states.header.stamp", "/joint_states.position[1]", "/joint_states.position[2]"),
    ),
    "rosbag2 in MCAP": ("bag", parts, ("/joint_states.time", "/joint_states.position[1]", "/joint_states.position[2]")),
}


@pytest.mark.parametrize("name", CASES)
def test_what_a_library_wrote_is_read(name: str, tmp_path: Path) -> None:
    file, write, (time, first, second) = CASES[name]
    write(tmp_path / file)
    read = read_columns(tmp_path / file, like=time)
    for column, values in ((time, T), (first, U), (second, W)):
        np.testing.assert_allclose(read.number(column), values, rtol=1e-12, atol=1e-12, err_msg=column)


def test_units_clocks_and_notes_are_those_of_the_file(tmp_path: Path) -> None:
    hdf5(tmp_path / "run.h5")
    tdms(tmp_path / "run.tdms")
    mdf(tmp_path / "run.mf4")
    excel(tmp_path / "run.xlsx")
    assert read_columns(tmp_path / "run.h5").units["run.w"] == "rad/s"
    assert read_columns(tmp_path / "run.tdms").units["run.u"] == "V"
    assert "is made of the start and the increment" in " ".join(read_columns(tmp_path / "run.tdms").notes)
    assert read_columns(tmp_path / "run.mf4").units["w"] == "rad/s"
    book = read_columns(tmp_path / "run.xlsx")
    assert book.units["w"] == "rad/s"
    assert "the row under the header is taken for units" in book.notes
    assert book.rows[0] == 4


def test_a_column_of_another_clock_says_so(tmp_path: Path) -> None:
    mcap(tmp_path / "run.mcap")
    read = read_columns(tmp_path / "run.mcap", like="/joint_states.time")
    with pytest.raises(FlexarmError, match=r"(?s)'/command.data' belongs to the time '/command.time'.*files:"):
        read.number("/command.data")
    np.testing.assert_allclose(read.number("/joint_states.header.stamp"), T - 5e-6, atol=1e-12)
    other = read_columns(tmp_path / "run.mcap", like="/command.time")
    np.testing.assert_allclose(other.number("/command.time"), T[::4] + 1e-6, atol=1e-12)
    assert "'/joint_states': [1] is 'hub', [2] is 'tip'" in read.notes


def test_a_bag_whose_recorder_was_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    mcap(tmp_path / "whole.mcap")
    data = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    read = read_columns(tmp_path / "cut.mcap", like="/joint_states.time")
    assert 10 < len(read) < len(T)
    np.testing.assert_allclose(read.number("/joint_states.position[1]"), U[: len(read)])
    assert "the file ends early" in " ".join(read.notes)


DAMAGED = {name: case for name, case in CASES.items() if name in ("HDF5", "MATLAB 7.3", "TDMS", "MDF", "Excel", "MCAP")}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_files_end_in_a_message(name: str, tmp_path: Path) -> None:
    file, write, (time, *_) = DAMAGED[name]
    write(tmp_path / file)
    data = (tmp_path / file).read_bytes()
    rng = np.random.default_rng(0)
    made = [b"", b"\x80\x04cposix\nsystem\n(S'touch x'\ntR.", data[: len(data) // 3]]
    for _ in range(3):
        changed = bytearray(data)
        for place in rng.integers(0, len(data), 60):
            changed[place] = rng.integers(0, 256)
        made.append(bytes(changed))
    for k, content in enumerate(made):
        path = tmp_path / f"{k}{Path(file).suffix}"
        path.write_bytes(content)
        # What is only damaged in its numbers may be read; nothing else but a message may come of it.
        try:
            read_columns(path, like=time)
        except FlexarmError as error:
            said = str(error)
            assert path.name in said
            assert "Traceback" not in said
            assert len(said) < 600
        else:
            assert k >= 2, "no file of this format was read"


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    hdf5(tmp_path / "secret.h5")
    np.save(tmp_path / "raw.bin", W)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["t"], file["u"] = T, U
        file["link"] = h5py.ExternalLink("secret.h5", "/run/w")
        file["soft"] = h5py.SoftLink("/u")
        file.create_dataset("raw", (len(T),), dtype="f8", external=[(str(tmp_path / "raw.bin"), 128, 8 * len(T))])
        layout = h5py.VirtualLayout(shape=(len(T),), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "run/w", shape=(len(T),))
        file.create_virtual_dataset("virtual", layout)
    read = read_columns(tmp_path / "run.h5")
    assert read.names == ["t", "u"]
    assert "'link' is a link" in " ".join(read.notes)
    assert "'raw' lies in another file" in " ".join(read.notes)
    assert "'virtual' lies in another file" in " ".join(read.notes)


@pytest.mark.parametrize("kind", list(host.FORMATS))
def test_a_missing_library_is_named_with_the_command(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find(name: str, package: str | None = None) -> Any:
        return None

    monkeypatch.setattr(importlib.util, "find_spec", find)
    with pytest.raises(FlexarmError, match=rf"(?s)needs {host.FORMATS[kind].modules[0]}.*pip install 'flexarm\["):
        host.read_foreign(tmp_path / "run", kind)


def test_a_reader_that_crashes_takes_nobody_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hdf5(tmp_path / "run.h5")
    crash = [sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"]
    monkeypatch.setattr(host, "python_command", lambda _: crash)
    with pytest.raises(FlexarmError, match="its reader ended by SIGSEGV"):
        host.read_foreign(tmp_path / "run.h5", ".h5")
