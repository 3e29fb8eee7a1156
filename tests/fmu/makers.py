"""Small FMUs as another maker would write them, and a host without Python that runs ours."""

from __future__ import annotations

import subprocess
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from fmpy import extract, read_model_description

from engine import compile as compiling
from engine.simulate import Drive
from flexarm.api import export
from fmu.verify import references

_HERE = Path(__file__).parent

PYTHON_CONTROLLER = """\
class Integrator:
    def __init__(self):
        self.sum = 0.0

    def __call__(self, t, u):
        self.sum += 0.005 * (u[0] - u[1])
        return 0.4 * (u[0] - u[1]) + 2.0 * self.sum
"""
PYTHON_SCENARIO = """\
schema: 1
name: python arm
blocks:
  reference: {type: Step, height: 3 rad/s}
  control: {type: PythonController, function: Integrator, file: code/controller.py, inputs: 2, period: 5 ms}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 2e-4 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 0.002 N.m}
connect:
  - [reference.out, control.in1]
  - [motor.shaft.speed, control.in2]
  - [control.out, motor.voltage]
  - [motor.shaft, friction.shaft]
simulate: {stop: 1 s, step: 1 ms, record: [control.out, motor.shaft.speed]}
analyses:
  fmu: {kind: export, inputs: [control.in1], outputs: [control.out, motor.shaft.speed, motor.shaft.angle]}
"""


def foreign_binary(name: str) -> bytes:
    """The library for linux64 of a C file beside this one."""
    names = (name, "foreign_unused.h")
    return compiling.binary({file: (_HERE / file).read_text(encoding="utf-8") for file in names}, ["-s"], ".so")


def foreign_fmu(path: Path, binary: bytes, variables: Sequence[tuple[str, str, float | None]]) -> Path:
    """An FMI 2 Co-Simulation FMU ``m``.

    Args:
        path: the file to write.
        binary: its library.
        variables: name, causality and start of each, by value reference.
    """
    lines = []
    for reference, (name, causality, start) in enumerate(variables):
        kept = ' variability="fixed"' if causality == "parameter" else ""
        value = "" if start is None else f' start="{start!r}"'
        lines.append(
            f'<ScalarVariable name={quoteattr(name)} valueReference="{reference}" causality="{causality}"{kept}>'
            f"<Real{value}/></ScalarVariable>"
        )
    outputs = [k for k, (_, causality, _) in enumerate(variables, 1) if causality == "output"]
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g">'
        '<CoSimulation modelIdentifier="m" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{''.join(lines)}</ModelVariables><ModelStructure><Outputs>"
        + "".join(f'<Unknown index="{k}"/>' for k in outputs)
        + "</Outputs></ModelStructure></fmiModelDescription>"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr("binaries/linux64/m.so", binary)
    return path


class Unpacked:
    """An FMU in a folder, and how to run the host on it with an empty environment."""

    def __init__(self, host: Path, path: Path, folder: Path) -> None:
        extract(str(path), str(folder))
        self.host, self.description = host, read_model_description(str(path))
        self.library = next((folder / "binaries" / "linux64").glob("*.so"))

    def words(self, *command: object, tool: tuple[str, ...] = ()) -> list[str]:
        """The command line of the host."""
        inputs = references(self.description, "input")[:1] or [0]
        numbers = [*inputs, *references(self.description, "output")]
        return [str(word) for word in (*tool, self.host, self.library, self.description.guid, *command, *numbers)]

    def run(self, *command: object, tool: tuple[str, ...] = (), timeout: float = 3600) -> list[str]:
        """Words printed."""
        words = self.words(*command, tool=tool)
        run = subprocess.run(words, env={}, capture_output=True, text=True, timeout=timeout, check=False)
        assert run.returncode == 0, run.stderr
        return run.stdout.split()


def wave(steps: int) -> Drive:
    """The input with which the host drives."""
    k = np.arange(steps)
    values = np.sin(0.01 * (k - k % 7).astype(float))
    return Drive(k * 1e-3, values[:, None])


def python_arm(
    folder: Path,
    controller: str = PYTHON_CONTROLLER,
    name: str = "Integrator",
    platforms: Sequence[str] = ("linux64",),
) -> Path:
    """The FMU of a scenario with a Python controller, made in a folder of its own; ``arm.yaml`` is beside it."""
    (folder / "code").mkdir(parents=True)
    (folder / "code" / "controller.py").write_text(controller)
    (folder / "arm.yaml").write_text(PYTHON_SCENARIO.replace("Integrator", name))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return export(folder / "arm.yaml", folder / "arm.fmu", backend="python", platforms=platforms)
