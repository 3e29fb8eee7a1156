"""A controller put back into a scenario: against the closed loop of python-control, and the errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from engine.errors import FlexarmError, ParameterError
from flexarm.api import simulate
from flexarm.design.closing import close, closed, sampled
from flexarm.design.margins import margins
from scenarios.load import load

AXIS = """\
schema: 1
name: axis
blocks:
  source: {type: Step, height: 0.1}
  motor: {type: Force}
  guide: {type: TranslationalBearingFriction, viscous_friction: 200 N.s/m}
  carriage: {type: Mass, mass: 95 kg}
connect:
  - [source.out, motor.force]
  - [motor.flange, guide.slide, carriage.flange]
simulate: {stop: 0.5 s, step: 1 ms, record: [carriage.flange.position]}
"""

LEAD = control.ss(control.tf([4.0e3, 6.0e4], [1 / 400, 1]))
PLANT = control.tf([1], [95, 200, 0])
CARRIAGE: dict[str, Any] = {"feed": "motor.force", "measure": ["carriage.flange.position"], "reference": "source.out"}


@pytest.fixture
def axis(tmp_path: Path) -> Path:
    path = tmp_path / "axis.yaml"
    path.write_text(AXIS)
    return path


def test_the_loop_is_that_of_the_design(axis: Path) -> None:
    made = close(axis, LEAD, axis.parent / "closed.yaml", **CARRIAGE)
    run = simulate(made)
    expected = control.step_response(control.feedback(LEAD * PLANT, 1) * 0.1, run.time)
    np.testing.assert_allclose(run.values[:, 0], np.ravel(expected.outputs), atol=2e-5)
    found = margins(made, loop="motor.force").members[0]
    _, pm, *_ = control.stability_margins(LEAD * PLANT)
    assert found.phase == pytest.approx(pm, rel=1e-3)


def test_sampled_with_a_delay(axis: Path) -> None:
    """One period of computation: the margins are those of z^-1 K(z) and the plant behind a hold."""
    K = sampled(LEAD, 2e-3, delay=1)
    plain = control.sample_system(LEAD, 2e-3, "tustin")
    for w in (10.0, 100.0, 700.0):
        z = np.exp(1j * w * 2e-3)
        assert complex(K(z)) == pytest.approx(complex(plain(z)) / z, rel=1e-9)
    made = close(axis, LEAD, axis.parent / "closed.yaml", **CARRIAGE, period=2e-3, delay=1)
    assert type(made.system.blocks["controller"]).__name__ == "DiscreteStateSpace"
    run = simulate(made)
    # At the sample instants the plant behind a hold is a sampled one, and the loop a linear system.
    loop = control.feedback(K * control.sample_system(PLANT, 2e-3, "zoh"), 1)
    expected = np.ravel(control.step_response(loop * 0.1, run.time[::2]).outputs)
    np.testing.assert_allclose(run.values[::2, 0], expected, atol=1e-9)


def test_a_file_of_matrices(axis: Path) -> None:
    file = axis.parent / "k.json"
    file.write_text(json.dumps({"D": [[1000.0]]}))
    text = closed(axis, file, **CARRIAGE)
    assert "StateSpace" in text
    file.write_text(json.dumps({"E": [[1000.0]]}))
    with pytest.raises(FlexarmError, match="holds none of"):
        closed(axis, file, **CARRIAGE)


@pytest.mark.parametrize(
    ("held", "said"),
    [
        ({"A": [[0]], "B": [[1]], "C": [[1]], "D": [["a"]]}, "'D' in '.*k.json' is no matrix of numbers"),
        ({"A": [[0]], "B": [[1]], "C": [[1], [2, 3]], "D": [[0]]}, "'C' in '.*k.json' is no matrix of numbers"),
        ({"A": [[0]], "B": [[1, 2]], "C": [[1]], "D": [[0]]}, "k.json: B is 1 by 2, not 1 by 1"),
        ({"A": [[0, 1]], "B": [[1]], "C": [[1]], "D": [[0]]}, "k.json: A is 1 by 2, not 1 by 1"),
        ({"A": [[0]], "B": [[1]], "D": [[0]]}, "k.json: 'C' is missing"),
        ({"D": [[1]], "dt": "1 ms"}, "'dt' in '.*k.json' is no matrix of numbers"),
    ],
)
def test_matrices_that_do_not_fit(axis: Path, held: dict[str, Any], said: str) -> None:
    """None is left out in silence: a D that is no number was taken for zero."""
    file, new = axis.parent / "k.json", axis.parent / "new.yaml"
    file.write_text(json.dumps(held))
    with pytest.raises(FlexarmError, match=said):
        close(axis, file, new, **CARRIAGE)
    assert not new.exists()


def test_a_file_without_period_is_continuous(axis: Path) -> None:
    file = axis.parent / "k.json"
    file.write_text(json.dumps({"D": [[1000.0]], "dt": None}))
    assert "DiscreteStateSpace" not in closed(axis, file, **CARRIAGE)


def test_values_that_were_set_stay_set(axis: Path) -> None:
    """The controller was made for that plant: 120 kg were loaded, and 95 kg written."""
    loaded = load(axis, ["carriage.mass=120 kg", "simulate.stop=0.2 s", "initial.carriage.flange.position=1 mm"])
    made = close(loaded, LEAD, axis.parent / "closed.yaml", **CARRIAGE)
    assert made.overrides == ()
    assert made.system.blocks["carriage"].values["mass"] == 120.0
    run = simulate(made)
    assert run.time[-1] == pytest.approx(0.2)
    assert run.values[0, 0] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("method", "system", "said"),
    [
        ("matched", control.tf([1, 10], [1, 0]), "matches the gain at rest, and this one integrates"),
        ("matched", control.ss(-1, [[1, 2]], 1, [[0, 0]]), "one measured signal alone"),
        ("impulse", control.tf([1, 10], [1, 1]), "'impulse' cannot sample this controller: .*strictly proper"),
    ],
)
def test_a_method_that_cannot_sample_a_controller(method: str, system: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        sampled(system, 1e-3, method)


def test_poles_and_zeros_matched() -> None:
    """(s + 20)/(s + 5) has the zero and the pole exp(-20 T) and exp(-5 T), and keeps its gain at rest."""
    made = sampled(control.tf([1, 20], [1, 5]), 0.01, "matched")
    assert made.poles() == pytest.approx(np.exp([-0.05]))
    assert made.zeros() == pytest.approx(np.exp([-0.2]))
    assert complex(made(1.0)) == pytest.approx(4.0)


def test_a_controller_that_says_no_period(axis: Path) -> None:
    """Sampled, but how often is open: python-control's True was taken for a second."""
    K = control.ss(0.5, 1.0, 1.0, 0.0, True)
    with pytest.raises(ParameterError, match="does not say how often"):
        closed(axis, K, **CARRIAGE)
    assert "period: 0.002 s" in closed(axis, K, **CARRIAGE, period=2e-3)
    file = axis.parent / "k.json"
    for dt, said in ((-1, "k.json: the controller is sampled, and does not say how often"), (-2, "-2 s cannot be")):
        file.write_text(json.dumps({"A": [[0.5]], "B": [[1]], "C": [[1]], "D": [[0]], "dt": dt}))
        with pytest.raises(ParameterError, match=said):
            closed(axis, file, **CARRIAGE)


