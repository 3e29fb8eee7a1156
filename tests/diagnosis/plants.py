"""Recordings made without flexarm: a geared motor, integrated in tiny steps with its own friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

RESISTANCE, TORQUE_CONSTANT, EFFICIENCY, INERTIA, VISCOUS = 2.6, 7.68e-3, 0.69, 4.606e-7, 1.26e-6

SCENARIO = """\
schema: 1
name: bench-motor
description: A motor on the bench.

blocks:
  source: {{type: Step, height: 1 V}}
  motor:
    type: DCMotor
    resistance: {resistance} ohm  # measured cold
    torque_constant: 7.68 mN.m/A
    back_emf_constant: 7.68 mV.s/rad
    efficiency: 0.69
    rotor_inertia: {inertia} kg.m2
    viscous_friction: 1.26e-6 N.m.s/rad

connect:
  - [source.out, motor.voltage]

simulate: {{stop: 2 s, step: 2 ms}}

recordings:
"""
RECORDING = """\
  {name}:
    file: {name}.csv
    time: {{column: t, unit: s}}
    drive: {{motor.voltage: {{column: u, unit: V}}}}
    measurements:
      motor.shaft.speed: {{column: speed, unit: rad/s}}
    role: {role}
"""


def inputs(t: Any) -> dict[str, Any]:
    """Three inputs to train on, two of another kind to hold out."""
    return {
        "steps": ("train", np.where(t % 1.0 < 0.5, 1.0, -0.8) * (t < 1.8)),
        "chirp": ("train", 1.2 * np.sin(2 * np.pi * (0.5 + t) * t)),
        "growing": ("train", t * np.sin(2 * np.pi * 2.3 * t)),
        "ramp": ("hold_out", np.interp(t, [0, 0.5, 1.5, 2.0], [0, 1.4, -1.4, 0])),
        "slow": ("hold_out", 0.7 * np.sin(2 * np.pi * 0.9 * t)),
    }


def speed(
    t: Any,
    u: Any,
    *,
    coulomb: float = 0.0,
    dead: float = 0.0,
    resistance: Any = RESISTANCE,
    inertia: Any = INERTIA,
    parts: int = 100,
) -> NDArray[Any]:
    """Motor speed by exponential steps of 20 us; Coulomb friction holds the rotor where the motor cannot turn it."""
    constant = EFFICIENCY * TORQUE_CONSTANT / resistance
    damping = VISCOUS + constant * TORQUE_CONSTANT
    h = (t[1] - t[0]) / parts
    decay = math.exp(-damping / inertia * h)
    v, rows = 0.0, []
    for volt in u:
        rows.append(v)
        volt = math.copysign(max(abs(volt) - dead, 0.0), volt)
        drive = constant * volt
        for _ in range(parts):
            side = math.copysign(1.0, v) if v else math.copysign(1.0, drive)
            if v == 0.0 and abs(drive) <= coulomb:
                break
            end = (drive - side * coulomb) / damping
            new = end + (v - end) * decay
            v = 0.0 if v and new * v < 0 else new
    return np.array(rows)


def case(
    folder: Path,
    *,
    given_resistance: float = 2.75,
    given_inertia: float = 4.3e-7,
    noise: float = 0.3,
    seed: int = 0,
    **truth: Any,
) -> Path:
    """A scenario with parameters a few per cent off, and recordings of a plant with ``truth`` in it."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 2.0 + 1e-9, 2e-3)
    text = SCENARIO.format(resistance=given_resistance, inertia=given_inertia)
    for name, (role, u) in inputs(t).items():
        y = speed(t, u, **truth) + random.normal(0.0, noise, len(t))
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, u, y]), delimiter=",", header="t,u,speed", comments="")
        text += RECORDING.format(name=name, role=role)
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def limit_amplifier(monkeypatch: pytest.MonkeyPatch, voltages: Callable[[Any], dict[str, Any]]) -> None:
    """Give the motor an amplifier that gives at most 1 V either way, and recordings with other voltages."""
    own = speed
    monkeypatch.setattr(f"{__name__}.inputs", voltages)
    monkeypatch.setattr(f"{__name__}.speed", lambda t, u, **more: own(t, np.clip(u, -1.0, 1.0), **more))
