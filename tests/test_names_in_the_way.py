"""Scripts and packages of others that have the names of ours: passed over, or named with what to do."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from flexarm._packages import OURS

ROOT = Path(__file__).resolve().parent.parent
FOREIGN = "raise SystemExit('foreign: ' + __file__)\n"


def python(folder: Path, *words: str, path: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder, with our packages behind what Python itself puts on the path."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={"PYTHONPATH": str(path), "FLEXARM_CACHE": str(folder / "cache"), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.fixture(params=["files", "packages"])
def crowded(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A working folder in which every name of ours is taken, and one of a library that we use."""
    work = tmp_path / "work"
    work.mkdir()
    for name in (*OURS, "control"):
        place = work / f"{name}.py" if request.param == "files" else work / name / "__init__.py"
        place.parent.mkdir(exist_ok=True)
        place.write_text(FOREIGN)
    return work


RUN = ("linearise", "srv02-bare")


def test_the_command_runs(crowded: Path, tmp_path: Path) -> None:
    """As the console script runs it: the script's folder, and not the working folder, is first on the path."""
    script = tmp_path / "bin" / "flexarm"
    script.parent.mkdir()
    script.write_text("from flexarm.cli import main\nmain()\n")
    done = python(crowded, str(script), *RUN)
    assert done.returncode == 0, done.stderr
    assert "srv02-bare" in done.stdout
    assert done.stderr == ""


def test_python_m_runs_the_command(crowded: Path) -> None:
    done = python(crowded, "-m", "flexarm", *RUN)
    assert done.returncode == 0, done.stderr
    assert "srv02-bare" in done.stdout
    assert done.stderr == ""


def test_workers_of_the_command_import_ours(crowded: Path) -> None:
    words = ["sweep", "srv02-bare", "-v", "motor.resistance=1:3:2", "-o", "out", "--stop", "10 ms", "--workers", "2"]
    done = python(crowded, "-m", "flexarm", *words)
    assert done.returncode == 0, done.stderr
    assert (crowded / "out" / "runs.parquet").exists()


SCRIPT = """\
import flexarm

if __name__ == "__main__":
    print(flexarm.linearise("srv02-bare").states)
    flexarm.sweep("srv02-bare", ["motor.resistance=1:3:2"], "out", stop=0.01, workers=2)
"""


def test_a_script_beside_them_gets_ours_and_is_told(crowded: Path) -> None:
    (crowded / "control.py").unlink(missing_ok=True)  # the script's own folder comes first, as the user wants it
    shutil.rmtree(crowded / "control", ignore_errors=True)
    (crowded / "study.py").write_text(SCRIPT)
    done = python(crowded, "study.py")
    assert done.returncode == 0, done.stderr
    assert "motor.shaft.speed" in done.stdout
    assert (crowded / "out" / "runs.parquet").exists()
    for name in OURS:
        assert str(crowded / name) in done.stderr
    assert "rename them" in done.stderr


@pytest.mark.parametrize("name", ["blocks", "engine"])
def test_a_script_named_as_one_of_ours_runs(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.py").write_text("import flexarm\nprint(flexarm.load('srv02-bare').name)\n")
    done = python(tmp_path, f"{name}.py")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "srv02-bare"


@pytest.mark.parametrize("name", OURS)
def test_one_that_was_imported_first_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.py").write_text("mine = 1\n")
    (tmp_path / "study.py").write_text(f"from {name} import mine\nimport flexarm\n")
    done = python(tmp_path, "study.py")
    assert done.returncode == 1
    said = done.stderr.splitlines()[-2:]
    assert f"'{name}' was imported before from {tmp_path / name}.py" in said[0]
    assert said[1] == "  rename that file"


@pytest.mark.parametrize("name", ["diagnosis", "scenarios"])
def test_another_distribution_installed_over_ours_is_named(tmp_path: Path, name: str) -> None:
    site = tmp_path / "site-packages"
    for package in ("flexarm", *OURS):
        shutil.copytree(ROOT / package, site / package, ignore=shutil.ignore_patterns("__pycache__", "*.yaml", "*.csv"))
    (site / name / "__init__.py").write_text('"""Something else."""\n')
    (site / f"{name}-1.0.dist-info").mkdir()
    (site / f"{name}-1.0.dist-info" / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-kit\nVersion: 1.0\n")
    (site / f"{name}-1.0.dist-info" / "top_level.txt").write_text(f"{name}\n")
    done = python(tmp_path, "-c", "import flexarm", path=site)
    assert done.returncode == 1
    assert f"{site / name / '__init__.py'} is not flexarm's: the distribution '{name}-kit' has a package" in done.stderr
    assert "virtual environment of its own" in done.stderr


def test_a_folder_of_scenarios_is_not_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "mine.yaml").write_text("schema: 1\n")
    done = python(tmp_path, "-c", "import flexarm; print(flexarm.load('srv02-bare').name)")
    assert (done.stdout.strip(), done.stderr) == ("srv02-bare", "")
