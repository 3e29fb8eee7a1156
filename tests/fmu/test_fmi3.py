"""The FMI 3.0 head: the same core, the same numbers, the same refusals."""

from __future__ import annotations

import ctypes
import math
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, fmi3, read_model_description
from fmpy.fmi1 import FMICallException

import fmu
from engine.model import Model
from engine.simulate import Drive
from fmu.source import headers
from fmu.verify import reference, references


@pytest.fixture(scope="module")
def exported3(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Model], Path]:
    folder = tmp_path_factory.mktemp("fmi3")
    made: dict[str, Path] = {}

    def make(model: Model) -> Path:
        if model.name not in made:
            name = model.name.replace(" ", "_") + ".fmu"
            made[model.name] = fmu.export(model, folder / name, platforms=["linux64"], version=3)
        return made[model.name]

    return make


@contextmanager
def slave3(path: Path, folder: Path) -> Iterator[tuple[Any, Any, list[str]]]:
    messages: list[str] = []
    description = read_model_description(str(path))
    extract(str(path), str(folder))
    instance = fmi3.FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="instance",
    )

    def log(environment: Any, status: int, category: bytes, message: bytes) -> None:
        messages.append(message.decode())

    instance.instantiate(logMessage=log, loggingOn=True)
    try:
        yield instance, description, messages
    finally:
        instance.freeInstance()


def _run(instance: Any, description: Any, first: int, last: int) -> np.ndarray:
    u, y = references(description, "input"), references(description, "output")
    rows = []
    for k in range(first, last):
        instance.setFloat64(u, [3 * math.sin(0.07 * (k - k % 5))] * len(u))
        instance.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
        rows.append(instance.getFloat64(y))
    return np.array(rows)


def _start(instance: Any, stop: float | None = None) -> None:
    instance.enterInitializationMode(startTime=0.0, stopTime=stop)
    instance.exitInitializationMode()


