"""The page of a small made-up proof."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.proof import data, frozen, page
from benchmarks.proof.__main__ import main
from tests.proof.made import INPUT, finding, put


@pytest.fixture
def folder(tmp_path: Path) -> Any:
    put(tmp_path, findings=[finding("dead_zone", INPUT, lower=(-0.11, -0.09), upper=(0.21, 0.25))])
    put(tmp_path, findings=[finding("lag", INPUT)], seed=2, errors=(90.0, 9.0, 9.5))
    put(tmp_path, failure="Traceback\nValueError: a | b", seed=3)
    put(tmp_path, [], [], suite="none")
    put(tmp_path, ["dead_zone", "coulomb_friction"], [finding("dead_zone", INPUT)], suite="pairs")
    return tmp_path


def written(folder: Any, tmp_path: Path, causes: Any = None) -> str:
    proof = data.gather(folder)
    data.save(proof, tmp_path / "proof.json")
    again = data.load(tmp_path / "proof.json")
    assert again.rows == proof.rows
    page.write(again, tmp_path / "proof.md", causes or {})
    return (tmp_path / "proof.md").read_text(encoding="utf-8")


def row(text: Any, start: Any) -> Any:
    return next(line for line in text.splitlines() if line.startswith(start))


def test_every_case_is_counted_and_every_failure_shown(folder: Any, tmp_path: Path) -> None:
    text = written(folder, tmp_path)
    assert "| right name, or a tie that the truth generator confirms, >= 90 % | 1 of 3, 33 %" in text
    assert row(text, "| nothing concealed").split("|")[3].strip().startswith("0 of 1, 0 %")
    assert "| never worse than the refit | worse in 1 of 3 | **not met** |" in text
    assert "| cover 88 to 98 % | 1 of 2, 50 % (9 to 91 %) | **not met** |" in text
    assert "3 of 5 cases." in text
    assert r"ValueError: a \| b" in text
    assert row(text, "| dead_zone | 3 | 1 |").endswith("| failed 1, lag 1 |")
    assert row(text, "| core | 3 ").count("|") == row(text, "| suite | cases").count("|")


def test_figures_are_small(folder: Any, tmp_path: Path) -> None:
    written(folder, tmp_path)
    for name in ("proof-power.svg", "proof-confusion.png"):
        assert 1000 < (tmp_path / name).stat().st_size < 60_000


def test_causes_by_name_and_by_pattern(folder: Any, tmp_path: Path) -> None:
    failed = next(r for r in data.gather(folder).rows if r.outcome == "failed")
    text = written(folder, tmp_path, {failed.name: "a bug", "pairs * dead_zone@*": "friction below the floor"})
    assert row(text, f"| `{failed.name}`").endswith("| a bug |")
    assert text.count("| friction below the floor |") == 1


def test_the_command_shows_and_writes(folder: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "-o", str(folder)]) == 0
    assert "core: 1 of 3 right" in capsys.readouterr().out
    files = ["--page", str(tmp_path / "p.md"), "--data", str(tmp_path / "p.json")]
    assert main(["page", "-o", str(folder), *files]) == 0
    first = (tmp_path / "p.md").read_text()
    assert main(["page", *files]) == 0
    assert (tmp_path / "p.md").read_text() == first
    assert main(["page", "-o", str(tmp_path / "nowhere"), *files]) == 1


@pytest.mark.parametrize(
    ("option", "name", "meant"), [("--effect", "dead_zon", "dead_zone"), ("--plant", "pendulm", "pendulum")]
)
def test_cases_that_are_none_are_refused_by_name(
    option: str, name: str, meant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "core", option, name, "-o", str(tmp_path / "out")]) == 1
    assert f"'{meant}'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_score_goes_on_with_earlier_cases_of_the_same_commit_alone(folder: Any, tmp_path: Path) -> None:
    """Of two scores with one case in common, the later result counts; other commits' cases do not."""
    found = frozen.frozen()
    assert found is not None
    commit = found.commit
    proof = data.gather(folder)
    both, old, other = (replace(r, frozen=c) for r, c in zip(proof.rows, (commit, commit, "another"), strict=False))
    now = replace(both, outcome="wrong")
    more = replace(both, name="core-new", frozen=commit)
    unfinished = replace(old, outcome="not run")
    earlier = replace(proof, rows=[both, old, other], sindy={both.name: {"right": True}, other.name: {}})
    made = data.together(replace(proof, rows=[now, more, unfinished], sindy={}), earlier)
    assert {r.name: r.outcome for r in made.rows} == {
        now.name: "wrong",
        more.name: more.outcome,
        old.name: old.outcome,
    }
    assert made.sindy == {both.name: {"right": True}}


def test_cases_of_drives_that_are_not_run_again_stay(folder: Any, tmp_path: Path) -> None:
    """With '--add' the page has what was on record too, with the state of the program that ran it."""
    files = ["--page", str(tmp_path / "p.md"), "--data", str(tmp_path / "d.json")]
    proof = data.gather(folder)
    mine = [replace(r, suite="drives", code="before", outcome="wrong") for r in proof.rows]
    other = replace(mine[0], name="drives-other")
    data.save(replace(proof, rows=[*mine, other]), tmp_path / "d.json")
    assert main(["drives", "--add", "-o", str(folder), *files]) == 0
    rows = {r.name: r for r in data.load(tmp_path / "d.json").rows}
    assert rows[other.name].code == "before"
    assert {r.name: r.outcome for r in proof.rows} == {n: r.outcome for n, r in rows.items() if n != other.name}
    assert "`before` (1 cases)" in (tmp_path / "p.md").read_text()
    assert main(["drives", "-o", str(folder), *files]) == 0
    assert other.name not in {r.name for r in data.load(tmp_path / "d.json").rows}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("run none --frozen --count 1 --first 1 -o DIR", "give '--count' more than 1"),
        ("run none --frozen --count 2 --first -1 -o DIR", "all but the first -1 are none"),
        ("run none --first 1 -o DIR", "give '--frozen' too"),
        ("page --add", "give the folder by '-o'"),
        ("drives --add", "give the folder by '-o'"),
    ],
)
def test_options_that_ask_for_nothing_are_refused(
    line: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.replace("DIR", str(tmp_path / "out")).split()) == 1
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_empty_proof_is_a_page_too(tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    assert "| nothing concealed | false alarms <= 5 % | not run | - |" in written(tmp_path, tmp_path)


def test_a_case_is_rerun_by_one_command_and_the_name_appears(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = ["--plant", "pendulum", "--effect", "dead_zone", "--seed", "101"]
    assert main(["one", *case, "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "reported:  named: dead_zone at source.out -> drive.torque" in out
    assert "concealed: dead_zone@source.out -> drive.torque" in out
    assert out.rstrip().endswith("that is: named")
