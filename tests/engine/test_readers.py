"""The readers of foreign files: against scipy on sound files, and without harm on damaged ones."""

from __future__ import annotations

import os
import random
import struct
import tracemalloc
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.io.matlab
from scipy.sparse import csc_matrix

from engine.readers.matlab import MOST_ARRAYS, read_mat, simplified
from engine.readers.objects import read_json
from engine.readers.regular import FileProblem, content
from engine.readers.text import AT_ONCE, read_plain, read_table

COLLECTION = Path(scipy.io.matlab.__file__).parent / "tests" / "data"
"""MATLAB files of versions 4.2 to 8 that come with scipy, some of them damaged on purpose."""

DAMAGED = {
    "bad_miuint32.mat",
    "corrupted_zlib_checksum.mat",
    "corrupted_zlib_data.mat",
    "debigged_m4.mat",
    "malformed1.mat",
    "nasty_duplicate_fieldnames.mat",
    "testhdf5_7.4_GLNX86.mat",
}


def alike(ours: Any, theirs: Any) -> bool:
    """Whether two readers mean the same; dimensions of length one and numeric types aside."""
    if ours is None:
        return True
    if isinstance(ours, dict):
        return ours.keys() == theirs.keys() and all(alike(ours[key], theirs[key]) for key in ours)
    if isinstance(ours, str):
        return str(theirs) == ours if np.ndim(theirs) == 0 else ours == "" and np.size(theirs) == 0
    if isinstance(ours, list):
        return [str(text).rstrip() for text in np.atleast_1d(theirs)] == [text.rstrip() for text in ours]
    if ours.dtype.kind == "O":
        flat = list(np.asarray(theirs, dtype=object).ravel()) if not isinstance(theirs, list) else theirs
        return len(flat) == ours.size and all(alike(a, b) for a, b in zip(ours.ravel(), flat, strict=True))
    return (
        np.shape(theirs) == ours.shape or ours.size == np.size(theirs) == 0
        if ours.size == 0
        else bool(np.array_equal(ours, theirs, equal_nan=ours.dtype.kind in "fc"))
    )


def both(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = scipy.io.loadmat(path, simplify_cells=True)
    return simplified(read_mat(path)), {key: value for key, value in theirs.items() if not key.startswith("__")}


SOUND = [
    path
    for path in sorted(COLLECTION.glob("*.mat"))
    if path.name not in DAMAGED
    # scipy itself refuses the first; the others hold functions and objects, whose insides it shows and we do not.
    and path.name != "bad_miutf8_array_name.mat"
    and not path.name.startswith(("testobject", "testfunc", "some_functions", "testsparse"))
]


@pytest.mark.skipif(not COLLECTION.is_dir(), reason="this scipy comes without its tests")
@pytest.mark.parametrize("path", SOUND, ids=lambda path: path.stem)
def test_matlab_files_are_read_as_by_scipy(path: Path) -> None:
    ours, theirs = both(path)
    assert ours.keys() == theirs.keys()
    for name in ours:
        assert alike(ours[name], theirs[name]), (name, ours[name], theirs[name])


@pytest.mark.skipif(not COLLECTION.is_dir(), reason="this scipy comes without its tests")
@pytest.mark.parametrize("name", sorted(DAMAGED))
def test_damaged_files_of_the_collection_are_refused(name: str) -> None:
    with pytest.raises(FileProblem) as caught:
        read_mat(COLLECTION / name)
    assert caught.value.remedy


EVERYTHING: dict[str, Any] = {
    "t": np.linspace(0, 1, 7),
    "column": np.arange(5.0)[:, None],
    "matrix": np.arange(12.0).reshape(3, 4),
    "cube": np.arange(24, dtype=np.int16).reshape(2, 3, 4),
    "whole": np.array([[2**53 + 1, -(2**62)]]),
    "bytes": np.arange(200, dtype=np.uint8),
    "half": np.array([1.5, np.nan, np.inf], dtype=np.float32),
    "flags": np.array([True, False, True]),
    "waves": np.exp(1j * np.arange(4.0)),
    "empty": np.zeros((0, 3)),
    "word": "torque µ in N·m",
    "words": np.array(["one", "two", "three"], dtype=object),
    "log": {"time": np.arange(3.0), "unit": "s", "inner": {"x": 1.0}},
    "several": np.array([{"x": 1.0}, {"x": np.arange(2.0)}], dtype=object),
    "long_name_" * 6: 1.0,
}


@pytest.mark.parametrize("packed", [False, True])
def test_what_scipy_writes_is_read(packed: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, EVERYTHING, do_compression=packed, long_field_names=True)
    ours, theirs = both(path)
    assert ours.keys() == theirs.keys() == EVERYTHING.keys()
    for name in ours:
        assert alike(ours[name], theirs[name]), name
    assert ours["whole"].tolist() == EVERYTHING["whole"].ravel().tolist()
    assert read_mat(path)["column"].shape == (5, 1)


def test_version_4_and_sparse(tmp_path: Path) -> None:
    numbers = {"a": np.arange(6.0).reshape(2, 3), "s": "text", "c": np.array([[1 + 2j]])}
    scipy.io.savemat(tmp_path / "a.mat", numbers, format="4")
    ours, theirs = both(tmp_path / "a.mat")
    assert ours.keys() == theirs.keys()
    assert all(alike(ours[name], theirs[name]) for name in ours)
    scipy.io.savemat(tmp_path / "b.mat", {"s": csc_matrix(np.eye(3)), "x": 1.0})
    assert read_mat(tmp_path / "b.mat")["s"] is None


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def matrix(kind: int, shape: tuple[int, ...], body: bytes, name: bytes = b"x", flags: int = 0) -> bytes:
    head = element(6, struct.pack("<II", kind | flags, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, head + element(1, name) + body)


def mat_file(path: Path, *elements: bytes) -> Path:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements))
    return path


