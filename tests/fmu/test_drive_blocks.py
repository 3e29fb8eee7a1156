"""Parts of drives, exported: FMI 2 and 3 against the runner.

Co-Simulation runs the same generated C and must give the same numbers; Model Exchange is integrated by CVODE, which
knows the equations and the events alone.
"""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

import fmu
from engine.simulate import simulate
from fmu.variables import flat
from fmu.verify import cosim
from scenarios.load import load

TURNING = """
blocks:
  drive: {type: Sine, amplitude: 0.8 N.m, frequency: 1.5 Hz}
  motor: {type: Torque}
  rotor: {type: Inertia, inertia: 2e-3 kg.m2}
%s
connect:
  - [drive.out, motor.torque]
  - [motor.shaft, rotor.shaft]
%s
"""

PARTS: dict[str, tuple[str, list[str], str]] = {
    "elastic-gear": (
        """
  gear: {type: Gear, ratio: 10, stiffness: 2e3, damping: 5, efficiency: 0.8, backdriving_efficiency: 0.5}
  load: {type: Inertia, inertia: 0.1 kg.m2}
""",
        ["rotor.shaft, gear.input", "gear.output, load.shaft"],
        "rotor.shaft.angle, load.shaft.angle",
    ),
    "load-dependent-friction": (
        "  friction: {type: LoadDependentFriction, coefficient: 0.3, opposing_coefficient: 0.6, static_ratio: 1.2}",
        ["rotor.shaft, friction.shaft", "drive.out, friction.load"],
        "rotor.shaft.angle",
    ),
}
"""Blocks, connections, and what is recorded."""


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", PARTS)
def test_exported_it_does_what_the_runner_does(name: str, version: int, tmp_path: Path) -> None:
    parts, wires, record = PARTS[name]
    body = TURNING % (parts.strip("\n"), "\n".join(f"  - [{wire}]" for wire in wires))
    file = tmp_path / f"{name}.yaml"
    text = f"schema: 1\nname: {name}\n{body.strip()}\nsimulate: {{stop: 1 s, step: 2 ms, record: [{record}]}}\n"
    file.write_text(text, encoding="utf-8")
    model = load(file).build()
    path = fmu.export(model, tmp_path / "part.fmu", platforms=["linux64"], version=version, step=2e-3)
    assert validate_fmu(str(path)) == []
    expected, trace = simulate(model, 1.0, 2e-3), cosim(path, 1.0, 2e-3)
    rows = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=1.0, output_interval=2e-3, relative_tolerance=1e-6
    )
    for variable in model.outputs:
        values = expected[variable.name]
        assert np.ptp(values) > 0.05 * np.abs(values).max() > 0, "nothing moves"
        np.testing.assert_array_equal(trace[flat(variable.name)], values)
        found = np.interp(expected.time, rows["time"], rows[flat(variable.name)])
        np.testing.assert_allclose(found, values, atol=1e-2 * np.ptp(values))
