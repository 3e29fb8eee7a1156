"""Other importers: libcosimpy and ecospy give what FMPy gives and run the SSP of a split scenario.

They are skipped where they are not installed or do not load.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description

import fmu
from engine.model import Model
from engine.simulate import Drive, simulate
from flexarm.cut import cut
from flexarm.splitting.split import split
from fmu.ssp import read
from fmu.verify import reference, references
from scenarios.load import load


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


@pytest.mark.parametrize(
    ("programs", "version", "clean"),
    [
        (("fmuCheck", "fmuCheck.linux64"), 2, " 0 error"),
        (("VDMCheck2.sh", "VDMCheck2"), 2, "No errors found"),
        (("VDMCheck3.sh", "VDMCheck3"), 3, "No errors found"),
    ],
)
def test_other_checkers_find_no_error(
    programs: tuple[str, ...], version: int, clean: str, switching_model: Model, tmp_path: Path
) -> None:
    tool = next((found for name in programs if (found := shutil.which(name))), None)
    if tool is None:
        pytest.skip(f"{programs[0]} is not installed")
    path = fmu.export(switching_model, tmp_path / "m.fmu", platforms=["linux64"], version=version)
    run = subprocess.run([tool, str(path)], capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert clean in run.stdout + run.stderr


class Package:
    """An SSP without connectors of its own, what its FMUs are given and asked for, and the scenario it was made from.

    Cut at the spring between gearbox and link. Both importers hold values over a step; the parts carry motion and
    torque on between, so that the error is in proportion to the square of the step.
    """

    stop, steps = 0.05, (1e-3, 5e-4, 2.5e-4)

    def __init__(self, folder: Path) -> None:
        made = cut(load("srv02-3mass-b4"), "export")
        groups = {"link": ["link", "bearing"]}
        wired = read(split(made, folder / "whole.ssp", groups, platforms=["linux64"]))
        self.path = split(made, folder / "bare.ssp", groups, platforms=["linux64"], bare=True)
        assert read(self.path).connectors == ()
        self.inputs = [end for start, end in wired.connections if not start[0]]
        self.outputs = [start for start, end in wired.connections if not end[0]]
        self.references: dict[str, dict[str, int]] = {}
        with zipfile.ZipFile(self.path) as archive:
            for name, source in wired.sources.items():
                variables = read_model_description(archive.extract(source, folder)).modelVariables
                self.references[name] = {variable.name: variable.valueReference for variable in variables}
        run = simulate(made.model, self.stop, 1e-3, drive=Drive([0.0], [[1.0]]), internal_step=1e-5)
        self.expected = run.values[-1]

    def in_libcosimpy(self, step: float) -> np.ndarray:
        execution, observer = _imported("libcosimpy.CosimExecution"), _imported("libcosimpy.CosimObserver")
        run = execution.CosimExecution.from_ssp_file(str(self.path), round(step * 1e9))
        index = {name: run.slave_index_from_instance_name(name) for name in self.references}
        for name, variable in self.inputs:
            assert run.real_initial_value(index[name], self.references[name][variable], 1.0)
        seen = observer.CosimObserver.create_last_value()
        run.add_observer(seen)
        assert run.simulate_until(round(self.stop * 1e9))
        asked = [(index[name], self.references[name][variable]) for name, variable in self.outputs]
        return np.array([seen.last_real_values(i, [vr])[0] for i, vr in asked])

    def in_ecospy(self, step: float) -> np.ndarray:
        with _imported("ecospy").EcosSimulation(step, ssp_path=str(self.path)) as run:
            for name, variable in self.inputs:
                run.set_real(f"{name}::{variable}", 1.0)
            run.init()
            run.step(round(self.stop / step))
            return np.array([run.get_real(f"{name}::{variable}") for name, variable in self.outputs])


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Package:
    return Package(tmp_path_factory.mktemp("ssp"))


@pytest.mark.parametrize("importer", ["libcosimpy", "ecospy"])
def test_an_ssp_converges_to_the_scenario(
    importer: str, package: Package, record_property: Callable[[str, object], None]
) -> None:
    run = {"libcosimpy": package.in_libcosimpy, "ecospy": package.in_ecospy}[importer]
    found = np.array([run(step) for step in package.steps])
    errors = np.abs(found - package.expected).max(axis=1)
    orders = np.log2(errors[:-1] / errors[1:])
    limit = (4 * found[-1] - found[-2]) / 3
    record_property(f"{importer} error at 0.25 ms", f"{errors[-1]:.4f} of {np.abs(package.expected).max():.2f} rad/s")
    record_property(f"{importer} orders", ", ".join(f"{order:.2f}" for order in orders))
    assert (np.abs(orders - 2) < 0.3).all(), (errors, orders)
    assert errors[0] < 2e-2 * np.abs(package.expected).max()
    assert np.abs(limit - package.expected).max() < 1e-3


def test_importers_agree_on_an_ssp(package: Package) -> None:
    assert np.abs(package.in_libcosimpy(2e-5) - package.in_ecospy(2e-5)).max() < 1e-9
