"""The win64 binary gives what FMPy gives with the linux64 one, under Wine where it is installed.

That of the python backend starts a stand-in for Python there, which shows that its pipes and its messages are right.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description

import fmu
from engine.compile import compiler
from engine.model import Model
from engine.simulate import Drive
from fmu.source import headers
from fmu.verify import references
from tests.fmu.makers import python_arm


@pytest.fixture(scope="module")
def windows_host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small host, cross-compiled by zig; this much works everywhere."""
    folder = tmp_path_factory.mktemp("windows")
    for name, text in headers(2).items():
        (folder / name).write_text(text)
    shutil.copy(Path(__file__).parent / "windows_host.c", folder)
    command = [*compiler(), "-target", "x86_64-windows-gnu", "-O2", "-o", "host.exe", "windows_host.c"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "host.exe"


def test_the_host_is_a_windows_program(windows_host: Path) -> None:
    assert windows_host.read_bytes()[:2] == b"MZ"


class Wine:
    """Runs Windows programs in a Windows of their own, made on first use."""

    def __init__(self, program: str, folder: Path) -> None:
        settings = {"WINEPREFIX": str(folder / "prefix"), "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree,mshtml="}
        self.program, self.folder, self.environment = program, folder, os.environ | settings

    def run(
        self, *words: object, timeout: float = 120, code: int = 0, variables: dict[str, str] | None = None
    ) -> list[str]:
        """Words printed. Wine's server outlives the program and would keep a pipe open, so the output goes to files.

        With another exit code than 0 expected, those of the standard error.
        """
        out, err = self.folder / "out", self.folder / "err"
        with out.open("w") as to_out, err.open("w") as to_err:
            command = [self.program, *map(str, words)]
            run = subprocess.run(
                command,
                stdout=to_out,
                stderr=to_err,
                timeout=timeout,
                env=self.environment | (variables or {}),
                check=False,
            )
        assert run.returncode == code, err.read_text()
        return (err if code else out).read_text().split()

    def close(self) -> None:
        """End its server and remove its files, which are many."""
        server = shutil.which("wineserver")
        if server:
            subprocess.run([server, "-k"], env=self.environment, timeout=60, check=False)
            subprocess.run([server, "-w"], env=self.environment, timeout=60, check=False)
        shutil.rmtree(self.folder, ignore_errors=True)


@pytest.fixture(scope="module")
def wine() -> Iterator[Wine]:
    program = shutil.which("wine64") or shutil.which("wine")
    if program is None:
        pytest.skip("wine is not installed: apt-get install --no-install-recommends wine wine64")
    made = Wine(program, Path(tempfile.mkdtemp(prefix="flexarm-wine-")))
    yield made
    made.close()


@pytest.mark.parametrize("name", ["smooth_model", "switching_model", "timed_model"])
def test_the_windows_binary_under_wine(
    name: str,
    windows_host: Path,
    exported: Any,
    wine: Wine,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    record_property: Callable[[str, object], None],
) -> None:
    model: Model = request.getfixturevalue(name)
    path = exported(model, ("linux64", "win64"))
    extract(str(path), str(tmp_path))
    library = next((tmp_path / "binaries" / "win64").glob("*.dll"))
    description = read_model_description(str(path))
    inputs = references(description, "input")
    numbers = [*(inputs or [0]), *references(description, "output")]
    given = np.array([float(word) for word in wine.run(windows_host, library, description.guid, 500, *numbers)])
    expected = fmu.cosim(path, 0.5, drive=Drive([0.0], [[1.5]]) if inputs else None).values[-1]
    assert np.abs(expected).max() > 0.01
    record_property("largest difference", f"{np.abs(given - expected).max():.1e}")
    np.testing.assert_allclose(given, expected, rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def standin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program for Windows that answers as the Python process of an FMU does."""
    folder = tmp_path_factory.mktemp("stand-in")
    shutil.copy(Path(__file__).parent / "standin.c", folder)
    command = [*compiler(), "-target", "x86_64-windows-gnu", "-O2", "-o", "python.exe", "standin.c"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "python.exe"


def test_python_in_a_process_under_wine(windows_host: Path, standin: Path, wine: Wine, tmp_path: Path) -> None:
    path = python_arm(tmp_path / "made", platforms=["win64"])
    extract(str(path), str(tmp_path / "unpacked"))
    library = next((tmp_path / "unpacked" / "binaries" / "win64").glob("*.dll"))
    description = read_model_description(str(path))
    inputs, outputs = references(description, "input"), references(description, "output")
    command = (windows_host, library, description.guid, 20, *inputs, *outputs)
    chosen = {"FLEXARM_PYTHON": "Z:" + str(standin).replace("/", "\\")}
    given = [float(word) for word in wine.run(*command, variables=chosen)]
    assert given == pytest.approx([20 * 1.5e-3] * len(outputs), rel=1e-12)
    found = wine.run(*command, variables={"WINEPATH": "Z:" + str(standin.parent).replace("/", "\\")})
    assert [float(word) for word in found] == given
    assert "only stands in." in " ".join(wine.run(*command, code=4, variables=chosen | {"STANDIN": "refuses"}))
    wine.run(*command, code=6, variables=chosen | {"STANDIN": "dies"})
    said = " ".join(wine.run(*command, code=4))
    assert "no Python runs this FMU" in said
    assert "python.exe on the PATH: cannot be started (there is none)" in said