def packed(data: bytes) -> bytes:
    squeezed = zlib.compress(data, 9)
    return struct.pack("<II", 15, len(squeezed)) + squeezed


TEN = element(9, np.arange(10.0).tobytes())


def nested(levels: int) -> bytes:
    made = matrix(6, (1, 10), TEN)
    for _ in range(levels):
        made = matrix(1, (1, 1), made, b"")
    return made


HOSTILE = {
    "type 100": matrix(6, (1, 10), element(100, b"\0" * 80)),
    "a class of its own": matrix(77, (1, 10), TEN),
    "2^28 cells": matrix(1, (1 << 14, 1 << 14), b""),
    "2^28 cells, packed": packed(matrix(1, (1 << 14, 1 << 14), b"")),
    "2^28 structures without fields": matrix(2, (1 << 28, 1), element(5, struct.pack("<i", 8)) + element(1, b"")),
    "2^62 numbers": matrix(6, (2**31 - 1, 2**31 - 1), TEN),
    "negative dimensions": matrix(6, (-1, -10), TEN),
    "one dimension": matrix(6, (10,), TEN),
    "fewer numbers than it says": matrix(6, (1, 11), TEN),
    "an element longer than the file": struct.pack("<II", 14, 2**32 - 1) + b"\0" * 64,
    "a small element of 60000 bytes": element(14, struct.pack("<II", 60000 << 16 | 6, 0)),
    "no flags": element(14, b"\0" * 16),
    "deep": nested(60),
    "very deep": nested(5000),
    "a structure whose names are longer than it says": matrix(
        2, (1, 1), element(5, struct.pack("<i", 2**30)) + element(1, b"abc")
    ),
    "a structure with names of length nought": matrix(2, (1, 1), element(5, struct.pack("<i", 0)) + element(1, b"abc")),
    "cut": packed(matrix(6, (1, 10), TEN))[:-9],
    "not packed": struct.pack("<II", 15, 40) + b"\x01" * 40,
    "twice the same variable": matrix(6, (1, 10), TEN) * 2,
    "a bomb": packed(matrix(9, (1, 300_000_000), element(2, bytes(300_000_000)))),
    "very many cells": matrix(1, (1, MOST_ARRAYS + 1), element(14, b"") * (MOST_ARRAYS + 1)),
    "text for numbers": matrix(6, (1, 10), element(16, b"1234567890")),
    "imaginary part missing": matrix(6, (1, 10), TEN, flags=0x0800),
    "characters of another kind": matrix(4, (1, 10), TEN),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_matlab_files(name: str, tmp_path: Path) -> None:
    """Refused, in memory that follows the file's size and not what it says."""
    path = mat_file(tmp_path / "a.mat", HOSTILE[name])
    tracemalloc.start()
    try:
        with pytest.raises(FileProblem) as caught:
            read_mat(path)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert used < 400e6
    assert caught.value.remedy
    assert "a.mat" in str(caught.value)


def test_damaged_bytes_do_no_harm(tmp_path: Path) -> None:
    """Sound files with bytes changed, cut and inserted: values or a refusal, nothing else."""
    chosen = random.Random(20240605)
    path = tmp_path / "a.mat"
    outcomes = {"read": 0, "refused": 0}
    for form, pressed in (("5", False), ("5", True), ("4", False)):
        given = EVERYTHING if form == "5" else {"a": np.arange(6.0), "b": "text"}
        scipy.io.savemat(path, given, format=form, do_compression=pressed, long_field_names=form == "5")
        sound = path.read_bytes()
        for _ in range(400):
            data = bytearray(sound)
            for _ in range(chosen.randint(1, 6)):
                place = chosen.randrange(len(data))
                action = chosen.random()
                if action < 0.6:
                    data[place] = chosen.choice([0, 1, 2, 5, 9, 14, 15, 127, 128, 255, chosen.randrange(256)])
                elif action < 0.8:
                    del data[place : place + chosen.randint(1, 16)]
                else:
                    data[place:place] = chosen.randbytes(chosen.randint(1, 16))
                if not data:
                    break
            path.write_bytes(data)
            try:
                simplified(read_mat(path))
                outcomes["read"] += 1
            except FileProblem:
                outcomes["refused"] += 1
    assert sum(outcomes.values()) == 1200
    assert min(outcomes.values()) > 100


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"t": 1' + "0" * 400 + "}", "an integer of 401 digits"),
        ('{"t": [1], "t": [2]}', "two entries are called 't'"),
        ("[" * 100_000, "nested too deep"),
        ('{"t": [1, 2}', "not JSON"),
        ("[1, 2]", "no JSON object"),
        ('{"t": "\udcff"}', "not UTF-8"),
    ],
)
def test_json_that_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FileProblem, match=said) as caught:
        read_json(path)
    assert caught.value.remedy


