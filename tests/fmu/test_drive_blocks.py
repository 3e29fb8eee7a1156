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
    "pmsm": (
        """
  asked: {type: Sine, amplitude: 12 A, frequency: 2 Hz}
  bus: {type: Constant, value: 40 V}
  control: {type: FieldOrientedController, pole_pairs: 3, bandwidth: 800 rad/s, current_limit: 10 A,
    field_weakening: true, resistance: 0.3 ohm, d_inductance: 2 mH, q_inductance: 3 mH, flux_linkage: 0.05 Wb}
  servo: {type: PMSM, pole_pairs: 3, resistance: 0.3 ohm, d_inductance: 2 mH, q_inductance: 3 mH, flux_linkage: 0.05 Wb}
""",
        [
            "rotor.shaft, servo.shaft",
            "asked.out, control.q_reference",
            "bus.out, control.bus_voltage",
            "control.d_voltage, servo.d_voltage",
            "control.q_voltage, servo.q_voltage",
            "servo.d_current, control.d_current",
            "servo.q_current, control.q_current",
            "rotor.shaft.speed, control.speed",
        ],
        "rotor.shaft.angle, servo.q_current, servo.d_current",
    ),
    "bridge-and-supply": (
        """
  bus: {type: Supply, source_voltage: 48 V, resistance: 0.5 ohm, capacitance: 2 mF, returns: false}
  duty: {type: Sine, amplitude: 1.2, frequency: 2 Hz}
  bridge: {type: Bridge, dead_time: 2 us, switching_period: 50 us, ripple_current: 0.2 A, on_resistance: 50 mohm}
  chopper: {type: BrakeChopper, resistance: 10 ohm, switch_on: 55 V, switch_off: 52 V}
  drawn: {type: Sum}
  dc: {type: DCMotor, resistance: 0.5 ohm, inductance: 2 mH, torque_constant: 0.1 N.m/A}
""",
        [
            "rotor.shaft, dc.shaft",
            "duty.out, bridge.duty",
            "bus.voltage, bridge.supply, chopper.voltage",
            "dc.current, bridge.current",
            "bridge.out, dc.voltage",
            "bridge.supply_current, drawn.a",
            "chopper.current, drawn.b",
            "drawn.out, bus.current",
        ],
        "rotor.shaft.angle, bus.voltage",
    ),
    "thermal": (
        """
  step: {type: Step, height: 24 V}
  warm: {type: ThermalDCMotor, resistance: 0.5 ohm, torque_constant: 0.1 N.m/A, winding_heat_capacity: 2 J/K,
    housing_heat_capacity: 9 J/K, winding_thermal_resistance: 0.3 K/W, housing_thermal_resistance: 1 K/W}
""",
        ["rotor.shaft, warm.shaft", "step.out, warm.voltage"],
        "rotor.shaft.speed, warm.current",
    ),
    "limits": (
        """
  wanted: {type: Sine, amplitude: 3 N.m, frequency: 1 Hz}
  envelope: {type: TorqueEnvelope, peak_torque: 2 N.m, peak_power: 50 W, bandwidth: 300 rad/s, speed_limit: 60 rad/s}
  source: {type: Torque}
  target: {type: Sine, amplitude: 1 rad, frequency: 1 Hz}
  servo: {type: DutyServo, proportional_gain: 20 1/rad, supply_voltage: 12 V}
  limit: {type: CurrentLimiter, current_limit: 1.5 A, resistance: 1 ohm, back_emf_constant: 0.1 V.s/rad}
  dead: {type: DeadTime, lost_voltage: 0.4 V, resistance: 1 ohm, back_emf_constant: 0.1 V.s/rad}
  dc: {type: DCMotor, resistance: 1 ohm, torque_constant: 0.1 N.m/A, rotor_inertia: 1e-4 kg.m2}
""",
        [
            "rotor.shaft, source.shaft",
            "wanted.out, envelope.reference",
            "rotor.shaft.speed, envelope.speed",
            "envelope.out, source.torque",
            "target.out, servo.reference",
            "dc.shaft.angle, servo.measurement",
            "dc.shaft.speed, limit.speed",
            "servo.out, limit.in",
            "limit.out, dead.in",
            "dc.shaft.speed, dead.speed",
            "dead.out, dc.voltage",
        ],
        "rotor.shaft.angle, dc.shaft.angle",
    ),
    "transmission-error": (
        """
  gear: {type: HarmonicDrive, ratio: 50, stiffness: 2e3, damping: 2, efficiency: 0.8, loss: directed,
    error_waves: 2, error_amplitude: [1 mrad, 0.2 mrad], error_order: [2, 4]}
  load: {type: Inertia, inertia: 0.5 kg.m2}
  cogging: {type: Cogging, pole_pairs: 2, slots: 6, harmonics: 2, amplitude: [0.1 N.m, 20 mN.m], phase: [0, 1]}
""",
        ["rotor.shaft, gear.input, cogging.shaft", "gear.output, load.shaft"],
        "rotor.shaft.angle, load.shaft.angle",
    ),
    "belt": (
        """
  pulley: {type: Pulley, radius: 20 mm}
  belt: {type: Belt, stiffness: 2e4 N/m, damping: 20 N.s/m, pretension: 5 N}
  carriage: {type: Mass, mass: 3 kg}
""",
        ["rotor.shaft, pulley.shaft", "pulley.slide, belt.a", "belt.b, carriage.flange"],
        "rotor.shaft.angle, carriage.flange.position",
    ),
    "jitter": (
        """
  angle: {type: JitteredSample, period: 10 ms, jitter: 6 ms, seed: 4}
  lag: {type: LowPass, corner_frequency: 20 rad/s}
""",
        ["rotor.shaft.angle, angle.in", "angle.out, lag.in"],
        "rotor.shaft.angle, lag.out",
    ),
    "warming-friction": (
        """
  friction: {type: WarmingFriction, coulomb_friction: 0.2 N.m, static_friction: 0.3 N.m,
    viscous_friction: 20 mN.m.s/rad, heat_capacity: 20 mJ/K, thermal_resistance: 40 K/W}
""",
        ["rotor.shaft, friction.shaft"],
        "rotor.shaft.angle, friction.temperature",
    ),
    "load-dependent-friction": (
        """
  friction: {type: LoadDependentFriction, coefficient: 0.3, opposing_coefficient: 0.6, static_ratio: 1.2,
    quadratic_coefficient: 0.05 1/(N.m)}
""",
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
