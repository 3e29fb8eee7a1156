"""Numbers that began anew: registers written by the definition of two's complement, and columns that only look so."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from diagnosis.binding import find_recording
from diagnosis.drafting.log_file import look
from diagnosis.problems import problem
from diagnosis.recordings.types import Recording
from diagnosis.recordings.wrapped_numbers import SIGNED, find, signed
from diagnosis.verdict.recording_checks import Remark, screen
from engine.errors import FlexarmError
from scenarios.load import load
from scenarios.schema import SIGNED_NUMBERS

T = 0.01 * np.arange(600)
CURRENT = np.round(350 * np.sin(5 * T) + 60 * np.sin(31 * T))
"""A current in mA, as a servo's register holds it."""

SCENARIO = """\
schema: 1
name: servo
blocks:
  source: {type: Torque}
  arm: {type: Inertia, inertia: 0.5 kg.m2}
connect:
  - [source.shaft, arm.shaft]
recordings:
  run:
    file: run.csv
    time: {column: t}
    drive: {source.torque: {column: i, unit: '1', scale: 1 mN.m WRAP}}
    measurements:
      arm.shaft.angle: {column: x, unit: rad, noise: 1e-3}
SPARE"""
SPARE = "      arm.shaft.speed: {column: i, unit: '1', scale: 1 rad/s, use: evidence}\n"


def stored(numbers: np.ndarray, form: str) -> np.ndarray:
    """What is read without a sign where a number was written with one."""
    out, back = {"int8": ("b", "B"), "int16": ("h", "H"), "int32": ("i", "I")}[form]
    return np.array([struct.unpack(f"<{back}", struct.pack(f"<{out}", int(n)))[0] for n in numbers], float)


DRIVEN = "column: x, unit: N.m"
"""What drives where the column is a spare one."""


def written(folder: Path, wrap: str = "", *, spare: bool = False, column: np.ndarray | None = None) -> Path:
    rows = stored(CURRENT, "int16") if column is None else column
    table = np.column_stack([T, rows, 0.1 * T**2])
    np.savetxt(folder / "run.csv", table, "%.9g", ",", header="t,i,x", comments="")
    text = SCENARIO.replace(" WRAP", wrap).replace("SPARE", SPARE if spare else "")
    (folder / "servo.yaml").write_text(text.replace("column: i, unit: '1', scale: 1 mN.m", DRIVEN) if spare else text)
    return folder / "servo.yaml"


def read(path: Path) -> Recording:
    found = find_recording(load(path), "run")
    assert isinstance(found, Recording)
    return found


def remarks(path: Path) -> list[Remark]:
    scenario = load(path)
    return [r for r in screen(problem(scenario, [find_recording(scenario, "run")])) if "jumps" in r.text]


@pytest.mark.parametrize(("form", "size"), [("int8", 50), ("int16", 400), ("int32", 9e8)])
def test_a_signed_number_without_its_sign_is_seen_and_read(form: str, size: float) -> None:
    """The register's own definition, by the standard library; the rows are those in which the number passes zero."""
    numbers = np.round(size * np.sin(5 * T))
    rows = stored(numbers, form)
    found = find(rows, turns=False)
    assert found is not None
    assert found.word == form
    negative = numbers < 0
    np.testing.assert_array_equal(np.flatnonzero(found.after), 1 + np.flatnonzero(negative[1:] != negative[:-1]))
    np.testing.assert_array_equal(signed(rows, form), numbers)
    np.testing.assert_array_equal(signed(numbers, form), numbers)


@pytest.mark.parametrize(("size", "form"), [(4096.0, "2^12"), (65536.0, "2^16"), (360.0, "360"), (2 * np.pi, "2 pi")])
def test_a_counter_that_turned_is_seen_where_turns_are_counted(size: float, form: str) -> None:
    turns = np.cumsum(0.02 + 0.01 * np.sin(T))
    rows = (size * turns) % size
    found = find(rows, turns=True)
    assert found is not None
    assert (found.word, found.name) == ("", form)
    np.testing.assert_array_equal(np.flatnonzero(found.after), 1 + np.flatnonzero(np.diff(np.floor(turns))))
    assert find(rows, turns=False) is None


