"""A servo whose encoder closes its loop, against a simulation of its own that counts as encoders do."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.api import diagnose, gather
from diagnosis.effects.catalogue import EFFECTS
from diagnosis.estimation.time_experiment import over_time
from diagnosis.problems import problem
from scenarios.load import load as loaded

Array = NDArray[np.float64]

INERTIA, LOAD, STIFFNESS, DAMPING, FRICTION, WEIGHT = 1.05e-3, 1.9e-3, 32.0, 5e-3, 2.1e-3, 0.02
"""kg.m2, kg.m2, N.m/rad, N.m.s/rad, N.m.s/rad and N.m: of the machine; the model has others, and no weight."""

COUNTS, PERIOD, SAMPLES, NOISE = 4096, 1e-3, 2000, 0.01
KP, KI, KD, CORNER = 4.0, 10.0, 0.1, 300.0

SCENARIO = f"""\
schema: 1
name: servo
blocks:
  reference: {{type: Step, height: 1 rad}}
  control:
    type: PID
    proportional_gain: {KP} N.m/rad
    integral_gain: {KI} N.m/(rad.s)
    derivative_gain: {KD} N.m.s/rad
    derivative_corner: {CORNER} rad/s
    unit: N.m
    period: {PERIOD} s
  motor: {{type: Torque}}
  rotor: {{type: Inertia, inertia: 1 g.m2}}
  bearing: {{type: BearingFriction, viscous_friction: 2 mN.m.s/rad}}
  spring: {{type: SpringDamper, stiffness: 30 N.m/rad, damping: 5 mN.m.s/rad}}
  load: {{type: Inertia, inertia: 2 g.m2}}
  encoder: {{type: Encoder, counts_per_revolution: {COUNTS}}}
connect:
  - [reference.out, control.reference]
  - [encoder.out, control.measurement]
  - [control.out, motor.torque]
  - [motor.shaft, rotor.shaft, bearing.shaft, encoder.shaft, spring.a]
  - [spring.b, load.shaft]
simulate: {{stop: 2 s, step: 1 ms}}
tolerances:
  control.proportional_gain: 0
  control.integral_gain: 0
  control.derivative_gain: 0
  control.derivative_corner: 0
recordings:
"""


def moved(
    reference: Array,
    weight: float,
    *,
    inertia: float = INERTIA,
    load: float = LOAD,
    stiffness: float = STIFFNESS,
    friction: float = FRICTION,
    rounds: bool = True,
) -> tuple[Array, Array]:
    """Counts at the motor and the load's speed at the samples: the torque is held, and its controller reads counts."""
    step, filtered, integral, counts, speeds = PERIOD / 20, 0.0, 0.0, [], []
    state = np.zeros(4)
    for wanted in reference:
        count = state[0] * COUNTS / (2 * math.pi)
        counts.append(math.floor(count) if rounds else count - 0.5)
        speeds.append(state[3])
        error = wanted - counts[-1] * 2 * math.pi / COUNTS
        following = filtered + (1 - math.exp(-CORNER * PERIOD)) * (error - filtered)
        torque = KP * error + KI * integral + KD * (following - filtered) / PERIOD
        filtered, integral = following, integral + PERIOD * error

        def rate(x: Array, torque: float = torque) -> Array:
            a, b, v, w = x
            twist = stiffness * (a - b) + DAMPING * (v - w)
            return np.array([v, w, (torque - friction * v - twist) / inertia, (twist - weight * math.sin(b)) / load])

        for _ in range(20):  # the midpoint rule
            state = state + step * rate(state + step / 2 * rate(state))
    return np.array(counts, dtype=float), np.array(speeds)


def rig(folder: Path, weight: float) -> Path:
    """A scenario with four recordings of the machine, two of them held out."""
    time, text, random = np.arange(SAMPLES) * PERIOD, SCENARIO, np.random.default_rng(1)
    for k, (first, second) in enumerate([(2.0, 5.1), (3.3, 8.4), (2.7, 6.3), (4.1, 7.2)]):
        soft = np.minimum(time / 0.3, 1.0) ** 2
        reference = soft * (1.5 * np.sin(first * time) + 0.6 * np.sin(second * time))
        counts, speed = moved(reference, weight)
        rows = np.column_stack([time, reference, counts, speed + NOISE * random.standard_normal(SAMPLES)])
        np.savetxt(folder / f"r{k}.csv", rows, delimiter=",", header="t,wanted,counts,gyro", comments="")
        text += (
            f"  r{k}:\n    file: r{k}.csv\n    loop: reference\n    time: {{column: t, unit: s}}\n"
            f"    drive: {{control.reference: {{column: wanted, unit: rad}}}}\n    measurements:\n"
            f"      encoder.out: {{column: counts, unit: count, counts_per_rev: {COUNTS}}}\n"
            f"      load.shaft.speed: {{column: gyro, unit: rad/s, noise: {NOISE} rad/s}}\n"
            + ("    role: hold_out\n" if k > 1 else "")
        )
    path = folder / "servo.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("weight", [0.0, WEIGHT])
def test_what_a_servo_lacks_is_found_though_its_encoder_closes_the_loop(tmp_path: Path, weight: float) -> None:
    """The steps shake what the loop drives by more than the gyro's noise, at random as far as a model can tell."""
    tried = {"gravity", "coulomb_friction", "stray_spring", "delay", "offset"}
    found = diagnose(rig(tmp_path, weight), workers=1, without=sorted(set(EFFECTS) - tried))
    assert found.study.chosen.fit.converged
    if not weight:
        assert found.verdict == "none"
        return
    (finding,) = found.findings
    assert (found.verdict, finding["effect"]) == ("named", "gravity")
    size = finding["parameters"]["mass"]
    # The effect's mass hangs 1 m from the shaft.
    assert size["low"] < weight / 9.81 < size["high"]
    assert size["high"] < 1.1 * size["low"]
    values = found.study.chosen.fit.parameters()
    true = {"rotor.inertia": INERTIA, "load.inertia": LOAD, "spring.stiffness": STIFFNESS}
    assert {name: values[name] for name in true} == pytest.approx(true, rel=0.01)


def test_what_an_encoder_s_steps_do_in_its_loop_counts_as_noise_of_the_other_sensors(tmp_path: Path) -> None:
    """The oracle is a machine whose encoder does not round; a reading's own rounding is in its noise already."""
    scenario = loaded(rig(tmp_path, 0.0))
    posed = problem(scenario, gather(scenario, (), ()))
    own = 2 * math.pi / COUNTS / math.sqrt(12)
    for e in over_time(posed.experiments):
        wanted = np.loadtxt(tmp_path / f"{e.name}.csv", delimiter=",", skiprows=1)[:, 1]
        given: Any = {"inertia": 1e-3, "load": 2e-3, "stiffness": 30.0, "friction": 2e-3}
        shaken = moved(wanted, 0.0, **given)[1] - moved(wanted, 0.0, **given, rounds=False)[1]
        assert e.sigma[1] == pytest.approx(math.hypot(NOISE, float(np.std(shaken))), rel=0.1)
        assert e.sigma[1] > 1.2 * NOISE
        assert own * 0.99 < e.sigma[0] < 2 * own
