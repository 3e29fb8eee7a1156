"""Every shipped scenario loads, fits the JSON Schema, runs and linearises; the Quanser arm gives its numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from blocks.registry import registry
from engine.linear_modes import deaf
from flexarm.api import linearise, simulate
from flexarm.cut import cut
from scenarios.jsonschema import json_schema
from scenarios.load import SHIPPED, load, shipped_names


@pytest.fixture(scope="module")
def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", shipped_names())
def test_it_works(name: str) -> None:
    scenario = load(name)
    assert scenario.name == name
    assert scenario.description
    result = simulate(scenario, stop=0.05)
    assert np.isfinite(result.values).all()
    for key, analysis in scenario.analyses.items():
        made = cut(scenario, analysis.kind, key)
        assert [v.name for v in made.model.inputs] == list(analysis.inputs)
        if analysis.kind == "linearise":
            assert np.isfinite(linearise(made).A).all()


@pytest.mark.parametrize("name", shipped_names())
def test_it_linearises_to_something_without_options(name: str) -> None:
    """Every input moves an output unless the file itself asks for a mode in which none does; poles are finite."""
    linear = linearise(name)
    assert linear.states
    assert np.isfinite(linear.poles()).all()
    asked = next((a.modes for a in load(name).analyses.values() if a.kind == "linearise"), {})
    if not asked:
        assert deaf(linear) == []
    if not load(name).analyses:
        assert linear.moving == {}
        assert any("what the sources feed" in text for text in linear.assumed)


@pytest.mark.parametrize("name", shipped_names())
def test_it_fits_the_json_schema(name: str, validator: Any) -> None:
    assert list(validator.iter_errors(load(name).document.plain())) == []


@pytest.mark.parametrize(
    "change",
    [
        {"blokcs": {}},
        {"schema": 2},
        {"blocks": {"a": {"type": "DCMotro"}}},
        {"blocks": {"a": {"type": "Gear"}}},
        {"blocks": {"a": {"type": "Gear", "ratio": 0}}},
        {"blocks": {"a": {"type": "Gear", "ratio": "many"}}},
        {"blocks": {"a": {"type": "Gear", "ratio": 2, "ratoi": 2}}},
        {"blocks": {"a": {"type": "Backlash", "stiffness": 1, "half_gap": 0, "law": "pull"}}},
        {"simulate": {"step": 1}},
        {"analyses": {"p": {"kind": "linearize", "inputs": ["a.b"], "outputs": ["a.b"]}}},
    ],
)
def test_the_json_schema_refuses(change: dict[str, Any], validator: Any) -> None:
    document = load("srv02-bare").document.plain() | change
    assert list(validator.iter_errors(document))


def test_the_json_schema_describes_every_parameter() -> None:
    definitions = json_schema()["$defs"]
    for name, cls in registry().items():
        properties = definitions[f"block {name}"]["properties"]
        assert set(properties) == {"type", *cls.parameters, *cls.options}
        for key, made in cls.parameters.items():
            assert made.doc in properties[key]["description"]
            assert properties[key]["x-unit"] == made.unit


def test_a_sub_assembly_fits_the_json_schema(validator: Any) -> None:
    document = load("srv02-bare").document.plain()
    document["blocks"]["arm"] = {"type": "./arm.yaml", "link.mass": "1 kg", "parameters": {"span": 1}}
    assert list(validator.iter_errors(document)) == []


def test_data_files_are_those_of_the_recordings() -> None:
    for name in shipped_names():
        for recording in load(name).recordings.values():
            outside = recording.file.startswith("$FLEXARM_RECORDINGS/")
            assert outside or (SHIPPED / recording.file).is_file()


def quanser(dead_zone: bool, *changes: str) -> tuple[float, float]:
    """Angle (deg) after 1 s of coasting and largest tip deflection (mm)."""
    name = "quanser-single-link" + ("" if dead_zone else "-no-dead-zone")
    result = simulate(load(name, changes), stop=2.0)
    return math.degrees(result["link.hub.angle"][-1]), 1e3 * np.abs(result["link.tip.deflection"]).max()


def test_quanser_step() -> None:
    """Values computed independently: 1 V for 1 s, then 1 s of coasting; set A, both dampings."""
    (without, tip), (with_zone, tip_zone) = quanser(False), quanser(True)
    assert without == pytest.approx(100.741, abs=0.05)
    assert with_zone == pytest.approx(82.607, abs=0.05)
    assert without - with_zone == pytest.approx(18.133, abs=0.05)
    assert with_zone / without == pytest.approx(0.82, abs=1e-4)
    assert tip == pytest.approx(26.1, abs=0.2)
    assert tip_zone == pytest.approx(21.4, abs=0.2)
    damped = "bearing.viscous_friction=0.015"
    assert quanser(False, damped)[0] == pytest.approx(87.553, abs=0.05)
    assert quanser(True, damped)[0] == pytest.approx(71.794, abs=0.05)
    assert quanser(True, "supply=-1 V")[0] / quanser(False, "supply=-1 V")[0] == pytest.approx(0.91, abs=1e-4)


def test_quanser_is_linear_at_one_volt_and_not_at_five() -> None:
    """Computed independently: peak of the nonlinear minus the linear angle, without the dead zone."""
    for volts, expected in ((1, 0.011), (2, 0.088), (5, 1.48)):
        curves = []
        for nonlinear in ("true", "false"):
            scenario = load("quanser-single-link-no-dead-zone", [f"supply={volts} V", f"link.nonlinear={nonlinear}"])
            curves.append(np.degrees(simulate(scenario, stop=2.0)["link.hub.angle"]))
        difference = np.abs(curves[0] - curves[1]).max()
        assert difference == pytest.approx(expected, rel=0.1)


SETS = {
    "A": ([], [0, -17.489, -7.917 + 24.785j], [0, -0.680, -0.572 + 30.868j]),
    "A, Beq 0.015": (
        ["bearing.viscous_friction=0.015"],
        [0, -22.740, -7.802 + 23.200j],
        [0, -2.579, -2.133 + 30.633j],
    ),
    "B": (
        ["link.length=0.381", "link.flexural_rigidity=0.1033211"],
        [0, -20.416, -6.602 + 23.270j],
        [0, -0.766, -0.538 + 29.216j],
    ),
}


@pytest.mark.parametrize("name", SETS)
def test_quanser_poles_and_zeros(name: str) -> None:
    """Computed independently: poles of theta/V, and of theta/tau (no back-emf); zeros at the clamped frequency."""
    changes, of_voltage, of_torque = SETS[name]
    for extra, poles in (([], of_voltage), (["motor.back_emf_constant=0"], of_torque)):
        linear = linearise(load("quanser-single-link", [*changes, *extra]))
        upper = [pole for pole in linear.poles() if pole.imag >= 0]
        for found, expected in zip(sorted(upper, key=abs), sorted(poles, key=abs), strict=True):
            assert abs(found - expected) <= 1e-3 * abs(expected) + 1e-9
        zeros = linear.zeros("link.hub.angle")
        np.testing.assert_allclose(np.abs(zeros), 6 * np.pi, rtol=1e-6)
        np.testing.assert_allclose(zeros.real, 0, atol=1e-6)
