"""The tool sees a scenario and recordings, and nothing that tells what is concealed."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.concealed.drawing import Options
from benchmarks.proof import run as runner
from benchmarks.proof.score import scores
from benchmarks.proof.suites import SUITES, Spec, from_json

ROOT = Path(__file__).resolve().parents[2]
SPY = """
import json, os, pathlib, sys
seen = {"argv": sys.argv[1:], "cwd": os.getcwd(), "environ": dict(os.environ)}
seen["files"] = sorted(str(p) for p in pathlib.Path(".").rglob("*"))
seen["text"] = pathlib.Path("scenario.yaml").read_text()
pathlib.Path(os.environ["SPY"]).write_text(json.dumps(seen))
sum(k * k for k in range(3_000_000))
held = {key: {"y": {"chi2": 1.0}} for key in ("nominal", "refit", "amended")}
print(json.dumps({"verdict": "none", "findings": [], "fit": {"hold_out": held}, "next_experiment": None}))
"""


@pytest.fixture
def spied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Path, Any]:
    script, note = tmp_path / "spy.py", tmp_path / "note.json"
    script.write_text(SPY)
    monkeypatch.setattr(runner, "TOOL", (sys.executable, str(script)))
    monkeypatch.setenv("SPY", str(note))
    spec = Spec("core", "pendulum", ("offset",), (3.0,), 5, Options(seconds=1.0))
    runner.run([spec], tmp_path / "proof", 1, lambda line: None)
    return spec, tmp_path / "proof", json.loads(note.read_text())


def test_the_tool_gets_scenario_and_recordings_only(spied: tuple[Any, Path, Any]) -> None:
    spec, folder, seen = spied
    assert seen["files"] == [*(f"rec{k}.csv" for k in range(1, 7)), "scenario.yaml"]
    assert "--without" not in seen["argv"]
    place = Path(seen["cwd"])
    assert folder not in place.parents
    assert not (place / ".." / "answers").exists()
    told = " ".join([*seen["argv"], seen["cwd"], *(v for k, v in seen["environ"].items() if k != "SPY")])
    assert spec.name not in told
    assert str(folder) not in told
    assert "offset" not in seen["text"].lower()


def test_answers_lie_elsewhere_and_time_is_noted(spied: tuple[Any, Path, Any]) -> None:
    spec, folder, _ = spied
    assert sorted(p.name for p in (folder / "cases" / spec.name).iterdir())[-1] == "scenario.yaml"
    assert len(list((folder / "cases" / spec.name).iterdir())) == 7
    about = json.loads((folder / "results" / spec.name / "run.json").read_text())
    assert 0.02 < about["cpu"] < about["seconds"] * 1.5
    (row,) = scores(folder)
    assert (row.outcome, row.truth) == ("missed", ("offset@source.out -> drive.torque",))


def test_a_second_run_goes_on_where_the_first_was_stopped(spied: tuple[Any, Path, Any]) -> None:
    spec, folder, _ = spied
    lines: list[str] = []
    runner.run([spec], folder, 1, lines.append)
    assert lines[0].endswith("done before")


def test_what_hangs_is_stopped_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "hang.py"
    script.write_text("import time\ntime.sleep(86400)\n")
    monkeypatch.setattr(runner, "TOOL", (sys.executable, str(script)))
    monkeypatch.setattr(runner, "LONGEST", 0.5)
    (tmp_path / "case").mkdir()
    numbers = runner.diagnose(Spec("core", "pendulum", ("offset",), (3.0,), 5), tmp_path / "case", tmp_path)
    assert numbers["verdict"] == "failed"
    assert numbers["failure"] == "stopped after 0.5 s"
    assert numbers["seconds"] >= 0.5


def test_what_cannot_be_drawn_is_counted(tmp_path: Path) -> None:
    spec = Spec("core", "pendulum", ("saturation@nowhere",), (3.0,), 5)
    runner.run([spec], tmp_path, 1, lambda line: None)
    (row,) = scores(tmp_path)
    assert (row.outcome, row.truth) == ("failed", ("saturation@nowhere",))
    assert "cannot be drawn" in row.failure


def test_case_names_are_silent_and_specs_travel() -> None:
    for make in SUITES.values():
        for spec in make([7]):
            assert not any(effect.partition("@")[0] in spec.name for effect in spec.effects)
            data = json.loads(json.dumps(spec, default=lambda x: x.__dict__))
            assert from_json(data) == spec


def test_no_package_of_the_tool_knows_the_benchmarks() -> None:
    for package in ("engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not any(n == "benchmarks" or n.startswith("benchmarks.") for n in names), path
