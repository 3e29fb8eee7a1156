"""``flexarm damping``: numbers, figures and JSON from a file, and exit code 1 with the cause for bad ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.decay.decays import LIGHT, MODES, coulomb, two_modes, viscous

PNG = b"\x89PNG\r\n\x1a\n"


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture
def link(tmp_path: Path) -> Path:
    """Two modes, in mm, sampled at 2 kHz, time in ms."""
    time, values = two_modes(2000, LIGHT, 1.5, noise=2e-3, seed=3)
    return write(tmp_path / "link.csv", "t [ms],tip [mm]", 1e3 * time, 15 * values)


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """A pendulum and its dry-friction twin."""
    time = np.arange(0, 20, 2e-3)
    noise = 0.01 * np.random.default_rng(1).standard_normal((2, len(time)))
    return write(
        tmp_path / "swing.csv",
        "time,wet [deg],dry [deg],still",
        time,
        viscous(time, 0.96, 0.0142, 7.0) + noise[0],
        coulomb(time, 0.96, 7.0, 0.1) + noise[1],
        0 * time,
    )


def test_ratios_as_json(command: Any, link: Path) -> None:
    answer = command("damping", link, "--json", "-f", "7.6 Hz", "-f", "48", "--window", "400 ms", "--hop", "50 ms")
    assert answer.code == 0
    found = json.loads(answer.out)
    assert found["unit"] == "mm"
    assert found["step"] == pytest.approx(5e-4)
    assert found["decrement"] is None
    modes = found["waterfall"]["modes"]
    assert [mode["ratio"] for mode in modes] == pytest.approx(LIGHT, rel=0.02)
    assert [mode["frequency"] for mode in modes] == pytest.approx(MODES, rel=1e-3)
    for mode, ratio in zip(modes, LIGHT, strict=True):
        assert mode["interval_95"][0] < ratio < mode["interval_95"][1]
        assert 0 < mode["standard_error"] < 0.02 * ratio
        assert mode["reliable"]


def test_a_page_for_people(command: Any, link: Path) -> None:
    answer = command("damping", link)
    assert answer.code == 0
    assert "modes found in the spectrum: 7.6" in answer.out
    assert "std. error" in answer.out
    assert "no logarithmic decrement: the record holds 2 modes" in answer.out


def test_figures_and_numbers_go_into_the_folder(command: Any, swing: Path, tmp_path: Path) -> None:
    folder = tmp_path / "there" / "out"  # both are made
    answer = command("damping", swing, "-c", "wet", "-o", folder)
    assert answer.code == 0
    assert sorted(path.name for path in folder.iterdir()) == [
        "damping.json",
        "decay.png",
        "decrement.png",
        "waterfall.png",
    ]
    for path in folder.glob("*.png"):
        assert path.read_bytes()[:8] == PNG
        assert f"written: {path}" in answer.out
    found = json.loads((folder / "damping.json").read_text())
    assert found["decrement"]["ratio"] == pytest.approx(0.0142, rel=0.02)
    assert found["waterfall"]["modes"][0]["ratio"] == pytest.approx(0.0142, rel=0.01)
    assert found["decrement"]["envelope"]["verdict"] == "viscous"
    # Again into the same folder.
    assert command("damping", swing, "-c", "wet", "-o", folder).code == 0


def test_dry_friction_is_said(command: Any, swing: Path) -> None:
    answer = command("damping", swing, "--column", "dry")
    assert answer.code == 0
    assert "dry (Coulomb) friction" in answer.out
    assert "warning:" in answer.err
    assert "Coulomb" in answer.err


def test_a_window_too_short_is_warned_of(command: Any, link: Path) -> None:
    answer = command("damping", link, "-f", "7.62", "-f", "47.8", "--window", "0.05", "--hop", "0.05", "--windows", "4")
    assert answer.code == 0
    assert "warning: window too short" in answer.err
    assert "unreliable" in answer.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-c", "wte"], ["no column 'wte'", "did you mean 'wet'?"]),
        ([], ["3 signals", "--column", "wet [deg]"]),
        (["-c", "still"], ["'still' is constant"]),
        (["-c", "wet", "-t", "when"], ["no column 'when'"]),
        (["-c", "wet", "-t", "wet"], ["wet [deg]", "'s' is expected"]),
        (["-c", "wet", "-f", "5"], ["no vibration within 15 % of 5 Hz", "0.96"]),
        (["-c", "wet", "-f", "400"], ["400 Hz is not in the record", "0 to"]),
        (["-c", "wet", "-f", "fast"], ["--frequency", "fast"]),
        (["-c", "wet", "--window", "-1"], ["--window", "not a positive time"]),
        (["-c", "wet", "--window", "30"], ["the record lasts 20 s"]),
        (["-c", "wet", "--windows", "1"], ["at least two windows"]),
        (["-c", "wet", "--start", "25"], ["start"]),
        (["-c", "wet", "--taper", "kaiser"], ["unknown taper 'kaiser'", "hann, rectangular"]),
        (["-c", "wet", "-o", f"{__file__}/folder"], ["cannot make the folder", "Not a directory"]),
    ],
)
def test_bad_input_ends_with_1_and_the_cause(
    command: Any, swing: Path, arguments: list[Any] | list[str], words: list[str]
) -> None:
    answer = command("damping", swing, *arguments)
    assert answer.code == 1
    assert answer.out == ""
    for word in words:
        assert word in answer.err
    assert "Traceback" not in answer.err


def test_a_record_that_does_not_decay(command: Any, tmp_path: Path) -> None:
    time = np.arange(0, 10, 1e-3)
    driven = write(tmp_path / "driven.csv", "time,angle", time, np.sin(12 * time))
    answer = command("damping", driven, "-o", tmp_path / "out")
    assert answer.code == 1
    assert "does not decay" in answer.err
    assert "driven" in answer.err
    assert not (tmp_path / "out" / "damping.json").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,a\n", ["16 samples|at least two|usable|holds no number|empty"]),
        ("time,a\n0,1\n1,2\n", ["samples"]),
        ("time,a\n0,x\n1,2\n", ["which is not a number"]),
        ("1,2\n3,4\n", ["numbers, not names"]),
        ("time,a\n" + "".join(f"{i},{i % 3}\n" for i in (*range(40), 20)), ["runs backwards"]),
        ("time,a\n" + "".join(f"{i},{i % 3}\n" for i in (*range(40), *range(80, 120))), ["gap"]),
        ("time [V],a\n" + "".join(f"{i},{i % 3}\n" for i in range(40)), ["'V'"]),
    ],
)
def test_files_that_cannot_be_used(command: Any, tmp_path: Path, text: Any, words: list[str]) -> None:
    import re

    path = tmp_path / "bad.csv"
    path.write_text(text)
    answer = command("damping", path)
    assert answer.code == 1
    for word in words:
        assert re.search(word, answer.err), answer.err
    assert "Traceback" not in answer.err


def test_rows_without_a_number_are_left_out_and_named(command: Any, swing: Path) -> None:
    lines = swing.read_text().splitlines()
    lines[50] = lines[50].split(",")[0] + ",,,"
    swing.write_text("\n".join(lines) + "\n")
    answer = command("damping", swing, "-c", "wet")
    assert answer.code == 0
    assert "1 of 10000 rows hold no number" in answer.out


def test_wrong_usage_ends_with_2(command: Any) -> None:
    assert command("damping").code == 2
