"""Arrays of FMI 3: the same model with numbered states and parameters as arrays, against its scalars."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Model, FMU3Slave

import flexarm
import fmu
from engine.errors import FlexarmError
from fmu.arrays import arrays
from fmu.variables import PARAMETER, STATE, FmuVariable

NAMES = ["reference-b", "harmonic-drive-arm", "two-link-flexible"]
"""Modes of a link; nodes of a lumped link, shown as twists; two links of a chain, and parameters of a chain."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("arrays")

    def make(name: str, with_arrays: bool) -> Path:
        path = folder / f"{name}{'-arrays' if with_arrays else ''}.fmu"
        if not path.exists():
            flexarm.export(name, path, version=3, platforms=["linux64"], arrays=with_arrays)
        return path

    return make


class Instance:
    """An instance whose values go by name; those of an array under the array's."""

    def __init__(self, path: Path, folder: Path, exchange: bool) -> None:
        extract(str(path), str(folder))
        self.description: Any = read_model_description(str(path))
        self.messages: list[str] = []
        kind = self.description.modelExchange if exchange else self.description.coSimulation
        self.fmu: Any = (FMU3Model if exchange else FMU3Slave)(
            guid=self.description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=kind.modelIdentifier,
            instanceName="instance",
        )
        self.fmu.instantiate(logMessage=lambda e, s, c, text: self.messages.append(text.decode()), loggingOn=True)
        self.known = {v.name: v for v in self.description.modelVariables}

    def size(self, names: list[str]) -> int:
        return sum(int(np.prod(self.known[name].shape or (1,))) for name in names)

    def references(self, names: list[str]) -> list[int]:
        return [self.known[name].valueReference for name in names]

    def get(self, names: list[str]) -> list[float]:
        return list(self.fmu.getFloat64(self.references(names), self.size(names)))

    def set(self, names: list[str], values: list[float]) -> None:
        self.fmu.setFloat64(self.references(names), values)

    def names(self, kind: str) -> list[str]:
        states = [v.derivative.name for v in self.description.modelVariables if v.derivative is not None]
        if kind == "state":
            return states
        if kind == "derivative":
            return [f"der({name})" for name in states]
        return [v.name for v in self.description.modelVariables if v.causality == kind and v.type == "Float64"]

    def jacobian(self) -> np.ndarray:
        """Of derivatives and outputs by states and inputs, column by column."""
        knowns, unknowns = self.names("state") + self.names("input"), self.names("derivative") + self.names("output")
        columns = []
        n = self.size(knowns)
        for k in range(n):
            seed = [float(j == k) for j in range(n)]
            columns.append(
                self.fmu.getDirectionalDerivative(
                    self.references(unknowns), self.references(knowns), seed, self.size(unknowns)
                )
            )
        return np.array(columns).T


def _directional(instance: Instance) -> None:
    """FMPy's own call takes one value for each unknown; this one takes the number of values."""
    raw = instance.fmu

    def call(unknowns: list[int], knowns: list[int], seed: list[float], values: int) -> list[float]:
        found = (ctypes.c_double * values)()
        raw.fmi3GetDirectionalDerivative(
            raw.component,
            (ctypes.c_uint32 * len(unknowns))(*unknowns),
            len(unknowns),
            (ctypes.c_uint32 * len(knowns))(*knowns),
            len(knowns),
            (ctypes.c_double * len(seed))(*seed),
            len(seed),
            found,
            values,
        )
        return list(found)

    raw.getDirectionalDerivative = call


def _start(instance: Instance, exchange: bool) -> None:
    instance.fmu.enterInitializationMode(startTime=0.0)
    instance.fmu.exitInitializationMode()
    if exchange:
        instance.fmu.updateDiscreteStates()
        instance.fmu.enterContinuousTimeMode()


@pytest.mark.parametrize("name", NAMES)
def test_description_is_valid_and_holds_the_same_states(name: str, made: Any) -> None:
    assert fmu.validate(made(name, True)) == []
    with_arrays, scalar = (read_model_description(str(made(name, kind))) for kind in (True, False))
    assert with_arrays.numberOfContinuousStates == scalar.numberOfContinuousStates
    shown = [v for v in with_arrays.modelVariables if v.shape]
    assert {v.causality for v in shown} == {"local", "parameter"}
    for variable in shown:
        assert variable.start is None or len(variable.start.split()) == variable.shape[0]
        assert variable.derivative is None or variable.derivative.shape == variable.shape
    left = len(with_arrays.modelVariables) + sum(v.shape[0] - 1 for v in shown)
    assert left == len(scalar.modelVariables)


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("name", NAMES)
def test_fmpy_gives_the_same_results(name: str, kind: str, made: Any) -> None:
    given = {"fmi_type": kind, "stop_time": 0.5, "output_interval": 5e-3, "relative_tolerance": 1e-4}
    expected = simulate_fmu(str(made(name, False)), **given, record_events=False)
    rows = simulate_fmu(str(made(name, True)), **given, record_events=False)
    assert rows.dtype.names == expected.dtype.names
    assert all(np.array_equal(rows[column], expected[column]) for column in rows.dtype.names)