@pytest.mark.parametrize("read", [read_mat, read_json, read_table, read_plain])
def test_only_regular_files_of_bounded_size_are_opened(read: Any, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    link = tmp_path / "link"
    link.symlink_to("/dev/zero")
    for path, said in (
        (pipe, "no regular file"),
        (link, "no regular file"),
        (tmp_path, "no regular file"),
        (tmp_path / "none", "No such file"),
        (tmp_path / ("a" * 300), "name too long"),
        (tmp_path / "a\0b", "NUL"),
    ):
        with pytest.raises(FileProblem, match=said) as caught:
            read(path)
        assert caught.value.remedy
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(FileProblem, match="at most"):
        read(large)
    with pytest.raises(FileProblem, match=r"at most 0\.001 MB"):
        content(COLLECTION / "malformed1.mat" if (COLLECTION / "malformed1.mat").is_file() else large, 1000)


def test_text_tables_of_several_pieces(tmp_path: Path) -> None:
    """The numbers of numpy's own reader, whatever falls on the seam between two pieces."""
    count = 2 * AT_ONCE + 3
    values = np.random.default_rng(5).normal(size=(count, 3))
    path = tmp_path / "a.csv"
    np.savetxt(path, values, delimiter=";", header="a;b;c", comments="", fmt="%.17g")
    read = read_table(path)
    np.testing.assert_array_equal(np.column_stack(list(read.columns.values())), values)
    np.testing.assert_array_equal(read.lines, np.arange(2, count + 2))
    np.savetxt(tmp_path / "a.dat", values, header="made\nhere", fmt="%.17g")
    plain = read_plain(tmp_path / "a.dat")
    np.testing.assert_array_equal(np.column_stack(list(plain.columns.values())), values)
    np.testing.assert_array_equal(plain.lines, np.arange(3, count + 3))
    lines = path.read_text().splitlines()
    lines[AT_ONCE + 1] = "1;x;2"
    path.write_text("\n".join(lines))
    with pytest.raises(FileProblem, match=f"in line {AT_ONCE + 2}"):
        read_table(path).numbers("b")
