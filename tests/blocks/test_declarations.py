"""What every block of the library must say of itself, and how it refuses what it is given."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pint
import pytest

import blocks
from blocks import find, registry
from blocks.actuators.dc_motor import DCMotor
from blocks.actuators.friction import BearingFriction
from blocks.controllers.dead_zone import DeadZone
from blocks.controllers.gain import Gain
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.controllers.saturation import Saturation
from blocks.links.assumed_modes import AssumedModesLink
from blocks.links.inertia import Inertia
from blocks.sources.constant import Constant
from blocks.sources.pulse import Pulse
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ConnectionProblem, ParameterError
from tests.blocks.assembly import model

ALL = sorted(registry().items())
UNITS: Any = pint.UnitRegistry()


def si_factor(unit: str) -> float:
    """What a Modelica unit is in SI base units, read without the code under test."""
    spelled = re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", unit).replace(".", "*")
    return float(UNITS.Quantity(1.0, UNITS.Unit(spelled if unit != "1" else "dimensionless")).to_base_units().magnitude)


@pytest.mark.parametrize(("name", "block"), ALL)
def test_units_are_coherent_si(name: str, block: type[Block]) -> None:
    units = {p.name: p.unit for p in block.parameters.values()}
    units |= {p.name: p.unit for p in block.ports.values() if p.role != "flange"}
    for what, unit in units.items():
        assert unit == "*" or si_factor(unit) == pytest.approx(1.0, rel=1e-15), f"{name}.{what} is in {unit}"


@pytest.mark.parametrize(("name", "block"), ALL)
def test_documentation_is_complete(name: str, block: type[Block]) -> None:
    assert re.search(r"[=:]", block.summary()), f"{name} does not open with its equation"
    declared: list[Any] = [*block.parameters.values(), *block.options.values(), *block.ports.values()]
    for what in declared:
        assert what.doc, f"{name}.{what.name}"
        assert not what.doc.endswith("."), f"{name}.{what.name}"
    for parameter in block.parameters.values():
        if parameter.tolerance is not None:
            assert not parameter.structural, f"{name}.{parameter.name} cannot be fitted"


def test_every_block_is_registered() -> None:
    written = set()
    for module in pkgutil.walk_packages(blocks.__path__, "blocks."):
        for name, value in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if issubclass(value, Block) and value.__module__ == module.name and not name.startswith("_"):
                written.add(name)
    here = {name for name, made in registry().items() if made.__module__.startswith("blocks.")}
    assert written - {"Source", "SignalBlock", "InverseDynamics"} == here


def test_block_files_stay_short() -> None:
    for file in Path(blocks.__path__[0]).rglob("*.py"):
        assert len(file.read_text().splitlines()) <= 150, file


def test_naming_blocks_imports_no_symbols() -> None:
    code = "import sys, blocks; blocks.registry(); sys.exit('casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_unknown_block_names_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"no block type 'DCMoter'\n  did you mean 'DCMotor'"):
        find("DCMoter")


class _Entry:
    def __init__(self, name: str, made: object) -> None:
        self.name, self.value, self._made = name, f"elsewhere:{name}", made

    def load(self) -> object:
        if isinstance(self._made, Exception):
            raise self._made
        return self._made


def test_blocks_of_other_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    class Flywheel(Inertia):
        """Flywheel: as an inertia."""

    entries = [
        _Entry("Flywheel", Flywheel),
        _Entry("Gear", Flywheel),
        _Entry("Broken", ImportError("no module named x")),
        _Entry("Number", 3),
    ]
    found_here = importlib.import_module("blocks.registry")
    monkeypatch.setattr(found_here, "entry_points", lambda group: entries if group == "flexarm.blocks" else [])
    registry.cache_clear()
    try:
        with pytest.warns(UserWarning, match="is not available") as warned:
            found = registry()
        assert found["Flywheel"] is Flywheel
        assert found["Gear"] is not Flywheel
        assert "Broken" not in found
        assert "Number" not in found
        reasons = " ".join(str(w.message) for w in warned)
        assert "the name is in use" in reasons
        assert "no module named x" in reasons
        assert "not a subclass" in reasons
    finally:
        registry.cache_clear()


MOTOR = {"resistance": 2.6, "torque_constant": 7.68e-3}
LINK = {"length": 0.4, "mass": 0.065, "flexural_rigidity": 0.13}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DCMotor(**MOTOR, resistence=2), "no parameter 'resistence'\n  did you mean 'resistance'"),
        (lambda: DCMotor(resistance=2.6), "needs 'torque_constant'.*\n  give torque_constant in N.m/A"),
        (lambda: DCMotor(resistance="2.6 V", torque_constant=1), "'2.6 V'.*'ohm' is expected"),
        (lambda: DCMotor(resistance=0, torque_constant=1), "0 is out of range: resistance must be > 0 ohm"),
        (lambda: DCMotor(**MOTOR, efficiency=1.2), "1.2 is out of range: efficiency must be > 0 and <= 1"),
        (lambda: DCMotor(resistance=float("nan"), torque_constant=1), "not a finite number"),
        (lambda: DeadZone(lower="0.1 V", upper="0.2 V"), "'0.1 V' is out of range: lower must be <= 0"),
        (lambda: Saturation(lower=5, upper=-5), "lower = 5 is not below upper = -5"),
        (lambda: Step(height=1, start=2, stop=1), "stop = 1 s is not after start = 2 s"),
        (lambda: Step(height="1 V", offset="1 mm"), "height is in V but offset in m"),
        (lambda: Pulse(width=0.2, count=3), "period = 0.2 s does not exceed width = 0.2 s"),
        (lambda: Pulse(width=0.2, count=-1), "-1 is out of range: count"),
        (lambda: Constant(), "Constant needs 'value': value of the signal, with its unit\n  give value$"),
        (lambda: LowPass(corner_frequency="10 V"), "'rad/s' is expected"),
        (lambda: Gain(gain=1, unit="mV"), "unit 'mV' is not a coherent SI unit\n  use 'V'"),
        (lambda: Gain(gain=1, unit="vlt"), "unknown unit 'vlt'"),
        (
            lambda: PI(proportional_gain="0.5 V.s/rad", integral_gain="0.5 V.s/rad"),
            "proportional_gain is in V.s/rad but integral_gain in V.s/rad",
        ),
        (
            lambda: BearingFriction(coulomb_friction=0.2, static_friction=0.1),
            "static_friction = 0.1 N.m is less than coulomb_friction = 0.2 N.m",
        ),
        (lambda: AssumedModesLink(**LINK, modes=0), "0 is out of range: modes"),
        (lambda: AssumedModesLink(**LINK, foreshortening=True), "foreshortening needs nonlinear: true"),
        (lambda: AssumedModesLink(**LINK, modes=2, damping_ratio=[0.1] * 3), "3 values\n  give 2, one per modes"),
    ],
)
def test_refusals_say_what_is_wrong(make: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()  # type: ignore[operator]


def test_texts_with_units_become_si() -> None:
    motor = DCMotor(resistance="2.6 ohm", torque_constant="7.68 mN.m/A", rotor_inertia="4.606 g.cm2")
    assert motor.torque_constant == pytest.approx(7.68e-3, rel=1e-15)
    assert motor.rotor_inertia == pytest.approx(4.606e-7, rel=1e-14)
    assert LowPass(corner_frequency="10 Hz").corner_frequency == pytest.approx(62.83185307, rel=1e-9)
    zone = DeadZone(lower="-90 mV", upper="0.18 V")
    assert (zone.lower, zone.upper) == pytest.approx((-0.09, 0.18))
    assert zone.unit_of("lower") == "V"
    assert Step(height="57.29577951308232 deg").height == pytest.approx(1.0)
    assert Step(height="1 rpm").unit_of("height") == "rad/s"


def test_parameters_left_out_follow_others() -> None:
    assert DCMotor(**MOTOR).back_emf_constant == 7.68e-3
    assert DCMotor(**MOTOR, back_emf_constant=1e-2).back_emf_constant == 1e-2

    def static(**given: float) -> tuple[float, float]:
        made = BearingFriction(**given)
        return made.static_friction, made.static_friction_backward

    assert static(coulomb_friction=1) == (1, 1)
    assert static(coulomb_friction=1, static_friction=1.5) == (1.5, 1.5)
    assert static(coulomb_friction=1, coulomb_friction_backward=0.5) == (1, 0.5)
    assert static(coulomb_friction=1, coulomb_friction_backward=0.5, static_friction=2) == (2, 2)


def test_a_followed_parameter_is_one_parameter_of_the_model() -> None:
    made = model({"motor": DCMotor(**MOTOR, rotor_inertia=1e-6), "v": Constant(value=1)}, "v.out motor.voltage")
    names = [p.name for p in made.parameters]
    assert "motor.torque_constant" in names
    assert "motor.back_emf_constant" not in names


def test_a_source_in_the_wrong_unit_is_refused() -> None:
    parts = {"motor": DCMotor(**MOTOR, rotor_inertia=1e-6), "source": Step(height="1 mm")}
    with pytest.raises(ConnectionProblem, match=r"'source.out' is in m but 'motor.voltage' takes V"):
        model(parts, "source.out motor.voltage")