def test_what_only_looks_so_is_left_alone() -> None:
    """A switch, a duty of few levels, a full-scale ramp, a number that has its sign, and numbers with a fraction."""
    switch = 255.0 * (np.sin(5 * T) > 0)
    levels = np.array([0.0, 64.0, 255.0])[np.arange(600) // 40 % 3]
    ramp = np.round(np.linspace(0, 65535, 600))
    fraction = stored(CURRENT, "int16") + 0.5
    for rows in (switch, levels, ramp, CURRENT, fraction, np.full(600, 65535.0), np.full(600, np.nan)):
        assert find(rows, turns=False) is None
    assert find(ramp, turns=True) is None


def test_it_is_said_by_name_where_recordings_are_checked(tmp_path: Path) -> None:
    (found,) = remarks(written(tmp_path))
    jumps = int(np.sum(np.diff(CURRENT < 0)))
    first = 2 + 1 + int(np.flatnonzero(np.diff(CURRENT < 0))[0])
    for piece in (f"column 'i' jumps {jumps} times", "near 65535", f"lines {first}, ", "'wrap: int16'", "'run'"):
        assert piece in found.text
    assert found.grave
    assert any("column 'i' jumps" in note for note in read(tmp_path / "servo.yaml").notes)


def test_a_spare_column_that_wrapped_keeps_no_name_back(tmp_path: Path) -> None:
    (found,) = remarks(written(tmp_path, spare=True))
    assert "column 'i' jumps" in found.text
    assert not found.grave


def test_the_mapping_gives_the_sign_back(tmp_path: Path) -> None:
    path = written(tmp_path, ", wrap: int16")
    np.testing.assert_allclose(read(path).drive[0].values, 1e-3 * CURRENT, rtol=1e-12, atol=0)
    assert not remarks(path)
    path.write_text(path.read_text().replace("wrap: int16", "wrap: int16, sign: -1, offset: 20"))
    np.testing.assert_allclose(read(path).drive[0].values, -1e-3 * (CURRENT - 20), rtol=1e-12, atol=1e-12)


def test_a_drive_that_turns_over_is_made_continuous(tmp_path: Path) -> None:
    turns = np.cumsum(np.full(600, 300.0))
    path = written(tmp_path, ", wrap: 65536", column=turns % 65536)
    np.testing.assert_allclose(read(path).drive[0].values, 1e-3 * turns, rtol=1e-9)


@pytest.mark.parametrize(
    ("wrap", "pieces"),
    [
        ("int12", ["servo.yaml:12", "'int12' is no kind of signed number", "int16"]),
        ("uint16", ["'uint16' is no kind of signed number", "int16"]),
        ("int8", ["servo.yaml:12", "column 'i'", "8 bits", "lines", "int16"]),
    ],
)
def test_other_words_are_refused_with_their_place(tmp_path: Path, wrap: str, pieces: list[str]) -> None:
    with pytest.raises(FlexarmError) as refused:
        read(written(tmp_path, f", wrap: {wrap}"))
    for piece in pieces:
        assert piece in str(refused.value)


def test_the_schema_lists_the_words() -> None:
    assert tuple(SIGNED) == SIGNED_NUMBERS


def test_a_draft_sees_it_too(tmp_path: Path) -> None:
    written(tmp_path, column=stored(CURRENT - 5, "int16"))  # it begins below zero
    found = look(tmp_path / "run.csv").signal("i")
    assert (found.signed, found.wrap) == ("int16", 65536.0)
    np.testing.assert_allclose(np.diff(found.values), np.diff(CURRENT))
