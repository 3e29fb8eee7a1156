"""Every shipped scenario in Model Exchange at the tolerance that importers use, against its Co-Simulation.

At a relative tolerance of 1e-4 the nominal values of the states, and what is reported of events, decide the result;
at tight tolerances neither shows. fmusim, of the Reference FMUs, is found by FLEXARM_FMUSIM or on PATH, PyFMI in the
Python that FLEXARM_PYFMI names.
"""

from __future__ import annotations

import csv
import functools
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

import fmu
import scenarios
from engine.model import Model
from fmu.variables import flat
from scenarios.load import load

TOLERANCE, STOP, EVERY = 1e-4, 2.0, 5e-3

SHIPPED = sorted(file.stem for file in Path(scenarios.__file__).parent.glob("*.yaml"))


@functools.cache
def _model(name: str) -> Model:
    return load(name).build()


@pytest.fixture(scope="module", params=[2, 3])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("exchange")

    @functools.cache
    def make(name: str) -> Path:
        return fmu.export(_model(name), folder / f"{name}.fmu", platforms=["linux64"], version=request.param)

    return make


def _slave(path: Path) -> Any:
    return simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=STOP, output_interval=EVERY, step_size=1e-3)


def _worst(name: str, expected: Any, given: Any) -> tuple[float, str]:
    """Largest difference over a signal's range, and the signal; rows that are not at the same instant are left out."""
    found = []
    for output in _model(name).outputs:
        a, b = expected[flat(output.name)], given[flat(output.name)]
        found.append((float(np.abs(a - b).max() / (np.ptp(a) or 1.0)), output.name))
    return max(found)


@pytest.mark.parametrize("name", SHIPPED)
def test_cvode_at_the_usual_tolerance_agrees_with_co_simulation(
    name: str, made: Callable[[str], Path], record_property: Callable[[str, object], None]
) -> None:
    path = made(name)
    rows = simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=STOP,
        output_interval=EVERY,
        relative_tolerance=TOLERANCE,
        record_events=False,
    )
    worst, signal = _worst(name, _slave(path), rows)
    record_property("error", f"{100 * worst:.2g} %")
    assert worst <= 0.01, signal


@pytest.mark.parametrize("name", SHIPPED)
def test_fmusim_agrees_with_co_simulation(
    name: str, made: Callable[[str], Path], tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    tool = os.environ.get("FLEXARM_FMUSIM") or shutil.which("fmusim")
    if not tool:
        pytest.skip("fmusim is not installed: build it from the sources of the Reference FMUs")
    path, result = made(name), tmp_path / "rows.csv"
    command = [tool, "--interface-type", "me", "--solver", "cvode", "--tolerance", str(TOLERANCE), "--stop-time"]
    command += [str(STOP), "--output-interval", str(EVERY), "--output-file", str(result), str(path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=3600, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    expected = _slave(path)
    worst, signal = _worst(name, expected, _last_at(_rows(result), expected["time"]))
    record_property("error", f"{100 * worst:.2g} %")
    assert worst <= 0.01, signal


def _rows(path: Path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8", newline="") as handle:
        lines = list(csv.reader(handle))
    # fmusim writes a question mark for a clock, which has no value.
    values = np.array([[float("nan" if cell == "?" else cell) for cell in line] for line in lines[1:]])
    return {name.strip('"'): values[:, k] for k, name in enumerate(lines[0])}


def _last_at(rows: dict[str, np.ndarray], times: np.ndarray) -> dict[str, np.ndarray]:
    """Rows at the given instants, the last of several: an importer that records events writes both sides of a jump."""
    index = np.searchsorted(rows["time"], times + 1e-9, side="right") - 1
    assert np.abs(rows["time"][index] - times).max() < 1e-8
    return {name: values[index] for name, values in rows.items()}


_PYFMI = """
import sys, numpy as np
from pyfmi import load_fmu
path, result, stop, every, tolerance = sys.argv[1], sys.argv[2], *map(float, sys.argv[3:6])
model = load_fmu(path, kind="ME", log_level=2)
options = model.simulate_options()
options["ncp"] = round(stop / every)
options["CVode_options"]["rtol"] = tolerance
options["CVode_options"]["verbosity"] = 50
run = model.simulate(final_time=stop, options=options)
names = sys.argv[6:]
np.savetxt(result, np.column_stack([run["time"], *[run[n] for n in names]]), delimiter=",",
           header=",".join(["time", *names]), comments="", fmt="%.17g")
"""


@pytest.mark.parametrize("name", SHIPPED)
def test_pyfmi_agrees_with_co_simulation(
    name: str, made: Callable[[str], Path], tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    python = os.environ.get("FLEXARM_PYFMI")
    if not python:
        pytest.skip("PyFMI is not installed: FLEXARM_PYFMI names no Python that has it")
    path, result = made(name), tmp_path / "rows.csv"
    names = list(dict.fromkeys(flat(output.name) for output in _model(name).outputs))
    command = [python, "-c", _PYFMI, str(path), str(result), str(STOP), str(EVERY), str(TOLERANCE), *names]
    run = subprocess.run(command, capture_output=True, text=True, timeout=3600, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    expected = _slave(path)
    worst, signal = _worst(name, expected, _last_at(_rows(result), expected["time"]))
    record_property("error", f"{100 * worst:.2g} %")
    assert worst <= 0.01, signal
