"""Generated C, integrator and FMI heads under the address and undefined-behaviour sanitizers.

A C host with the FMU's sources compiled in calls every function of the standard with good and bad arguments, in right
and wrong order; see sanitized.c.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from fmpy import read_model_description

import fmu
from blocks.actuators.effort import Torque
from blocks.actuators.friction import BearingFriction
from blocks.links.inertia import Inertia
from blocks.sources.pulse import Pulse
from blocks.sources.table import Table
from engine.assemble import build
from engine.block import Block
from engine.model import Model
from engine.system import Connection, System
from fmu.source import headers
from fmu.verify import references

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="gcc's sanitizers are used on Linux")

HERE = Path(__file__).parent
FLAGS = [
    *("-std=gnu11", "-g", "-O1", "-fno-omit-frame-pointer", "-ffp-contract=off", "-fno-math-errno"),
    *("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
]
SETTINGS = {
    "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1:strict_string_checks=1",
    "PATH": "/usr/bin:/bin",
}


@pytest.fixture(scope="module")
def scheduled_model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """Events in time and tables: pulses and two recorded torques on a rotor with friction, and an outer torque."""
    file = tmp_path_factory.mktemp("table") / "torque.csv"
    file.write_text("time,torque\n0.001,0\n0.0025,0.3\n0.004,-0.2\n0.02,0.1\n")
    table = {"file": str(file), "column": "torque", "scale": "1 N.m"}
    blocks: dict[str, Block] = {
        "pulse": Pulse(height="0.2 N.m", period="7 ms", width="2 ms", count=0),
        "held": Table(**table),
        "ramped": Table(**table, hold="linear"),
        **{name: Torque() for name in ("first", "second", "third", "free")},
        "rotor": Inertia(inertia=1e-3),
        "friction": BearingFriction(coulomb_friction=0.05),
    }
    wires = [
        ("pulse.out", "first.torque"),
        ("held.out", "second.torque"),
        ("ramped.out", "third.torque"),
        ("rotor.shaft", "friction.shaft", "first.shaft", "second.shaft", "third.shaft", "free.shaft"),
    ]
    system = System(blocks, [Connection(ends) for ends in wires], name="scheduled")
    return build(system, inputs=["free.torque"], outputs=["rotor.shaft.angle", "rotor.shaft.speed"])


@pytest.fixture(scope="module")
def gcc(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A function that compiles with sanitizers, in a folder of sources."""
    program = shutil.which("gcc")
    if program is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("gcc")
    (folder / "none.c").write_text("int main(void) { return 0; }\n")
    trial = subprocess.run(
        [program, *FLAGS, "none.c", "-o", "none"], cwd=folder, capture_output=True, text=True, check=False
    )
    if trial.returncode:
        pytest.skip("gcc has no address sanitizer: install libasan and libubsan")
    ran = subprocess.run([str(folder / "none")], env=SETTINGS, capture_output=True, text=True, check=False)
    if ran.returncode:
        pytest.skip(f"the address sanitizer does not run here: {ran.stderr.strip()[:200]}")

    def build(sources: Path, *settings: str) -> Path:
        for name in ("sanitized.c", "sanitized_fmi2.h", "sanitized_fmi3.h"):
            shutil.copy(HERE / name, sources)
        command = [program, *FLAGS, *settings, "all.c", "sanitized.c", "-lm", "-o", "host"]
        subprocess.run(command, cwd=sources, check=True)
        return sources / "host"

    return build


@pytest.mark.parametrize("version", [2, 3])
def test_every_function_of_the_standard_is_driven(version: int) -> None:
    standard = re.findall(
        rf"FMI{version}_Export fmi{version}\w+TYPE\s+(fmi{version}\w+);", headers(version)[f"fmi{version}Functions.h"]
    )
    text = (HERE / f"sanitized_fmi{version}.h").read_text()
    others = re.findall(r"OTHER\((\w+),", text)
    driven = set(re.findall(rf"\b(fmi{version}\w+)\(", text)) | {
        f"fmi3{verb}{name}" for name in others for verb in ("Get", "Set")
    }
    assert len(standard) == {2: 44, 3: 75}[version]
    assert set(standard) <= driven, set(standard) - driven


MODELS = ("smooth_model", "switching_model", "timed_model", "scheduled_model")
CASES = [*((name, version, False) for name in MODELS for version in (2, 3)), ("smooth_model", 3, True)]
QUICK = {("switching_model", 2, False), ("scheduled_model", 3, False)}


@pytest.mark.parametrize(
    ("name", "version", "arrays"),
    [pytest.param(*case, marks=[] if case in QUICK else pytest.mark.slow) for case in CASES],
)
def test_sanitizers_find_nothing(
    name: str,
    version: int,
    arrays: bool,
    gcc: Callable[..., Path],
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    model = request.getfixturevalue(name)
    path = fmu.export(model, tmp_path / "x.fmu", platforms=["linux64"], version=version, arrays=arrays)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    described = read_model_description(str(path))
    assert arrays == any(variable.shape for variable in described.modelVariables)
    program = gcc(tmp_path / "sources", f"-DFMI={version}")
    guid = described.guid if version == 2 else described.instantiationToken
    numbers = [
        len(model.states),
        model.equations.guards.numel(),
        1 + max(variable.valueReference for variable in described.modelVariables),
        *(references(described, "input")[:1] or [0]),
        references(described, "output")[0],
        100_000,
    ]
    command = [str(program), guid, *map(str, numbers)]
    run = subprocess.run(command, env=SETTINGS, capture_output=True, text=True, timeout=3600, check=False)
    assert run.returncode == 0, run.stderr[-4000:]
    assert run.stderr == ""
    assert int(run.stdout) > 10_000  # that many calls were refused with a message
