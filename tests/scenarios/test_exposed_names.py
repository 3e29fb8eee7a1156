"""Exposed names of sub-assemblies: signals, starting values and inputs of an FMU are found by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexarm
from engine.errors import FlexarmError
from flexarm.cosim import run
from scenarios.load import load

PART = """\
schema: 1
name: part
blocks:
  motor: {type: Torque}
  body: {type: Inertia, inertia: 0.1 kg.m2}
  spring: {type: GroundSpring, stiffness: 4 N.m/rad}
connect:
  - [motor.shaft, body.shaft, spring.shaft]
expose: {push: motor.torque, out: body.shaft}
"""
WHOLE = """\
schema: 1
name: whole
blocks:
  source: {type: Constant, value: 0 N.m}
  left: {type: part.yaml}
connect:
  - [source.out, left.push]
simulate: {stop: 0.5 s, step: 10 ms}
analyses:
  fmu: {kind: export, inputs: [left.push], outputs: [left.out.angle]}
"""


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    (tmp_path / "part.yaml").write_text(PART)
    path = tmp_path / "whole.yaml"
    path.write_text(WHOLE)
    return path


def test_results_and_starts_by_exposed_names(whole: Path) -> None:
    """A mass on a spring: 0.2 cos(w t), w^2 = 4 / 0.1."""
    result = flexarm.simulate(whole, initial={"left.out.angle": 0.2})
    np.testing.assert_allclose(result["left.out.angle"], 0.2 * np.cos(np.sqrt(40) * result.time), atol=1e-6)
    np.testing.assert_array_equal(result["left.out.angle"], result["left.body.shaft.angle"])
    with pytest.raises(FlexarmError, match=r"no output 'left.out.angel' was recorded"):
        result["left.out.angel"]
    with pytest.raises(FlexarmError):
        flexarm.simulate(whole, initial={"left.out.angel": 0.2})


def test_inputs_of_an_fmu_by_exposed_names(whole: Path, tmp_path: Path) -> None:
    made = flexarm.export(whole, tmp_path / "whole.fmu")
    file = tmp_path / "whole.fmu"
    assert made is not None
    by_exposed = run(file, load(whole), inputs={"left.push": "300 mN.m"}, stop=0.1)
    assert by_exposed.inputs == {"left_motor_torque": 0.3}
    assert by_exposed.differences is not None
    assert max(by_exposed.differences.values()) < 1e-6
    with pytest.raises(FlexarmError, match=r"the FMU has no input 'left.pull'"):
        run(file, load(whole), inputs={"left.pull": 1.0}, stop=0.1)
