"""Expressions in values: arithmetic, units, what they share in a model, and errors that show the place."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import FlexarmError, ParameterError
from engine.simulate import simulate
from scenarios.expressions import Amount, amount, evaluate
from scenarios.load import Scenario, load

DISC = """
schema: 1
name: disc
parameters:
  mass: 2 kg
  radius: 50 mm
  inertia: 0.5 * $mass * $radius^2
  half: 1 / 2
blocks:
  disc: {type: Inertia, inertia: $inertia}
  spring: {type: GroundSpring, stiffness: $mass * 9.81 m/s2 * $radius}
connect:
  - [disc.shaft, spring.shaft]
initial: {disc.shaft.angle: "= 2 * 0.1"}
tolerances: {mass: 20 %}
simulate: {stop: $mass / 1 kg * 0.5 s, step: 1 ms}
""".replace("  half: 1 / 2\n", "")


def scenario(tmp_path: Path, *changes: str, text: str = DISC) -> Scenario:
    path = tmp_path / "disc.yaml"
    path.write_text(text)
    return load(path, changes)


def worth(text: str, **names: object) -> Amount:
    return evaluate(text, lambda name: amount(names[name]))


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("1 + 2 * 3", 7.0, "1"),
        ("-2^2", -4.0, "1"),
        ("2^-1", 0.5, "1"),
        ("2^3^2", 512.0, "1"),
        ("(1 - 4) / 2", -1.5, "1"),
        ("$m * $r^2", 2 * 0.05**2, "kg.m2"),
        ("$m*$r**2", 2 * 0.05**2, "kg.m2"),
        ("20 mm + 3 cm", 0.05, "m"),
        ("= 7850 kg/m3 * 2 m^3", 15700.0, "kg"),
        ("sqrt(16 m2) / 2 s", 2.0, "m/s"),
        ("sqrt($k / $m)", math.sqrt(8.0), "1/s"),
        ("max(3 mm, 1 cm)", 0.01, "m"),
        ("abs(-3 N.m)", 3.0, "kg.m2/s2"),
        ("sin(90 deg) * cos(pi)", -1.0, "1"),
        ("exp(log(5))", 5.0, "1"),
        ("1 V / (2 V/(rad/s))", 0.5, "1/s"),
        ("10 Hz", 20 * math.pi, "1/s"),
        ("2 * 5 1/s", 10.0, "1/s"),
        ("7.68 mN.m/A * 2 A", 0.01536, "kg.m2/s2"),
    ],
)
def test_values_and_units(text: str, value: float, unit: str) -> None:
    found = worth(text, m="2 kg", r="50 mm", k="16 N/m")
    assert found.value == pytest.approx(value, rel=1e-14)
    assert found.unit == unit


_NUMBERS = st.integers(1, 9).map(str)
_TREES = st.recursive(
    _NUMBERS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from([" + ", "-", "*", " / "]), inner).map("".join),
        inner.map(lambda text: f"({text})"),
        inner.map(lambda text: f"-({text})"),
    ),
    max_leaves=12,
)


@given(_TREES)
def test_arithmetic_is_that_of_the_language(text: str) -> None:
    """Against Python's own parser, which the tests may use and the loader may not."""
    try:
        expected = eval(text, {"__builtins__": {}})
    except ZeroDivisionError:
        with pytest.raises(ParameterError):
            worth(text)
        return
    assert worth(text).value == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("$m + $r", "at character 8: kg and m cannot be added"),
        ("2 m * ", "it ends where a value should follow"),
        ("2 m *", "it ends where a value should follow"),
        ("(2 + 3", "a bracket is not closed"),
        ("2 3", "'3' is not expected here"),
        ("foo(2)", "'foo' is no function"),
        ("m * 2", "'m' is no function"),
        ("sin(2 m)", "the argument of sin must be a pure number, and this is in m"),
        ("(2 m) ^ (1 s)", "an exponent must be a pure number"),
        ("$m ^ $n", "cannot be raised"),
        ("min(1 m, 2 s)", "m and s cannot be compared"),
        ("max(1)", "max takes 2 values, not 1"),
        ("1 / 0", "cannot be worked out"),
        ("sqrt(-1)", "cannot be worked out"),
        ("__import__('os')", "'__import__' is no function"),
        ("$m.__class__", "has no meaning"),
        ("2 furlongz * 3", "unknown unit 'furlongz'"),
        ("(" * 60 + "1" + ")" * 60, "brackets within brackets"),
        ("1" + "+1" * 900, "at most 1000 characters"),
    ],
)
def test_what_does_not_fit_is_shown_with_its_place(text: str, message: str) -> None:
    def leaf(name: str) -> Amount:
        return Amount(object(), ()) if name == "n" else amount({"m": "2 kg", "r": "50 mm"}[name])

    with pytest.raises(ParameterError) as caught:
        evaluate(text, leaf)
    assert message in str(caught.value)