def test_a_delay_in_periods_of_the_controller(axis: Path) -> None:
    K = sampled(LEAD, 2e-3)
    assert closed(axis, K, **CARRIAGE, delay=1) == closed(axis, K, **CARRIAGE, delay=1, period=2e-3)


def test_bad_input(axis: Path) -> None:
    with pytest.raises(FlexarmError, match=r"'motor.forse' is not an input"):
        closed(axis, LEAD, **{**CARRIAGE, "feed": "motor.forse"})
    with pytest.raises(FlexarmError, match="1 inputs and 1 outputs, for 2 measured signals"):
        closed(axis, LEAD, **{**CARRIAGE, "measure": ["carriage.flange.position", "carriage.flange.speed"]})
    with pytest.raises(FlexarmError, match="needs a sample period"):
        closed(axis, LEAD, **CARRIAGE, delay=1)
    with pytest.raises(FlexarmError, match="no method 'tusten'"):
        closed(axis, LEAD, **CARRIAGE, period=1e-3, method="tusten")
    before = set(axis.parent.iterdir())
    with pytest.raises(FlexarmError):
        close(axis, LEAD, axis.parent / "c.yaml", **{**CARRIAGE, "measure": ["carriage.flange.nothing"]})
    assert set(axis.parent.iterdir()) == before
