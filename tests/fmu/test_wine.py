"""The win64 binary gives what FMPy gives with the linux64 one (check 4), under Wine where it is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
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


@pytest.mark.parametrize("name", ["smooth_model", "switching_model"])
def test_the_windows_binary_under_wine(
    name: str, windows_host: Path, exported: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    wine = shutil.which("wine64") or shutil.which("wine")
    if wine is None:
        pytest.skip("wine is not installed: apt-get install --no-install-recommends wine wine64")
    model: Model = request.getfixturevalue(name)
    path = exported(model, ("linux64", "win64"))
    extract(str(path), str(tmp_path))
    library = next((tmp_path / "binaries" / "win64").glob("*.dll"))
    description = read_model_description(str(path))
    numbers = [references(description, "input")[0], *references(description, "output")]
    words = [wine, str(windows_host), str(library), description.guid, "500", *map(str, numbers)]
    environment = os.environ | {"WINEDEBUG": "-all", "WINEPREFIX": str(tmp_path / "prefix")}
    run = subprocess.run(words, capture_output=True, text=True, timeout=300, env=environment, check=False)
    assert run.returncode == 0, run.stderr
    expected = fmu.cosim(path, 0.5, drive=Drive([0.0], [[1.5]])).values[-1]
    np.testing.assert_allclose([float(line) for line in run.stdout.split()], expected, rtol=1e-9, atol=1e-9)