@pytest.mark.parametrize("name", ["smooth_model", "switching_model", "timed_model"])
def test_valid_and_equal_to_fmi2(
    name: str, exported: Any, exported3: Any, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    model = request.getfixturevalue(name)
    path = exported3(model)
    assert fmu.validate(path) == []
    k = np.arange(0, 301)
    wave = 3 * np.sin(0.07 * (k - k % 5))
    drive = Drive(k * 1e-3, wave[:, None]) if model.inputs else None
    # FMI 2 rows hold the inputs of their own instant; set the same before reading.
    expected = fmu.cosim(exported(model), 0.3, 1e-3, drive=drive).values[1:]
    with slave3(path, tmp_path) as (instance, description, _):
        u, y = references(description, "input"), references(description, "output")
        _start(instance)
        for j in range(300):
            instance.setFloat64(u, [wave[j]] * len(u))
            instance.doStep(currentCommunicationPoint=j * 1e-3, communicationStepSize=1e-3)
            instance.setFloat64(u, [wave[j + 1]] * len(u))
            assert np.array_equal(instance.getFloat64(y), expected[j])


@pytest.mark.skipif(sys.platform != "linux", reason="looks into the linux64 binary")
def test_symbols_are_exactly_the_functions_of_fmi3(switching_model: Model, exported3: Any, tmp_path: Path) -> None:
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    with zipfile.ZipFile(exported3(switching_model)) as archive:
        archive.extractall(tmp_path)
    [binary] = tmp_path.glob("binaries/x86_64-linux/*.so")
    run = subprocess.run([nm, "-D", "--defined-only", binary], capture_output=True, text=True, check=True).stdout
    standard = set(re.findall(r"FMI3_Export fmi3\w+TYPE\s+(fmi3\w+);", headers(3)["fmi3Functions.h"]))
    assert len(standard) == 75
    assert {line.split()[-1] for line in run.splitlines()} == standard


def test_states_reset_and_serialisation(switching_model: Model, exported3: Any, tmp_path: Path) -> None:
    with slave3(exported3(switching_model), tmp_path) as (instance, description, messages):
        _start(instance)
        fresh = _run(instance, description, 0, 200)
        state = instance.getFMUState()
        blob = instance.serializeFMUState(state)
        onward = _run(instance, description, 200, 300)
        instance.setFMUState(state)
        assert np.array_equal(_run(instance, description, 200, 300), onward)
        instance.setFloat64([reference(description, "gear.ratio")], [50.0])
        instance.reset()
        _start(instance)
        assert np.array_equal(_run(instance, description, 0, 200), fresh)
        instance.setFMUState(instance.deserializeFMUState(blob))
        assert np.array_equal(_run(instance, description, 200, 300), onward)
        with pytest.raises(FMICallException):
            instance.deserializeFMUState(blob[:-1] + b"!")
        assert "damaged" in messages[-1]
        instance.freeFMUState(state)


def test_adjoint_derivatives_are_the_transposed_directional(
    smooth_model: Model, exported3: Any, tmp_path: Path
) -> None:
    with slave3(exported3(smooth_model), tmp_path) as (instance, description, _):
        _start(instance)
        _run(instance, description, 0, 150)
        rates = [v for v in description.modelVariables if v.derivative is not None]
        knowns = [v.derivative.valueReference for v in rates] + references(description, "input")
        unknowns = [v.valueReference for v in rates] + references(description, "output")
        rng = np.random.default_rng(5)
        along, back = rng.standard_normal(len(knowns)), rng.standard_normal(len(unknowns))
        forward = instance.getDirectionalDerivative(unknowns, knowns, along.tolist())
        adjoint = instance.getAdjointDerivative(unknowns, knowns, back.tolist(), len(knowns))
        assert np.dot(back, forward) == pytest.approx(np.dot(adjoint, along), rel=1e-12)


def test_refusals(switching_model: Model, exported3: Any, tmp_path: Path) -> None:
    with slave3(exported3(switching_model), tmp_path) as (instance, description, messages):
        u, y = references(description, "input"), references(description, "output")

        def refuses(status: int, words: str, function: Any, *arguments: Any, **named: Any) -> None:
            messages.clear()
            with pytest.raises(FMICallException) as caught:
                function(*arguments, **named)
            assert caught.value.status == status
            assert len(messages) == 1
            assert words in messages[0]

        refuses(3, "instantiated", instance.doStep, 0.0, 1e-3)
        refuses(3, "startTime", instance.enterInitializationMode, startTime=math.nan)
        _start(instance, stop=1.0)
        before = instance.getFloat64(y)
        refuses(2, "finite", instance.setFloat64, u, [math.nan])
        refuses(2, "gear.efficiency", instance.setFloat64, [reference(description, "gear.efficiency")], [1.5])
        refuses(3, "neither", instance.setFloat64, y[:1], [1.0])
        refuses(3, "type", instance.getFloat32, u)
        refuses(3, "type", instance.getBoolean, u)
        refuses(3, "stopTime", instance.doStep, 0.0, 1.1)
        refuses(3, "step", instance.doStep, 0.5, 1e-3)
        refuses(3, "step", instance.doStep, 0.0, -1e-3)
        refuses(3, "step mode", instance.enterEventMode)
        refuses(3, "step mode", instance.enterStepMode)
        values = (ctypes.c_double * 2)()
        vr = (ctypes.c_uint * 1)(*u)
        refuses(3, "one value", instance.fmi3GetFloat64, instance.component, vr, 1, values, 2)
        assert instance.getFloat64(y) == before
        modes = [v for v in description.modelVariables if v.type == "Int32"]
        assert {m.name for m in modes} == {"friction.mode", "zone.zone.mode", "play.contact.mode"}
        assert all(value in (-1, 0, 1) for value in instance.getInt32([m.valueReference for m in modes]))


def test_terminals_and_icon(exported3: Callable[[Model], Path], exported: Any, smooth_model: Model) -> None:
    """Against the schema that comes with FMPy; members are variables of the FMU, each once."""
    from io import BytesIO

    import fmpy
    from lxml import etree
    from matplotlib.image import imread

    with zipfile.ZipFile(exported3(smooth_model)) as archive:
        found = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        picture = imread(BytesIO(archive.read("terminalsAndIcons/icon.png")))
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
    etree.XMLSchema(etree.parse(str(schema))).assertValid(found)
    assert picture.shape == (96, 96)
    assert 0.05 < (picture < 0.5).mean() < 0.5
    members = [m.get("variableName") for m in found.iter("TerminalMemberVariable")]
    assert sorted(members) == sorted(
        ["motor_voltage", "link_hub_angle", "link_tip_deflection", "link_tip_acceleration", "motor_current"]
    )
    with zipfile.ZipFile(exported(smooth_model)) as archive:
        assert archive.read("model.png").startswith(b"\x89PNG")
