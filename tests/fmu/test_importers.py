"""Other importers give what FMPy gives (check 4): libcosimpy and ecospy, where they are installed and load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description

import fmu
from engine.model import Model
from engine.simulate import Drive
from fmu.verify import reference, references


def _imported(name: str) -> Any:
    try:
        return __import__(name, fromlist=["*"])
    except ImportError as error:
        pytest.skip(f"{name} is not installed: {error}")
    except OSError as error:
        pytest.skip(f"{name} does not load: {error}")


def _expected(path: Any, drive: Drive) -> np.ndarray:
    return fmu.cosim(path, 0.5, 1e-3, drive=drive).values[-1]  # type: ignore[no-any-return]


@pytest.mark.parametrize("name", ["smooth_model", "switching_model"])
def test_libcosimpy(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    cosim = _imported("libcosimpy")
    execution, manipulator = _imported("libcosimpy.CosimExecution"), _imported("libcosimpy.CosimManipulator")
    observer, slave = _imported("libcosimpy.CosimObserver"), _imported("libcosimpy.CosimSlave")
    assert cosim
    model: Model = request.getfixturevalue(name)
    path = exported(model)
    description = read_model_description(str(path))
    run = execution.CosimExecution.from_step_size(1_000_000)
    index = run.add_local_slave(slave.CosimLocalSlave(fmu_path=str(path), instance_name="arm"))
    seen = observer.CosimObserver.create_last_value()
    run.add_observer(seen)
    hand = manipulator.CosimManipulator.create_override()
    run.add_manipulator(hand)
    hand.slave_real_values(index, references(description, "input"), [1.5])
    assert run.simulate_until(500_000_000)
    given = seen.last_real_values(index, references(description, "output"))
    assert np.allclose(given, _expected(path, Drive([0.0], [[1.5]])), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["smooth_model", "switching_model"])
def test_ecospy(name: str, exported: Any, request: pytest.FixtureRequest) -> None:
    ecos = _imported("ecospy")
    model: Model = request.getfixturevalue(name)
    path = exported(model)
    description = read_model_description(str(path))
    u, y = references(description, "input"), references(description, "output")
    names = {v.valueReference: v.name for v in description.modelVariables if v.type == "Real"}
    assert reference(description, names[u[0]]) == u[0]
    with ecos.EcosSimulationStructure() as structure:
        structure.add_model("arm", str(path))
        structure.add_parameter_set("start", {f"arm::{names[u[0]]}": 1.5})
        with ecos.EcosSimulation(structure=structure, step_size=1e-3) as run:
            run.init(parameter_set="start")
            run.step(500)
            given = [run.get_real(f"arm::{names[r]}") for r in y]
    assert np.allclose(given, _expected(path, Drive([0.0], [[1.5]])), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", ["smooth_model", "switching_model"])
def test_fmutool_finds_no_error(name: str, version: int, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    tool = Path(sys.executable).parent / "fmutool"
    if not tool.is_file():
        pytest.skip("fmutool is not installed (fmu-manipulation-toolbox)")
    path = fmu.export(request.getfixturevalue(name), tmp_path / "m.fmu", platforms=["linux64"], version=version)
    run = subprocess.run([str(tool), "-input", str(path), "-check"], capture_output=True, text=True, check=False)
    said = run.stdout + run.stderr
    assert f"compliant with FMI-{version}" in said
    assert "ERROR" not in said
