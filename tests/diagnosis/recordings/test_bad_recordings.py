"""Recordings that are wrong in themselves end in a clear message or a warning, never in a name with confidence."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import diagnose
from diagnosis.binding import find_recording
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import problem
from diagnosis.recordings.columns import LONG_TEXT, read_columns
from diagnosis.recordings.types import Recording
from diagnosis.thresholds import FITTING
from diagnosis.verdict.recording_checks import screen
from engine.errors import FlexarmError
from scenarios.load import load
from tests.diagnosis.plants import case

NAMES = ("steps", "chirp", "growing", "ramp", "slow")


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A motor without anything concealed, and its recordings."""
    return case(tmp_path, seed=8)


def table(folder: Path, name: str) -> np.ndarray:
    return np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)


def store(folder: Path, name: str, values: np.ndarray) -> None:
    np.savetxt(folder / f"{name}.csv", values, delimiter=",", header="t,u,speed", comments="")


def spoil(path: Path, change: Any) -> Path:
    for name in NAMES:
        store(path.parent, name, change(table(path.parent, name)))
    return path


def prepared(path: Path) -> Any:
    scenario = load(path)
    return problem(scenario, [find_recording(scenario, name) for name in scenario.recordings])


def scaled(factor: float) -> Callable[..., Any]:
    return lambda rows: rows * [1.0, 1.0, factor]


def clipped(rows: np.ndarray) -> np.ndarray:
    return np.column_stack([rows[:, :2], np.clip(rows[:, 2], -60.0, 60.0)])


def shifted(samples: int) -> Any:
    def change(rows: np.ndarray) -> np.ndarray:
        kept = np.column_stack([rows[:, :2], np.roll(rows[:, 2], samples)])
        return kept[5:-5]

    return change


def test_sound_recordings_give_no_remark(bench: Path) -> None:
    assert screen(prepared(bench)) == []


def test_concealed_physics_is_no_fault_of_the_recording(tmp_path: Path) -> None:
    for number, truth in enumerate(({"coulomb": 4e-4}, {"dead": 0.15}, {"inertia": 1.4e-6})):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert not any(remark.grave for remark in screen(prepared(case(folder, seed=3, **truth))))


@pytest.mark.parametrize(
    ("change", "piece"),
    [
        (scaled(180 / np.pi), "degrees taken for radians"),
        (scaled(np.pi / 180), "radians taken for degrees"),
        (scaled(-1.0), "is its sign right?"),
        (scaled(-30 / np.pi), "revolutions per minute"),
        (clipped, "is the sensor at the end of its range?"),
        (shifted(-2), "ahead of the model, before its cause"),
        (shifted(4), "there is a delay, or a column is shifted"),
    ],
)
def test_what_no_physics_explains_is_remarked(change: Any, piece: str, bench: Path) -> None:
    found = [remark.text for remark in screen(prepared(spoil(bench, change)))]
    assert any(piece in text for text in found), found


SLOW = pytest.mark.slow
SPOILT = {"in degrees": scaled(180 / np.pi), "upside down": scaled(-1.0), "clipped": clipped}
LATE = {"late": shifted(1), "early": shifted(-1)}