def test_fmpy_records_and_sets_arrays(made: Any) -> None:
    """Poses of both modes set at once, and recorded: the first row is what was set."""
    start = {"link.mode.position": "1e-3 2e-4 -1e-4 5e-5", "link.damping_ratio": "0.02 0.02 0.03 0.03"}
    rows = simulate_fmu(
        str(made("reference-b", True)), start_values=start, stop_time=0.1, output=["link.mode.position"]
    )
    assert rows["link.mode.position"][0] == pytest.approx([1e-3, 2e-4, -1e-4, 5e-5], rel=1e-15)
    scalar = {f"link.mode{k + 1}.position": v for k, v in enumerate([1e-3, 2e-4, -1e-4, 5e-5])}
    scalar |= {f"link.damping_ratio[{k + 1}]": v for k, v in enumerate([0.02, 0.02, 0.03, 0.03])}
    expected = simulate_fmu(
        str(made("reference-b", False)), start_values=scalar, stop_time=0.1, output=["link.mode3.position"]
    )
    assert np.array_equal(rows["link.mode.position"][:, 2], expected["link.mode3.position"])


@pytest.mark.parametrize("name", NAMES)
def test_values_and_directional_derivatives_are_those_of_the_scalars(name: str, made: Any, tmp_path: Path) -> None:
    found = []
    for kind in (True, False):
        instance = Instance(made(name, kind), tmp_path / str(kind), exchange=True)
        _directional(instance)
        _start(instance, exchange=True)
        rng = np.random.default_rng(1)
        n = instance.size(instance.names("state"))
        instance.fmu.setContinuousStates((ctypes.c_double * n)(*(1e-3 * rng.standard_normal(n))), n)
        values = instance.get([*instance.names("state"), *instance.names("derivative")])
        found.append((values, instance.jacobian()))
        instance.fmu.freeInstance()
    assert found[0][0] == found[1][0]
    assert np.array_equal(found[0][1], found[1][1])
    assert np.count_nonzero(found[0][1]) > 10


def test_tuning_an_array_is_tuning_its_elements(made: Any, tmp_path: Path) -> None:
    rows = []
    for kind in (True, False):
        instance = Instance(made("two-link-flexible", kind), tmp_path / str(kind), exchange=False)
        _start(instance, exchange=False)
        names = ["arm.damping_ratio"] if kind else [f"arm.damping_ratio[{k}]" for k in range(1, 7)]
        instance.fmu.doStep(0.0, 0.05)
        instance.set(names, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        assert instance.get(names) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
        instance.fmu.doStep(0.05, 0.05)
        rows.append(instance.get(instance.names("output")))
        instance.fmu.freeInstance()
    assert rows[0] == rows[1]


def test_refusals_change_nothing(made: Any, tmp_path: Path) -> None:
    instance = Instance(made("reference-b", True), tmp_path, exchange=False)
    [array] = instance.references(["link.damping_ratio"])
    for references, values, words in (
        ([array], [0.1], "a value for each element: 4, not 1"),
        ([array], [0.1] * 5, "4, not 5"),
        ([array + 1], [0.1], "an element of an array has no reference of its own"),
        ([array], [0.1, 0.2, 0.3, -1.0], "link.damping_ratio[4] cannot be -1"),
        ([array, 10**6], [0.1] * 5, "value reference 1000000"),
    ):
        instance.messages.clear()
        with pytest.raises(FMICallException):
            instance.fmu.setFloat64(references, values)
        assert words in instance.messages[-1]
    assert instance.get(["link.damping_ratio"]) == [0.01] * 4
    instance.fmu.freeInstance()


def test_fmusim_reads_arrays(made: Any, tmp_path: Path) -> None:
    tool = os.environ.get("FLEXARM_FMUSIM") or shutil.which("fmusim")
    if not tool:
        pytest.skip("fmusim is not installed: build it from the sources of the Reference FMUs")
    for kind in ("cs", "me"):
        result = tmp_path / f"{kind}.csv"
        command = [tool, "--interface-type", kind, "--stop-time", "0.2", "--output-file", str(result)]
        command += ["--solver", "cvode"] if kind == "me" else []
        run = subprocess.run(
            [*command, str(made("harmonic-drive-arm", True))], capture_output=True, text=True, timeout=3600, check=False
        )
        assert run.returncode == 0, run.stdout + run.stderr


def test_fmi_2_has_no_arrays(tmp_path: Path) -> None:
    with pytest.raises(FlexarmError, match="FMI 2 has no arrays"):
        flexarm.export("reference-b", tmp_path / "x.fmu", arrays=True)
    assert not list(tmp_path.iterdir())


def _variables(*named: tuple[str, str]) -> list[FmuVariable]:
    return [FmuVariable(name, name, kind, k, start=0.0) for k, (name, kind) in enumerate(named)]


def test_what_is_an_array() -> None:
    """Numbers that a block gives inside itself, from 1 and without a gap; blocks with numbers are no elements."""
    states = ["drive1.shaft.angle", "drive2.shaft.angle", "arm.mode1.speed", "arm.mode2.speed"]
    states += ["b.mode2.x", "b.mode3.x", "single.mode1.speed", "sub.drive1.shaft.angle", "sub.drive2.shaft.angle"]
    parameters = ["arm.length[1]", "one.length[1]", "gap[1]", "gap[3]", "link1.mass", "link2.mass"]
    found = arrays(_variables(*[(s, STATE) for s in states], *[(p, PARAMETER) for p in parameters]))
    assert [(array.name, array.size) for array in found] == [
        ("arm.mode.speed", 2),
        ("arm.length", 1),
        ("one.length", 1),
    ]
