"""All that a parameter of the scenario gives follows it, or a change of it in a built model is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexarm
from diagnosis.api import fit
from diagnosis.estimation.parameters import free_parameters
from engine.errors import FlexarmError, ParameterError
from fmu.plan import plan
from fmu.python_core import Core
from scenarios.amend import Set
from scenarios.load import Scenario, load
from scenarios.variant import edited
from tests.diagnosis.plants import case

CURVES = """\
schema: 1
name: curves
parameters: {a: 2, three: "= 1 + 2"}
blocks:
  wave:   {type: Sine, amplitude: 3, frequency: 0.2 Hz}
  table:  {type: LookupTable, points: 4, breakpoints: [-3, -1, 1, 3], heights: [0, $a, 2 * $a, 7]}
  level:  {type: LookupTable, points: 2, breakpoints: [0, $three], heights: $a}
  gain:   {type: Gain, gain: $a}
  other:  {type: Gain, gain: $three + 1}
connect:
  - [wave.out, table.in, level.in, gain.in, other.in]
tolerances: {table.heights: 10 %}
simulate: {stop: 5 s, step: 0.1 s}
"""
HALF = CURVES.replace("a: 2, three", "a: 2, n: 2, three").replace(
    "level:  {type: LookupTable, points: 2", "level:  {type: LookupTable, points: $n"
)
HALF = HALF.replace("gain: $a}", "gain: $n}")

DISC = """\
schema: 1
name: disc
parameters: {s: 2 kg}
blocks:
  disc: {type: Inertia, inertia: $s * 1 m2}
  spring: {type: GroundSpring, stiffness: 1 N.m/rad}
connect: [[disc.shaft, spring.shaft]]
initial: {disc.shaft.angle: $s / 1 kg}
simulate: {stop: 1 s}
"""


@pytest.fixture
def curves(tmp_path: Path) -> Path:
    path = tmp_path / "curves.yaml"
    path.write_text(CURVES)
    return path


@pytest.fixture
def half(tmp_path: Path) -> Scenario:
    path = tmp_path / "half.yaml"
    path.write_text(HALF)
    return load(path)


@pytest.mark.parametrize(("name", "value"), [("a", 5.0), ("three", 4.0)])
def test_values_of_lists_follow(curves: Path, name: str, value: float) -> None:
    """A built model tuned to a value gives what the scenario with that value gives."""
    tuned = flexarm.simulate(curves, parameters={name: value})
    built = flexarm.simulate(load(curves, [f"{name}={value}"]))
    before = flexarm.simulate(curves)
    for signal in ("table.out", "level.out", "gain.out", "other.out"):
        np.testing.assert_array_equal(tuned[signal], built[signal])
        follows = signal in (("table.out", "level.out", "gain.out") if name == "a" else ("other.out",))
        assert np.allclose(tuned[signal], before[signal]) is not follows


def test_what_follows_is_no_parameter_of_its_own(curves: Path) -> None:
    made = load(curves)
    names = {p.name for p in made.build().parameters}
    assert {"a", "three", "table.heights[1]", "table.heights[4]"} <= names
    assert not names & {"table.heights[2]", "table.heights[3]", "level.heights[1]", "level.breakpoints[2]"}
    assert set(made.tolerances) == {"table.heights[1]", "table.heights[4]"}
    with pytest.raises(ParameterError, match=r"'level.heights' follows 'a'"):
        (again := load(curves, ["tolerances.level.heights=10 %"])).tolerances_of(again.build())
    changed = edited(made, [Set("table", "heights", [1, 2, 3, 4])])
    assert "table" not in {user.split(".")[0] for p in changed.build().parameters if p.name == "a" for user in p.users}


def test_what_cannot_follow_is_named(half: Scenario) -> None:
    model = half.build()
    words = "'n' gives 'level.points' too"
    with pytest.raises(ParameterError, match=words):
        flexarm.simulate(model, 1.0, parameters={"n": 3.0})
    with pytest.raises(ParameterError, match=words):
        flexarm.linear_family(half, grid={"n": "2,3"}, inputs=["gain.in"], outputs=["gain.out"])
    flexarm.simulate(model, 1.0, parameters={"n": 2.0})  # it is what it was
    assert edited(half, [Set("level", "points", 2)]).system.fixed_by("n") == ()


def test_a_start_cannot_follow(tmp_path: Path) -> None:
    path = tmp_path / "disc.yaml"
    path.write_text(DISC)
    flexarm.simulate(path, parameters={"s": 2.0})
    with pytest.raises(ParameterError, match=r"the start of 'disc.shaft.angle'"):
        flexarm.simulate(path, parameters={"s": 3.0})


def test_an_importer_cannot_set_it(half: Scenario) -> None:
    made = plan(half.build(["gain.in"], ["gain.out", "level.out"]))
    variable = next(v for v in made.variables if v.name == "n")
    assert (variable.minimum, variable.start, variable.maximum) == (2.0, 2.0, 2.0)
    assert "gives 'level.points' too" in variable.doc
    core = Core(made)
    core.set([variable.reference], [2.0])
    with pytest.raises(ParameterError, match="'n'"):
        core.set([variable.reference], [3.0])


def test_a_fit_of_it_is_refused(tmp_path: Path) -> None:
    path = case(tmp_path)
    text = path.read_text().replace("resistance: 2.75 ohm", "resistance: $r")
    text = text.replace("blocks:", "parameters: {r: 2.75 ohm}\n\nblocks:", 1)
    path.write_text(text + "\ninitial: {motor.shaft.speed: $r / 1 ohm * 0 rad/s}\n")
    with pytest.raises(FlexarmError, match=r"'r' gives the start of 'motor.shaft.speed' too, which a fit does not"):
        fit(path)
    held = load(path, ["tolerances.r=0"])
    assert "r" not in {f.name for f in free_parameters(held.build(), held.tolerances)}


def test_a_list_with_formulas_is_in_one_unit(tmp_path: Path) -> None:
    """What a formula gives is spelled in base units: 2 * $supply is in kg.m2/(A.s3), which is V."""
    path = tmp_path / "supply.yaml"
    text = CURVES.replace("a: 2,", "supply: 2 V,").replace("{type: Gain, gain: $a}", "{type: Offset, offset: $supply}")
    text = text.replace("amplitude: 3", "amplitude: 3 V").replace("heights: $a", "heights: 3")
    text = text.replace("heights: [0, $a, 2 * $a, 7]", "heights: [2 * $supply, $supply, -1 V, 7]")
    path.write_text(text)
    made = load(path)
    assert made.system.blocks["table"].values["heights"] == (4.0, 2.0, -1.0, 7.0)
    assert made.system.blocks["table"].unit_of("heights") == "V"
    with pytest.raises(FlexarmError, match=r"values in .* and in A stand in one list"):
        load(path, ["table.heights=[2 * $supply, $supply, 1 A, 7]"])


def test_a_recording_sets_what_a_formula_reads(tmp_path: Path) -> None:
    """To set the formula's own value ended in 'unhashable type'."""
    path = case(tmp_path)
    text = path.read_text().replace("resistance: 2.75 ohm", "resistance: 2 * $r")
    text = text.replace("blocks:", "parameters: {r: 1.375 ohm}\n\nblocks:", 1)
    path.write_text(text.replace("    role: train\n", "    role: train\n    set: {motor.resistance: 3 ohm}\n", 1))
    with pytest.raises(FlexarmError, match=r"'motor.resistance' is 2 \* \$r\n.*set what it follows: 'r'"):
        fit(path)
