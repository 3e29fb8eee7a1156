"""Reads a file of a foreign format in a child process: a crash of its library, or a full memory, ends that alone."""

from __future__ import annotations

import importlib.util
import json
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.recordings.loggers.found import MOST_CELLS, Found
from engine.child_process import ending, environment, python_command
from engine.readers.regular import opened, problem

LARGEST = 4_000_000_000
"""Bytes of a file."""


@dataclass(frozen=True)
class Format:
    """A foreign format.

    Attributes:
        title: for messages.
        extra: of flexarm that installs its reader.
        modules: that reading it imports.
        module: of this package that reads it.
    """

    title: str
    extra: str
    modules: tuple[str, ...]
    module: str


_ROS = ("mcap", "mcap_ros2", "rosbags")
_HDF = Format("HDF5 file", "hdf5", ("h5py",), "hdf5")
_MDF = Format("MDF file", "mdf", ("asammdf",), "mdf")
_EXCEL = Format("Excel workbook", "excel", ("openpyxl",), "excel")
FORMATS = {
    ".mcap": Format("MCAP file", "ros", _ROS, "ros"),
    ".db3": Format("rosbag2 file", "ros", _ROS, "ros"),
    "rosbag2": Format("rosbag2 folder", "ros", _ROS, "ros"),
    ".h5": _HDF,
    ".hdf5": _HDF,
    ".hdf": _HDF,
    ".mf4": _MDF,
    ".mdf": _MDF,
    ".tdms": Format("TDMS file", "tdms", ("nptdms",), "tdms"),
    ".xlsx": _EXCEL,
    ".xlsm": _EXCEL,
    "matlab": Format("MATLAB file of version 7.3, or with tables,", "matlab", ("matio", "h5py"), "matlab"),
}
"""By ending, or by name where the ending is another format's too."""


def installed(kind: str) -> bool:
    """Whether the libraries that read a format are there."""
    return not _missing(FORMATS[kind])


def _missing(form: Format) -> list[str]:
    return [name for name in form.modules if importlib.util.find_spec(name) is None]


def read_foreign(path: Path, kind: str) -> Found:
    """The columns of a file.

    Args:
        path: the file; of a rosbag2, the folder.
        kind: a key of `FORMATS`.

    Raises:
        FileProblem: the library is not installed, or the file cannot be read.
    """
    form = FORMATS[kind]
    if missing := _missing(form):
        raise problem(
            path,
            f"reading this {form.title} needs {' and '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} "
            "not installed",
            f"pip install 'flexarm[{form.extra}]'",
        )
    if kind != "rosbag2":
        opened(path, LARGEST).close()
    said = path.stat()
    return _read(path.resolve(), kind, said.st_mtime_ns, said.st_size)


@lru_cache(maxsize=4)
def _read(path: Path, kind: str, *_: int) -> Found:
    """As `read_foreign`; what was read last is kept, since recordings of one bag are read one after the other."""
    form = FORMATS[kind]
    command = python_command("from diagnosis.recordings.loggers.child import main; main()")
    # HDF5 would load any library that this folder holds as a filter.
    settings = environment() | {"HDF5_PLUGIN_PATH": "::", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    asked = json.dumps({"module": form.module, "path": str(path)}).encode()
    done = subprocess.run(
        command, input=asked, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=settings, check=False
    )
    head, _newline, body = done.stdout.partition(b"\n")
    try:
        said = json.loads(head)
    except ValueError:
        raise problem(
            path,
            f"the {form.title} cannot be read: its reader ended {ending(done.returncode)}",
            "it is damaged, or larger than the memory; save it anew, or a part of it as .csv or .parquet",
        ) from None
    if "error" in said:
        message, remedy = said["error"]
        raise problem(path, f"the {form.title} cannot be read: {message}", remedy)
    return _unpacked(path, said, body)


def _unpacked(path: Path, said: dict[str, Any], body: bytes) -> Found:
    """What the child sent, whose sizes must be what it says."""
    lengths = [int(length) for length in said["lengths"]]
    if min(lengths, default=0) < 0 or sum(lengths) > MOST_CELLS or 8 * sum(lengths) != len(body):
        raise problem(path, "its reader ended early", "try again, or save it as .csv or .parquet")
    numbers = np.frombuffer(body, np.float64)
    parts = np.split(numbers, np.cumsum(lengths)[:-1]) if lengths else []
    odd = {name: (int(row), str(what), str(remedy)) for name, (row, what, remedy) in said["odd"].items()}
    return Found(
        dict(zip(said["names"], parts, strict=True)), said["clocks"], said["units"], odd, said["notes"], said["rows"]
    )
