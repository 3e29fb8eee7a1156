"""Recordings that are wrong in themselves end in a clear message or a warning, never in a name with confidence."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.api import diagnose, gather
from diagnosis.binding import find_recording
from diagnosis.estimation.time_experiment import TimeExperiment
from diagnosis.problems import problem
from diagnosis.recordings.columns import read_columns
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


def test_a_column_that_is_constant_in_all_recordings(bench: Path) -> None:
    spoil(bench, lambda rows: np.column_stack([rows[:, :2], np.full(len(rows), 3.0)]))
    with pytest.raises(FlexarmError, match="'speed' is constant") as caught:
        diagnose(bench)
    assert "add a recording in which it moves" in caught.value.remedy


def test_a_machine_that_is_held_still_in_some_recordings_is_fitted(bench: Path) -> None:
    """Friction holds it where the voltage is small; that it does not move is evidence of it."""
    rows = table(bench.parent, "steps")
    store(bench.parent, "steps", np.column_stack([rows[:, 0], 1e-3 * rows[:, 1], np.zeros(len(rows))]))
    scenario = load(bench)
    found = gather(scenario, [], [])
    (still,) = [r for r in found if isinstance(r, Recording) and r.name == "steps"]
    assert any("'speed' is constant (0 rad/s in all" in note for note in still.notes)
    assert all("is constant" not in " ".join(r.notes) for r in found if r.name != "steps")


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


def rows_of(count: int, end: str = "") -> str:
    return "".join(f"{k},{2 * k},{3 * k}{end}\n" for k in range(count))


@pytest.mark.parametrize("count", [10, 40_000], ids=["short", "long"])
def test_rows_that_end_in_a_separator_are_refused(count: int, tmp_path: Path) -> None:
    """They moved every name by one column in files too long to be read cell by cell."""
    (tmp_path / "a.csv").write_text("u,w,temperature\n" + rows_of(count, ","))
    with pytest.raises(FlexarmError, match="4 values where the header names 3 columns") as caught:
        read_columns(tmp_path / "a.csv")
    assert caught.value.where is not None
    assert caught.value.where.line == 2
    assert "ends in a separator" in caught.value.remedy
    (tmp_path / "b.csv").write_text("u,w,temperature,\n" + rows_of(count, ","))
    read = read_columns(tmp_path / "b.csv")
    np.testing.assert_array_equal(read.number("w"), 2.0 * np.arange(count))
    assert np.isnan(read.number("")).all()


@pytest.mark.parametrize("separator", [",", ";"])
def test_a_few_words_among_numbers_are_empty_cells(separator: str, tmp_path: Path) -> None:
    rows = [f"{k},{2 * k},{'ERR' if k in (60, 61) else 3 * k}" for k in range(100)]
    text = "\n".join(["t,u,angle", *rows]).replace(",", separator)
    (tmp_path / "a.csv").write_text(text)
    read = read_columns(tmp_path / "a.csv")
    assert read.names == ["t", "u", "angle"]
    assert np.flatnonzero(np.isnan(read.number("angle"))).tolist() == [60, 61]
    assert "words in column 'angle' count as empty cells: 2 of 100" in read.notes
    (tmp_path / "b.csv").write_text(text.replace(f"{separator}9", f"{separator}x9"))  # more than one of twenty
    with pytest.raises(FlexarmError, match="column 'angle' holds a text"):
        read_columns(tmp_path / "b.csv").number("angle")


@pytest.mark.parametrize("count", [10, 40_000], ids=["short", "long"])
def test_line_numbers_after_comments_and_quoted_line_ends(count: int, tmp_path: Path) -> None:
    text = '# made here\n\nt,u,"no\nte"\n' + rows_of(count) + '# pause\n\n98765,1,"a\n# b"\n98766,x,\n98767,y,\n'
    (tmp_path / "a.csv").write_text(text)
    read = read_columns(tmp_path / "a.csv")
    assert read.names == ["t", "u", "no\nte"]
    assert list(read.rows[[0, count, count + 1]]) == [5, count + 7, count + 9]
    assert text.splitlines()[count + 6].startswith("98765")
    np.testing.assert_array_equal(read.number("t"), [*range(count), 98765, 98766, 98767])
    with pytest.raises(FlexarmError, match=f"column 'u' holds a text in line {count + 9}") as caught:
        read.number("u")
    assert caught.value.where is not None
    assert caught.value.where.line == count + 9
    with pytest.raises(FlexarmError, match="which is not a number"):
        read.number("no\nte")


@pytest.mark.parametrize(
    ("text", "said", "line"),
    [
        ("t,u,u\n1,2,3\n", "two columns are called 'u'", 1),
        ("t,,\n1,2,3\n", "two columns have no name", 1),
        ("#\nt,u\n1,2\n\n1\n", "1 value where the header names 2 columns", 5),
        ('t,u\n1,2\n2,"3\n4,5\n', "never closed", 3),
        ('t,u\n1,2\n2,"3"4\n', "quote in the middle", 3),
        ("t,u\n1," + "7" * 200_000 + "\n", "a cell of more than 131072 characters", 2),
        ("t,u\n1," + "7" * 5_000_000 + "\n", "line is too long", 2),
        ("1,2\n3,4\n", "numbers, not names", 1),
        ("root:x:0:0:root:/root:/bin/bash\nme:x:1:1::/home/me:/bin/sh\n", "no column of the file holds a number", 0),
        ("t,u\n1,2\n2,\udcff\n", "not UTF-8", 3),
    ],
)
def test_what_is_no_table_is_refused_at_its_line(text: str, said: str, line: int, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FlexarmError, match=said) as caught:
        read_columns(tmp_path / "a.csv")
    assert caught.value.where is not None
    assert caught.value.where.line == line
    assert caught.value.remedy
    assert "root" not in str(caught.value).replace(str(tmp_path), "")


@pytest.mark.parametrize(
    ("cell", "said", "remedy"),
    [
        ("12:30:01", "a date or a time of day", "seconds"),
        ("2024-05-06", "a date or a time of day", "seconds"),
        ('"1,5"', "a decimal comma", "decimal point"),
        ("1.5 rad", "a number with a text behind it", "units"),
        ("1_000", "a text", "'#' before it"),
        ("secret", "a text", "'#' before it"),
    ],
)
def test_a_cell_is_told_by_its_looks_and_never_repeated(cell: str, said: str, remedy: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"t,u\n0,{cell}\n1,2\n")
    with pytest.raises(FlexarmError, match=said) as caught:
        read_columns(tmp_path / "a.csv").number("u")
    assert remedy in caught.value.remedy
    assert cell not in str(caught.value).replace("a text", "")
