"""The command line, called in this process: arguments in; exit code, stdout and stderr out."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

BASE = """\
schema: 1
name: base
parameters: {supply: 1 V}
blocks:
  source: {type: Step, height: $supply, stop: 1 s}
  zone: {type: DeadZone, lower: -0.09 V, upper: 0.18 V}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7}
  gear: {type: Gear, ratio: 70}
  load: {type: Inertia, inertia: 2e-3 kg.m2}
connect:
  - [source.out, zone.in]
  - [zone.out, motor.voltage]
  - [motor.shaft, gear.input]
  - [gear.output, load.shaft]
simulate: {stop: 0.1 s, record: [source.out, zone.out, load.shaft.angle]}
analyses:
  plant: {kind: linearise, inputs: [motor.voltage], outputs: [load.shaft.angle]}
"""

RECORDED = """\
schema: 1
name: recorded
blocks:
  source: {type: Step, height: 1 V, stop: 60 ms}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 7.68 mN.m/A, rotor_inertia: 4.6e-7,
          viscous_friction: 1e-6}
connect:
  - [source.out, motor.voltage]
simulate: {stop: 0.1 s, record: [source.out, motor.shaft.angle, motor.shaft.speed]}
recordings:
  one:
    file: one.csv
    time: {column: t, unit: ms}
    drive: {motor.voltage: {column: u, unit: mV}}
    measurements:
      motor.shaft.angle: {column: enc, unit: count, counts_per_rev: 4096, sign: -1, zero: first}
      motor.shaft.speed: {column: tach, unit: V, scale: 0.1 rad/s/V}
"""


@dataclass(frozen=True)
class Answer:
    """What a command did."""

    code: int
    out: str
    err: str


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Call ``flexarm`` with the given arguments."""
    from flexarm.cli import main

    def call(*arguments: object) -> Answer:
        shown = warnings.showwarning
        code = 0
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            warnings.showwarning = shown
        captured = capsys.readouterr()
        return Answer(code, captured.out, captured.err)

    return call


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario file in an empty folder, which is also the working folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "base.yaml"
    path.write_text(BASE)
    return path


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario with a recording that its own model made, in the units of an encoder and a tachometer."""
    import numpy as np

    from engine.simulate import simulate
    from scenarios.load import load

    monkeypatch.chdir(tmp_path)
    path = tmp_path / "recorded.yaml"
    path.write_text(RECORDED)
    result = simulate(load(path).build(), 0.1)
    rows = zip(
        result.time * 1e3,
        result["source.out"] * 1e3,
        17 - result["motor.shaft.angle"] * 4096 / (2 * np.pi),
        result["motor.shaft.speed"] * 10,
        strict=True,
    )
    lines = ["t,u,enc,tach", *(",".join(f"{value:.17g}" for value in row) for row in rows)]
    (tmp_path / "one.csv").write_text("\n".join(lines) + "\n")
    return path
