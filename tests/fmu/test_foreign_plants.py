"""Other tools' FMUs beside our blocks: a foreign plant under our controller, a foreign controller before our plant.

The foreign FMUs are written with pythonfmu, with laws whose sampled form is known exactly. Those of the Reference FMUs
(Dahlquist, Stair, BouncingBall, Feedthrough) are used where FLEXARM_REFERENCE_FMUS names a folder of them.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blocks.registry import registry
from engine.errors import FlexarmError
from engine.simulate import simulate
from fmu.block import FMU
from scenarios.load import load

PERIOD, GAIN, INTEGRAL, RATE, PUSH = 5e-3, 0.4, 2.0, 3.0, 10.0

PLANT = f'''
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Plant(Fmi2Slave):
    """x' = -3 x + 10 u, exactly, u held over a step: Dahlquist's equation with an input."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.u, self.x = 0.0, 0.5
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        fade = math.exp(-{RATE} * step)
        self.x = fade * self.x + (1 - fade) * {PUSH} / {RATE} * self.u
        return True
'''

CONTROLLER = f'''
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Controller(Fmi2Slave):
    """u = 0.4 e + 2 integral of e, sampled."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.reference = self.measured = self.u = self.sum = 0.0
        for name in ("reference", "measured"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("u", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        e = self.reference - self.measured
        self.u = {GAIN} * e + self.sum
        self.sum += {INTEGRAL} * step * e
        return True
'''


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the entry point does in an installed package."""
    if "FMU" not in registry():
        monkeypatch.setitem(registry(), "FMU", FMU)


def _built(folder: Path, name: str, text: str) -> Path:
    from pythonfmu.builder import FmuBuilder

    script = folder / f"{name}.py"
    script.write_text(text, encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()):
        return Path(FmuBuilder.build_FMU(script, dest=folder))


def _run(folder: Path, text: str, stop: float) -> dict[str, np.ndarray]:
    file = folder / "scenario.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.warns(RuntimeWarning, match="is run"):
        model = load(file).build()
    found = simulate(model, stop, 1e-3)
    return {name: found[name] for name in found.names} | {"time": found.time}


def test_a_foreign_plant_under_our_controller(tmp_path: Path) -> None:
    """PI and plant sample at the same instants; the command comes a period late, as a computed one does."""
    path = _built(tmp_path, "plant", PLANT)
    rows = _run(
        tmp_path,
        f"""schema: 1
name: foreign plant
blocks:
  reference: {{type: Step, height: 1}}
  pi: {{type: PI, proportional_gain: {GAIN}, integral_gain: {INTEGRAL} 1/s, period: {PERIOD} s}}
  late: {{type: Delay, delay: {PERIOD} s, period: {PERIOD} s}}
  plant: {{type: FMU, file: {path.name}, period: {PERIOD} s}}
connect:
  - [reference.out, pi.reference]
  - [plant.x, pi.measurement]
  - [pi.out, late.in]
  - [late.out, plant.u]
simulate: {{stop: 1 s, step: 1 ms, record: [plant.x, pi.out]}}
""",
        1.0,
    )
    fade = np.exp(-RATE * PERIOD)
    x, total, sent, expected = 0.5, 0.0, 0.0, []
    for _ in range(200):
        e = 1.0 - x
        u = GAIN * e + total
        total += INTEGRAL * PERIOD * e
        expected.append((x, u))
        x = fade * x + (1 - fade) * PUSH / RATE * sent
        sent = u
    given = np.column_stack([rows["plant.x"], rows["pi.out"]])[2:-1:5]
    assert np.abs(given - np.array(expected)).max() < 1e-9


