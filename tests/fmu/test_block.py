"""``type: FMU``: an FMU inside a scenario does what the blocks it was made from do."""

from __future__ import annotations

import re
import tomllib
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

import fmu
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.registry import registry
from engine.assemble import build
from engine.block import Block
from engine.errors import FlexarmError, ParameterError
from engine.simulate import simulate
from engine.system import Connection, System
from flexarm.api import simulate as flexarm_simulate
from flexarm.sweeps.sweep import sweep
from flexarm.table import read
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
        ({"file": path, "set": "pi.integral_gain=much"}, "'much' is not a number"),
    ):
        with pytest.raises(FlexarmError) as caught:
            FMU(period=5e-3, **values)
        assert piece in str(caught.value)


def test_an_fmu_that_fails_is_named(tmp_path: Path) -> None:
    """The FMU refuses a corner frequency of 0 only when it starts."""
    path = _controller(tmp_path / "pi.fmu", 2)
    text = f"control: {{type: FMU, file: {path.name}, period: 5 ms, set: unused.corner_frequency=0}}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(_scenario(tmp_path, text, NAMES)).build()
    with pytest.raises(FlexarmError, match="control"):
        simulate(model, 0.1)


def test_it_is_registered_by_an_entry_point() -> None:
    project = tomllib.loads((Path(fmu.__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["flexarm.blocks"] == {"FMU": "fmu.block:FMU"}


def test_parameters_of_the_fmu_are_the_blocks(tmp_path: Path) -> None:
    """By name, before ``set``, by overrides with dots, in a sweep; each is what ``set`` gives."""
    path = str(_controller(tmp_path / "pi.fmu", 2))
    named = FMU(file=path, period=5e-3, set="pi.integral_gain=7", **{"pi.integral_gain": "3 V/rad"})
    assert named.start_values() == {"pi.integral_gain": 3.0}
    with pytest.raises(ParameterError, match="unit 'm' does not fit"):
        FMU(file=path, period=5e-3, **{"pi.integral_gain": "3 m"})
    with pytest.raises(ParameterError, match=r"no parameter 'pi.integral_gian'\n  did you mean 'pi.integral_gain'"):
        FMU(file=path, period=5e-3, **{"pi.integral_gian": 3})
    file = _scenario(tmp_path, "control: {type: FMU, file: pi.fmu, period: 5 ms, set: pi.integral_gain=7}", NAMES)
    assert load(file, ["control.pi.integral_gain=3 V/rad"]).system.blocks["control"].start_values() == {  # type: ignore[attr-defined]
        "pi.integral_gain": 3.0
    }
    with pytest.raises(FlexarmError, match=r"control.pi.integral_gian: FMU has no parameter 'pi.integral_gian'"):
        load(file, ["control.pi.integral_gian=3"])
    with pytest.raises(FlexarmError, match=r"'motor.a.b' leads nowhere: 'motor' is a single block"):
        load(file, ["motor.a.b=3"])


def test_an_fmus_parameter_is_swept_by_its_name(tmp_path: Path) -> None:
    _controller(tmp_path / "pi.fmu", 2)
    file = _scenario(tmp_path, "control: {type: FMU, file: pi.fmu, period: 5 ms}", NAMES)
    made = sweep(file, ["control.pi.integral_gain=0,2"], tmp_path / "runs.parquet", stop=0.2, workers=1)
    table = read(made.table)
    ends = [
        flexarm_simulate(load(file, [f"control.set=pi.integral_gain={gain}"]), stop=0.2)["motor.shaft.speed"][-1]
        for gain in (0, 2)
    ]
    np.testing.assert_array_equal(table["control.pi.integral_gain"], [0, 2])
    np.testing.assert_array_equal(table["motor.shaft.speed.final"], ends)
    assert ends[0] != ends[1]
    with pytest.raises(FlexarmError, match=r"goes on an axis: control.pi.integral_gain=A,B,C"):
        sweep(file, ["control.pi.integral_gain~10%"], tmp_path / "runs.parquet", runs=3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pi.integral_gain=3 m", "unit 'm' does not fit"),
        ("pi.integral_gain=three", "'three' is not a number"),
        ("pi.integral_gain", "sets nothing"),
        ("pi.integral_gain=1; pi.integral_gain=2", "given twice"),
    ],
)
def test_start_values_that_cannot_be(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=message):
        FMU(file=str(_controller(tmp_path / "pi.fmu", 2)), period=5e-3, set=text)


def test_connectors_without_units_are_told(tmp_path: Path) -> None:
    path = str(_without_units(_controller(tmp_path / "pi.fmu", 2)))
    blocks: dict[str, Block] = {"pi": FMU(file=path, period=5e-3), "smooth": LowPass(corner_frequency=10.0)}
    system = System(blocks, [Connection(("pi.pi_out", "smooth.in"))])
    with pytest.warns(RuntimeWarning, match=r"no units to pi_reference, pi_measurement, pi_out: "):
        build(system)
    told = "pi_reference=rad/s; pi_measurement=rad/s; pi_out=1"
    system.blocks["pi"] = FMU(file=path, period=5e-3, unit=told)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        build(system)
    assert not [w for w in said if "no units" in str(w.message)]
    with pytest.raises(ParameterError, match=r"unit 'V' does not fit"):
        FMU(file=path, period=5e-3, set="pi.integral_gain=3 V")
    with pytest.raises(ParameterError, match=r"gives 'pi.integral_gain' no unit; write its number alone: .*=3$"):
        FMU(file=path, period=5e-3, set="pi.integral_gain=3 V")


def _without_units(path: Path) -> Path:
    """The same FMU, as tools write it that know no units."""
    made = path.with_name("plain.fmu")
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data = re.sub(rb' (displayUnit|unit)="[^"]*"', b"", data)
                data = re.sub(rb"<UnitDefinitions>.*?</UnitDefinitions>", b"", data, flags=re.DOTALL)
            new.writestr(name, data)
    return made
