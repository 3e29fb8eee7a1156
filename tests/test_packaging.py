"""The wheel works where a user has folders of the same names, and carries its data files."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("engine", "blocks", "scenarios", "fmu", "diagnosis", "flexarm")
DATA = {".c", ".h", ".yaml", ".csv", ".j2", ".css", ".js"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("flexarm-*.whl")
    return built


def origins(site: Path, folder: Path, script: Path | None = None) -> list[Path]:
    """Where the root packages come from when imported in ``folder`` with the wheel unpacked in ``site``."""
    code = f"import importlib\nfor n in {PACKAGES!r}: print(importlib.import_module(n).__file__)"
    if script is not None:
        script.write_text(code)
    start = [str(script)] if script is not None else ["-c", code]
    command = [sys.executable, *start]
    done = subprocess.run(
        command, cwd=folder, env={"PYTHONPATH": str(site)}, check=True, capture_output=True, text=True
    )
    return [Path(line) for line in done.stdout.split()]


def test_wheel_holds_every_package_with_its_data(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    expected = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in DATA | {".py"} or path.name == "py.typed"
    }
    assert {f"{package}/py.typed" for package in PACKAGES} <= expected
    assert expected <= names
    roots = {name.split("/")[0] for name in names}
    assert roots == {*PACKAGES, f"flexarm-{version()}.dist-info"}


def test_wheel_beside_a_users_own_folders(wheel: Path, tmp_path: Path) -> None:
    site, work = tmp_path / "site", tmp_path / "work"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    (work / "scenarios").mkdir(parents=True)
    (work / "scenarios" / "mine.yaml").write_text("schema: 1\n")
    expected = [site / package / "__init__.py" for package in PACKAGES]
    assert origins(site, work) == expected
    # A regular package of the user's is no hindrance to the command, which is a script elsewhere.
    (work / "scenarios" / "__init__.py").touch()
    assert origins(site, work, script=tmp_path / "flexarm-command.py") == expected


def version() -> str:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return str(project["version"])


LOGGERS = ("ros", "matlab", "hdf5", "mdf", "tdms", "excel")


def wanted_lines(project: dict[str, Any], *extras: str) -> list[str]:
    """Requirements of the project and of extras, without references to other extras."""
    lines = [line for extra in extras for line in project["optional-dependencies"][extra]]
    return [line for line in [*project["dependencies"], *lines] if not line.startswith("flexarm[")]


def test_the_extra_for_loggers_is_all_of_theirs() -> None:
    from diagnosis.recordings.loggers.host import FORMATS

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["optional-dependencies"]["loggers"] == [f"flexarm[{','.join(LOGGERS)}]"]
    assert {form.extra for form in FORMATS.values()} == set(LOGGERS)


def test_lock_file_holds_names_and_versions_only() -> None:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.+!]*", pin) for pin in pins)
    locked = {pin.partition("==")[0] for pin in pins}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = wanted_lines(project, "dev", "loggers", *LOGGERS)
    names = {re.sub(r"[-_.]+", "-", re.split(r"[<>=\[ ]", line)[0]).lower() for line in wanted}
    assert names <= locked


def test_every_dependency_has_a_lower_and_an_upper_bound() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = wanted_lines(project, *project["optional-dependencies"])
    assert all(">=" in line and ",<" in line for line in wanted)


def test_three_places_name_one_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {version()}\n" in citation
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert "## [Unreleased]" in changes
    assert re.search(rf"^## \[{re.escape(version())}\] - \d{{4}}-\d{{2}}-\d{{2}}$", changes, re.MULTILINE)
