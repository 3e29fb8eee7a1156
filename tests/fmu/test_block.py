"""``type: FMU``: an FMU inside a scenario does what the blocks it was made from do."""

from __future__ import annotations

import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest

import fmu
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.registry import registry
from engine.assemble import build
from engine.block import Block
from engine.errors import FlexarmError
from engine.simulate import simulate
from engine.system import Connection, System
from fmu.block import FMU
from scenarios.load import load

SCENARIO = """\
schema: 1
name: driven by an FMU
blocks:
  reference: {type: Step, height: 3}
  CONTROL
  motor: {type: DCMotor, resistance: 2.6 ohm, torque_constant: 0.05 N.m/A, rotor_inertia: 2e-4 kg.m2}
  friction: {type: BearingFriction, coulomb_friction: 0.002 N.m}
connect:
  - [reference.out, control.REFERENCE]
  - [motor.shaft.speed, control.MEASUREMENT]
  - [control.OUT, motor.voltage]
  - [motor.shaft, friction.shaft]
simulate: {stop: 1 s, step: 1 ms, record: [motor.voltage, motor.shaft.speed]}
"""


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the entry point does in an installed package."""
    if "FMU" not in registry():
        monkeypatch.setitem(registry(), "FMU", FMU)


def _controller(path: Path, version: int) -> Path:
    """A PI controller that samples every 5 ms, as an FMU."""
    blocks: dict[str, Block] = {
        "pi": PI(proportional_gain="0.4 V.s/rad", integral_gain="2 V/rad", period=5e-3),
        "unused": LowPass(corner_frequency=10.0),
    }
    system = System(blocks, [Connection(("pi.out", "unused.in"))], name="controller")
    model = build(system, inputs=["pi.reference", "pi.measurement"], outputs=["pi.out"])
    return fmu.export(model, path, platforms=["linux64"], version=version, step=5e-3)


def _scenario(folder: Path, control: str, names: tuple[str, str, str]) -> Path:
    text = SCENARIO.replace("CONTROL", control)
    for key, name in zip(("REFERENCE", "MEASUREMENT", "OUT"), names, strict=True):
        text = text.replace(key, name)
    path = folder / f"{control[9:12]}.yaml"
    path.write_text(text)
    return path


NAMES = ("pi_reference", "pi_measurement", "pi_out")


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_controller_fmu_drives_our_motor_like_the_block(version: int, backend: str, tmp_path: Path) -> None:
    _controller(tmp_path / "pi.fmu", version)
    driven = load(_scenario(tmp_path, "control: {type: FMU, file: pi.fmu, period: 5 ms}", NAMES))
    plain = load(
        _scenario(
            tmp_path,
            "control: {type: PI, proportional_gain: 0.4 V.s/rad, integral_gain: 2 V/rad, period: 5 ms}",
            ("reference", "measurement", "out"),
        )
    )
    with pytest.warns(RuntimeWarning, match=r"pi\.fmu.*is run"):
        model = driven.build()
    given = simulate(model, 0.4, 1e-3, backend=backend)
    expected = simulate(plain.build(), 0.4, 1e-3, backend=backend)
    assert np.abs(given.values - expected.values).max() < 1e-12
    again = simulate(model, 0.4, 1e-3, backend=backend)
    assert np.array_equal(again.values, given.values)


def test_start_values_and_refusals(tmp_path: Path) -> None:
    path = str(_controller(tmp_path / "pi.fmu", 2))
    block = FMU(file=path, period=5e-3, set="pi.proportional_gain=0.8; pi.integral_gain = 0")
    assert block.start_values() == {"pi.proportional_gain": 0.8, "pi.integral_gain": 0.0}
    assert block.ports["pi_out"].unit == "V"
    (tmp_path / "bad.fmu").write_bytes(b"nothing")
    for values, piece in (
        ({"file": str(tmp_path / "none.fmu")}, "there is no FMU"),
        ({"file": str(tmp_path / "bad.fmu")}, "no FMU that can be read"),
        ({"file": path, "set": "pi.gain=1"}, "no parameter 'pi.gain'"),
        ({"file": path, "set": "pi.integral_gain=much"}, "no number"),
    ):
        with pytest.raises(FlexarmError) as caught:
            FMU(period=5e-3, **values)
        assert piece in str(caught.value)


def test_an_fmu_that_fails_is_named(tmp_path: Path) -> None:
    """The FMU refuses a gain that is not finite only when it starts."""
    path = _controller(tmp_path / "pi.fmu", 2)
    text = f"control: {{type: FMU, file: {path.name}, period: 5 ms, set: pi.proportional_gain=nan}}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(_scenario(tmp_path, text, NAMES)).build()
    with pytest.raises(FlexarmError, match="control"):
        simulate(model, 0.1)


def test_it_is_registered_by_an_entry_point() -> None:
    project = tomllib.loads((Path(fmu.__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["flexarm.blocks"] == {"FMU": "fmu.block:FMU"}