@pytest.mark.parametrize("name", ["in degrees", *(pytest.param(n, marks=SLOW) for n in ("upside down", "clipped"))])
def test_a_spoilt_recording_is_told_and_nothing_is_named(name: str, bench: Path) -> None:
    found = diagnose(spoil(bench, SPOILT[name]), workers=2)
    assert found.verdict in ("unknown", "none")
    assert any("?" in warning for warning in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("name", LATE)
def test_a_column_shifted_by_a_sample(name: str, bench: Path) -> None:
    """Late by a sample cannot be told from a delay of a sample: that name is right, and no other with confidence."""
    found = diagnose(spoil(bench, LATE[name]), workers=2)
    if found.verdict in ("named", "wrong_parameter"):
        assert {finding["effect"] for finding in found.findings} <= {"delay", "lag"}
        assert name == "late"


def test_empty_and_short_files(bench: Path) -> None:
    target = bench.parent / "steps.csv"
    rows = target.read_text().splitlines()
    for text, piece in (("", "empty"), (rows[0], "empty"), ("\n".join(rows[:2]), "at least two")):
        target.write_text(text)
        with pytest.raises(FlexarmError, match=piece) as caught:
            diagnose(bench)
        assert "steps.csv" in str(caught.value.where)
        assert caught.value.remedy


def test_a_constant_column(bench: Path) -> None:
    rows = table(bench.parent, "steps")
    store(bench.parent, "steps", np.column_stack([rows[:, :2], np.full(len(rows), 3.0)]))
    with pytest.raises(FlexarmError, match="'speed' is constant"):
        diagnose(bench)


def test_time_that_runs_backwards(bench: Path) -> None:
    rows = table(bench.parent, "chirp")
    store(bench.parent, "chirp", rows[::-1])
    with pytest.raises(FlexarmError, match="time runs backwards"):
        diagnose(bench)


def test_runs_of_nan_are_masked_and_told(bench: Path) -> None:
    """The fit to what is left is that of the whole, within its interval; nothing is resampled."""
    rows = table(bench.parent, "steps")
    rows[200:260, 2] = np.nan
    store(bench.parent, "steps", rows)
    recording = find_recording(load(bench), "steps")
    assert isinstance(recording, Recording)
    assert len(recording.time) == len(rows)
    assert any("60 of 1001 rows" in note for note in recording.notes)
    made = prepared(bench)
    residual = made.residual(np.zeros(len(made.free)), made.experiments[0])
    assert (residual[200:260] == 0).all()
    assert (residual[:200] != 0).all()
    slopes = made.linearised(np.zeros(len(made.free)), made.experiments[0])[1]
    assert (slopes[200:260] == 0).all()


def test_nan_in_a_drive_is_refused_unless_it_may_be_skipped(bench: Path) -> None:
    rows = table(bench.parent, "steps")
    rows[200:260, 1] = np.nan
    store(bench.parent, "steps", rows)
    with pytest.raises(FlexarmError, match="column 'u' holds no finite number") as caught:
        prepared(bench)
    assert "gaps: skip" in caught.value.remedy
    scenario = load(bench, ["recordings.steps.gaps=skip"])
    recording = find_recording(scenario, "steps")
    assert isinstance(recording, Recording)
    assert len(recording.time) == len(rows) - 60
    assert any("gap in time" in note for note in recording.notes)
    experiment = problem(scenario, [recording]).experiments[0]
    assert isinstance(experiment, TimeExperiment)
    assert experiment.uneven
    assert experiment.step == pytest.approx(2e-3)
    place = experiment.time / experiment.step
    np.testing.assert_allclose(place, np.round(place), atol=1e-9)


def test_a_column_without_numbers(bench: Path) -> None:
    rows = table(bench.parent, "steps")
    rows[:, 2] = np.nan
    store(bench.parent, "steps", rows)
    with pytest.raises(FlexarmError, match="'speed' holds no number"):
        diagnose(bench)


@pytest.mark.slow
def test_ten_million_samples_are_refused_in_bounded_memory(bench: Path) -> None:
    count = 10_000_000
    target = bench.parent / "steps.csv"
    part = "".join(f"{{0}}{k:06d},1.5,2.5{k % 10}\n" for k in range(1_000_000))
    with target.open("w") as out:
        out.write("t,u,speed\n")
        for million in range(count // 1_000_000):
            out.write(part.replace("{0}", f"{million}"))
    assert target.stat().st_size > LONG_TEXT
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FlexarmError, match=f"has {count} samples") as caught:
        diagnose(bench)
    assert "window" in caught.value.remedy
    used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert used < 8 * count * 3 * 8


def test_more_samples_than_a_fit_takes(bench: Path) -> None:
    count = FITTING.most_samples + 1
    time = np.arange(count) * 1e-3
    from scipy.io import savemat

    savemat(bench.parent / "steps.mat", {"t": time, "u": np.sin(time), "speed": np.cos(time)})
    scenario = load(bench, ["recordings.steps.file=steps.mat"])
    with pytest.raises(FlexarmError, match=f"has {count} samples"):
        problem(scenario, [find_recording(scenario, "steps")])
    part = load(
        bench,
        ["recordings.steps.file=steps.mat"],
        text=bench.read_text().replace("file: steps.csv", "file: steps.mat\n    window: [1 s, 3 s]"),
    )
    assert len(problem(part, [find_recording(part, "steps")]).experiments[0].time) == 2001


def test_long_text_is_read_as_the_short_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text("# made here\n\nt;u\n0;1\n1;nan\n2;-3.5e-2\n")
    short = read_columns(tmp_path / "a.csv")
    monkeypatch.setattr("diagnosis.recordings.columns.LONG_TEXT", 1)
    long = read_columns(tmp_path / "a.csv")
    assert long.names == short.names == ["t", "u"]
    for name in short.names:
        np.testing.assert_array_equal(long.number(name), short.number(name))
    assert list(long.rows) == list(short.rows)
    (tmp_path / "b.csv").write_text("t,u\n0,1\n1,one\n")
    with pytest.raises(FlexarmError, match="cannot be read as columns of numbers"):
        read_columns(tmp_path / "b.csv")
