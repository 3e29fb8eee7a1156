"""Blocks that turn rotation into translation, and those of signals, exported: FMI 2 and 3 against the runner.

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
from engine.model import Model
from engine.simulate import simulate
from fmu.variables import flat
from fmu.verify import cosim
from scenarios.load import load

TURNING = """
  drive: {type: Sine, amplitude: 0.8 N.m, frequency: 1.5 Hz}
  motor: {type: Torque}
  rotor: {type: Inertia, inertia: 2e-3 kg.m2}
  part: {%s}
  guide: {type: TranslationalBearingFriction, coulomb_friction: 2 N, viscous_friction: 8 N.s/m}
  table: {type: Mass, mass: 3 kg}
connect:
  - [drive.out, motor.torque]
  - [motor.shaft, rotor.shaft, part.shaft]
  - [part.slide, guide.slide, table.flange]
"""

SIGNAL = """
  drive: {type: Sine, amplitude: 2, frequency: 1.5 Hz}
  other: {type: Sine, amplitude: 1.5, frequency: 0.7 Hz, offset: 2}
  part: {%s}
  lag: {type: LowPass, corner_frequency: 20 rad/s}
connect:
%s
  - [part.out, lag.in]
"""

MOVING = {
    "pulley": "type: Pulley, radius: 20 mm, efficiency: 0.9, inertia: 1e-4 kg.m2",
    "elastic-pulley": "type: Pulley, radius: 20 mm, stiffness: 2e4 N/m, damping: 20 N.s/m, efficiency: 0.9",
    "rack": "type: RackAndPinion, pitch_radius: 15 mm, efficiency: 0.95",
    "screw": "type: Screw, lead: 20 mm, efficiency: 0.9",
    "self-locking-screw": (
        "type: Screw, lead: 4 mm, stiffness: 1e6 N/m, damping: 500 N.s/m, efficiency: 0.4, backdriving_efficiency: -0.5"
    ),
    "elastic-rack": "type: RackAndPinion, pitch_radius: 15 mm, stiffness: 1e5 N/m, damping: 50 N.s/m, efficiency: 0.95",
    "elastic-screw": "type: Screw, lead: 20 mm, stiffness: 1e6 N/m, damping: 500 N.s/m, efficiency: 0.9",
}

SIGNALS = {
    "product": ("type: Product, unit: '1'", ("a", "b")),
    "quotient": ("type: Product, operation: divide, unit: '1'", ("a", "b")),
    "switch": ("type: Switch, threshold: 0.4, hysteresis: 0.2", ("control", "on", "off")),
    "relay": ("type: Relay, switch_on: 0.5, switch_off: -0.5, upper_value: 3, lower_value: -1", ("in",)),
    "rate-limiter": ("type: RateLimiter, rising: 6, falling: 9, time_constant: 5 ms", ("in",)),
    "quantiser": ("type: Quantiser, step: 0.25", ("in",)),
    "transfer-function": ("type: TransferFunction, numerator: [1, 3], denominator: [0.01, 0.2, 1]", ("in",)),
    "discrete-transfer-function": (
        "type: DiscreteTransferFunction, numerator: [0.2, 0.1], denominator: [1, -0.7], period: 10 ms",
        ("in",),
    ),
    "lookup-table": ("type: LookupTable, breakpoints: [-2, -0.5, 1, 2], heights: [1, -1, 0.5, 4]", ("in",)),
    "lookup-table-2d": (
        "type: LookupTable2D, rows: [-1, 0, 1], columns: [1, 2, 3], table: [[0, 1, 4], [2, 3, 0], [1, -1, 2]]",
        ("x", "y"),
    ),
    "noise": ("type: Noise, deviation: 0.5, period: 5 ms, seed: 3", ()),
    "gain-schedule": ("type: GainSchedule, breakpoints: [1, 2, 3], gains: [1, 4, 2]", ("in", "schedule")),
}

SAMPLED = {"discrete-transfer-function", "noise"}


def _model(name: str, folder: Path) -> Model:
    if name in MOVING:
        body, record = TURNING % MOVING[name], "rotor.shaft.angle, table.flange.position"
    else:
        part, ports = SIGNALS[name]
        feeds = ("other",) if name == "noise" else ("drive", "other", "drive")
        body = SIGNAL % (part, "\n".join(f"  - [{f}.out, part.{port}]" for f, port in zip(feeds, ports, strict=False)))
        record = "part.out, lag.out"
    file = folder / f"{name}.yaml"
    text = f"schema: 1\nname: {name}\nblocks:{body}simulate: {{stop: 1 s, step: 2 ms, record: [{record}]}}\n"
    file.write_text(text, encoding="utf-8")
    return load(file).build()


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", [*MOVING, *SIGNALS])
def test_exported_it_does_what_the_runner_does(name: str, version: int, tmp_path: Path) -> None:
    model = _model(name, tmp_path)
    path = fmu.export(model, tmp_path / "part.fmu", platforms=["linux64"], version=version, step=2e-3)
    assert validate_fmu(str(path)) == []
    expected, trace = simulate(model, 1.0, 2e-3), cosim(path, 1.0, 2e-3)
    for variable in model.outputs:
        values = expected[variable.name]
        assert np.ptp(values) > 0.05 * np.abs(values).max() > 0, "nothing moves"
        np.testing.assert_array_equal(trace[flat(variable.name)], values)
    if name in SAMPLED:
        return
    rows = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=1.0, output_interval=2e-3, relative_tolerance=1e-6
    )
    for variable in model.outputs:
        if variable.name == "part.out":
            continue  # jumps, one row apart where a switch falls on it; behind the lag it counts
        values = expected[variable.name]
        found = np.interp(expected.time, rows["time"], rows[flat(variable.name)])
        np.testing.assert_allclose(found, values, atol=1e-2 * np.ptp(values))