def test_what_an_expression_reads_is_tuned_swept_and_shared(tmp_path: Path) -> None:
    """A run of a model tuned to a mass is the run of a scenario with that mass: both inertia and weight follow."""
    model = scenario(tmp_path).build()
    assert {p.name: p.unit for p in model.parameters if p.name in ("mass", "radius")} == {"mass": "kg", "radius": "m"}
    assert "disc.inertia" not in {p.name for p in model.parameters}
    assert model.parameters[model.parameter_index("mass")].users == ("disc.inertia", "spring.stiffness")
    tuned = simulate(model, 1.0, parameters={"mass": 3.0, "radius": 0.08})
    loaded = simulate(scenario(tmp_path, "mass=3 kg", "radius=8 cm").build(), 1.0)
    np.testing.assert_array_equal(tuned["disc.shaft.angle"], loaded["disc.shaft.angle"])
    # w^2 = m g r / (m r^2 / 2) = 2 g / r, whatever the mass
    w = math.sqrt(2 * 9.81 / 0.08)
    np.testing.assert_allclose(tuned["disc.shaft.angle"], 0.2 * np.cos(w * tuned.time), rtol=0, atol=1e-7)


def test_a_block_bounds_what_an_expression_reads_too(tmp_path: Path) -> None:
    text = DISC.replace("connect:", "  cart: {type: Mass, mass: $mass}\nconnect:")
    for order in (
        text,
        text.replace("  cart: {type: Mass, mass: $mass}\n", "").replace(
            "blocks:\n", "blocks:\n  cart: {type: Mass, mass: $mass}\n"
        ),
    ):
        model = scenario(tmp_path, text=order).build()
        assert model.parameters[model.parameter_index("mass")].declared.gt == 0
        assert model.parameters[model.parameter_index("radius")].declared.bounds == (-math.inf, math.inf)


def test_times_and_starting_values_are_worked_out(tmp_path: Path) -> None:
    made = scenario(tmp_path)
    assert made.simulation is not None
    assert made.simulation.stop == 1.0
    assert made.system.initial == {"disc.shaft.angle": pytest.approx(0.2)}


def test_a_sub_assembly_is_given_expressions_and_has_its_own(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(
        """
schema: 1
name: arm
parameters: {length: 1 m, mass: 2 kg, inertia: $mass * $length^2 / 3}
blocks:
  body: {type: Inertia, inertia: $inertia}
expose: {shaft: body.shaft}
"""
    )
    made = scenario(
        tmp_path,
        text="""
schema: 1
name: two
parameters: {reach: 0.5 m}
blocks:
  left: {type: arm.yaml, length: 2 * $reach}
  right: {type: arm.yaml, mass: 5 kg}
simulate: {stop: 1 s}
""".replace("length: 2 * $reach", "parameters: {length: 2 * $reach}").replace("mass: 5 kg", "parameters: {mass: 5 kg}"),
    )
    assert made.system.blocks["left.body"].values["inertia"] == pytest.approx(2 / 3)
    assert made.system.blocks["right.body"].values["inertia"] == pytest.approx(5 / 3)
    users = {p.name: p.users for p in made.build().parameters}
    assert users == {}  # no equation needs them: the bodies are free
    shared: Any = made.system.shared["left.body"]["inertia"]
    assert set(shared.arguments) == {"reach", "left.mass"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("inertia=$mass * $radius", "unit 'kg.m' does not fit: 'kg.m2' is expected (the value of $inertia)"),
        ("inertia=$mas * 2", "'$mas' names no parameter"),
        ("inertia=2 * $inertia", "parameter 'inertia' depends on itself"),
        ("disc.inertia=$mass * $radius^2 *", "blocks.disc.inertia: '$mass * $radius^2 *'"),
        ("spring.stiffness=2 * 3", "unknown unit '* 3'"),
    ],
)
def test_errors_of_a_scenario_name_place_and_expression(tmp_path: Path, change: str, message: str) -> None:
    with pytest.raises(FlexarmError) as caught:
        scenario(tmp_path, change)
    assert message in str(caught.value)
