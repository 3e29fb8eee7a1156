"""Tangents against central differences of whole runs, through friction, contact, samples and steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.assemble import build
from engine.errors import ParameterError
from engine.simulate import Result, simulate
from engine.tangent import tangents
from scenarios.load import load
from tests.engine.parts import Body, Dry, Held, Jump, Lag, Push, Rest, Spring, Wave, system

WRT = [
    "m.inertia",
    "f.level",
    "s.stiffness",
    "s.damping",
    "r.gap",
    "r.stiffness",
    "j.start",
    "j.height",
    "w.amplitude",
    "w.phase",
    "h.gain",
    "lag.corner",
    "l.shaft.angle",
    "s.b.speed",
]


@pytest.fixture(scope="module")
def model() -> Any:
    plant = system(
        {
            "w": Wave(amplitude=2.0, frequency=9.0),
            "j": Jump(height=0.5, start=0.3333),
            "h": Held(period=0.004),
            "t": Push(),
            "t2": Push(),
            "m": Body(inertia=0.02),
            "f": Dry(level=0.4, static=0.6),
            "s": Spring(stiffness=20.0, damping=0.01),
            "l": Body(inertia=0.05),
            "r": Rest(stiffness=300.0, damping=0.2, gap=0.05),
            "lag": Lag(corner=30.0),
        },
        ("w.out", "h.in"),
        ("h.out", "t.in"),
        ("j.out", "t2.in"),
        ("t.shaft", "m.shaft", "f.shaft", "s.a"),
        ("s.b", "l.shaft", "r.shaft", "t2.shaft"),
        ("l.shaft.speed", "lag.in"),
    )
    return build(plant, outputs=["m.shaft.angle", "l.shaft.speed", "lag.out", "h.out"])


def _order(result: Result) -> list[tuple[str, float]]:
    """The modes that were changed, and what to, in order."""
    return [(mode, value) for _, mode, value in result.events]


@pytest.mark.parametrize("name", WRT)
def test_tangents_agree_with_central_differences_through_every_event(model: Any, name: Any) -> None:
    found = tangents(model, 1.0, 1e-3, wrt=WRT)
    assert found.result.event_count > 20
    assert not found.grazing
    values = {parameter.name: parameter.value for parameter in model.parameters}
    delta = 1e-6 * max(abs(values.get(name, 0.0)), 0.1)
    runs = []
    for side in (1, -1):
        change = {name: values.get(name, 0.0) + side * delta}
        inside = name in values
        parameters, initial = (change, None) if inside else (None, change)
        runs.append(simulate(model, 1.0, 1e-3, parameters=parameters, initial=initial))
    assert _order(runs[0]) == _order(runs[1])
    difference = (runs[0].values - runs[1].values) / (2 * delta)
    tangent = found.values[:, :, WRT.index(name)]
    scale = np.abs(tangent).max(axis=0) + 1e-9
    assert (np.abs(difference - tangent).max(axis=0) / scale).max() < 1e-6


def test_what_a_table_in_the_model_is_multiplied_with_has_its_own_derivative() -> None:
    """Tables are inputs too: their columns of a Jacobian stand between those of other inputs and of memories."""
    made = load("flexible-arm-braked").build()
    assert made.tables
    for name in ("recording.scale", "arm.mass[1]"):
        value = made.parameter_values[made.parameter_index(name)]
        ends = [simulate(made, 0.4, parameters={name: value * s}).values for s in (1 + 1e-5, 1 - 1e-5)]
        expected = (ends[0] - ends[1]) / (2e-5 * value)
        # Beside a direction that nothing depends on, so that a column in the wrong place shows.
        found = tangents(made, 0.4, wrt=[name, "brake.reference"])
        assert np.abs(found.values[:, :, 0] - expected).max() < 1e-5 * np.abs(expected).max()
        assert not found.values[:, :, 1].any()


def test_the_derivative_of_a_stopping_distance_is_exact() -> None:
    plant = system({"m": Body(inertia=2.0), "f": Dry(level=3.0)}, ("m.shaft", "f.shaft"))
    model = build(plant, outputs=["m.shaft.angle"])
    found = tangents(model, 1.0, 1e-2, wrt=["f.level", "m.shaft.speed", "m.inertia"], initial={"m.shaft.speed": 0.7})
    at_end = {name: found.of("m.shaft.angle", name)[-1] for name in found.wrt}
    assert at_end["f.level"] == pytest.approx(-2.0 * 0.7**2 / (2 * 3.0**2), rel=1e-10)
    assert at_end["m.shaft.speed"] == pytest.approx(2.0 * 0.7 / 3.0, rel=1e-10)
    assert at_end["m.inertia"] == pytest.approx(0.7**2 / (2 * 3.0), rel=1e-10)


def test_an_unknown_direction_is_refused_with_the_nearest_name(model: Any) -> None:
    with pytest.raises(ParameterError, match=r"did you mean 'f\.level'"):
        tangents(model, 1.0, wrt=["f.levl"])


@pytest.mark.parametrize("count", [1, 3, 4, 7, 8, 11, 14])
def test_directions_together_are_those_of_each_alone(model: Any, count: int) -> None:
    # However the directions fill the lanes of a vector, and however many are left empty.
    together = tangents(model, 1.0, 0.01, wrt=WRT[:count], room=count + 2)
    for k, name in enumerate(WRT[:count]):
        alone = tangents(model, 1.0, 0.01, wrt=[name])
        np.testing.assert_allclose(together.values[:, :, k], alone.values[:, :, 0], rtol=1e-9, atol=1e-12)