def test_a_foreign_controller_before_our_plant(tmp_path: Path) -> None:
    """The same law as our PI block, a period late, since an FMU gives what follows from its step at the step's end."""
    path = _built(tmp_path, "controller", CONTROLLER)
    text = """schema: 1
name: foreign controller
blocks:
  reference: {type: Step, height: 3}
  control: {type: FMU, file: %s, period: 5 ms}
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 2e-4 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 0.002 N.m}
connect:
  - [reference.out, control.reference]
  - [motor.shaft.speed, control.measured]
  - [control.u, motor.voltage]
  - [motor.shaft, friction.shaft]
simulate: {stop: 1 s, step: 1 ms, record: [motor.voltage, motor.shaft.speed]}
"""
    rows = _run(tmp_path, text % path.name, 0.4)
    speed, voltage = rows["motor.shaft.speed"], rows["motor.voltage"]
    total, expected = 0.0, [0.0]
    for k in range(79):
        e = 3.0 - speed[5 * k]
        expected.append(GAIN * e + total)
        total += INTEGRAL * PERIOD * e
    assert np.abs(voltage[2:-1:5] - np.array(expected)[: len(voltage[2:-1:5])]).max() < 1e-9
    assert speed[-1] > 1.0


REFERENCE: dict[str, tuple[str, Callable[[Any], Any], float]] = {
    "Dahlquist": ("x", lambda t: np.exp(-t), 0.06),
    "Stair": ("counter", lambda t: 1 + np.floor(t + 1e-9), 0.0),
}


@pytest.mark.parametrize("name", REFERENCE)
def test_reference_fmus_feed_our_blocks(name: str, tmp_path: Path) -> None:
    """Their signal passes through our low pass; Dahlquist steps by Euler at 0.1 s, hence the bound."""
    folder = os.environ.get("FLEXARM_REFERENCE_FMUS")
    if not folder:
        pytest.skip("FLEXARM_REFERENCE_FMUS names no folder with the Reference FMUs")
    signal, law, bound = REFERENCE[name]
    rows = _run(
        tmp_path,
        f"""schema: 1
name: reference
blocks:
  source: {{type: FMU, file: {Path(folder) / f"{name}.fmu"}, period: 0.1 s}}
  filter: {{type: LowPass, corner_frequency: 500 rad/s}}
connect:
  - [source.{signal}, filter.in]
simulate: {{stop: 3 s, step: 10 ms, record: [source.{signal}, filter.out]}}
""",
        3.0,
    )
    at = rows["time"][5::10]
    given = rows[f"source.{signal}"][5::10]
    early, late = law(np.floor(at * 10 + 1e-9) / 10), law(np.floor(at * 10 + 1e-9) / 10 + 0.1)
    assert (np.minimum(np.abs(given - early), np.abs(given - late)) <= bound + 1e-12).all()
    assert abs(rows["filter.out"][-2] - given[-1]) < 0.02 * max(1.0, abs(given[-1]))


def test_units_of_connectors_without_one_are_given_and_not_guessed(tmp_path: Path) -> None:
    path = _built(tmp_path, "controller", CONTROLLER)
    plain = FMU(file=str(path), period=PERIOD)
    assert {name: port.unit for name, port in plain.ports.items()} == dict.fromkeys(("reference", "measured", "u"), "*")

    def unit(text: str) -> str:
        file = tmp_path / "scenario.yaml"
        file.write_text(
            f"""schema: 1
name: units
blocks:
  reference: {{type: Constant, value: 3 rad/s}}
  control: {{type: FMU, file: {path.name}, period: 5 ms{text}}}
connect:
  - [reference.out, control.reference, control.measured]
""",
            encoding="utf-8",
        )
        with pytest.warns(RuntimeWarning, match="is run"):
            model = load(file).build(outputs=["control.u"])
        return str(simulate(model, 0.01, 5e-3).units["control.u"])

    # The unit of its input is not that of its output, and nobody said what it is.
    assert unit("") == "*"
    assert unit(", unit: V") == "V"
    # 3 rad/s are 180 / pi * 3 deg/s for the FMU, and its 1 mV is 1e-3 V.
    scales = FMU(file=str(path), period=PERIOD, unit="reference=deg/s; u=mV").scales()
    assert [scales[name][1] for name in ("u", "reference")] == ["V", "rad/s"]
    assert scales["u"][0] == pytest.approx(1e-3)
    assert scales["reference"][0] == pytest.approx(np.pi / 180)
    for wrong, piece in (("x=V", "no connector 'x'"), ("u=flurbs", "flurbs")):
        with pytest.raises(FlexarmError, match=piece):
            FMU(file=str(path), period=PERIOD, unit=wrong)
