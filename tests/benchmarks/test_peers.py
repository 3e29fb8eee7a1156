"""The problems that other tools get, solved in ways that share nothing; and the pages made of what was measured."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.peers import problems, scaling, tools
from benchmarks.peers.__main__ import main
from benchmarks.peers.sindy import judge


def apart(y: Any, exact: Any) -> Any:
    return np.sqrt(np.mean((y - exact) ** 2) / np.mean(exact**2))


def named(chosen: Any, name: Any) -> Any:
    return next(tool for tool in chosen if tool.name == name)


def test_linear_problem() -> None:
    space = problems.state_space()
    exact = problems.linear_solution(space)
    # While the voltage is on, the speed tends to the gain at zero frequency.
    steady = -space.c @ np.linalg.solve(space.A, space.b)
    assert exact[problems.OFF] == pytest.approx(steady, rel=1e-3)
    assert np.all(exact[: problems.ON + 1] == 0)
    chosen = tools.linear()
    for name, bound in (("hand-written C", 1e-6), ("flexarm", 1e-6), ("scipy solve_ivp", 1e-6)):
        assert apart(named(chosen, name).run(), exact) < bound, name


def test_sliding_problem() -> None:
    exact = problems.sliding_solution()
    # Nothing moves until the torque reaches the friction.
    first = np.arcsin(problems.FRICTION / problems.TORQUE) / (2 * np.pi * problems.FREQUENCY)
    moving = np.flatnonzero(exact)[0] * problems.STEP
    assert first <= moving <= first + 2e-3
    # It rests at each turning point, over rows without number.
    resting = np.diff(exact) == 0
    assert 0.1 < resting.mean() < 0.9
    chosen = tools.sliding()
    for name, bound in (("hand-written C", 1e-7), ("flexarm", 1e-7), ("scipy solve_ivp", 1e-5)):
        assert apart(named(chosen, name).run(), exact) < bound, name


def test_two_links() -> None:
    exact = problems.links_solution()
    # They are let go at their highest, and friction takes from every swing.
    assert abs(exact[-2000:]).max() < 0.7 * abs(exact).max()
    assert abs(exact).max() == exact[0] == problems.RAISED[0]
    chosen = tools.two_links()
    for name, bound in (("hand-written C", 1e-8), ("flexarm", 1e-8), ("scipy solve_ivp", 1e-7)):
        assert apart(named(chosen, name).run(), exact) < bound, name


def test_exponent_of_a_power_law() -> None:
    assert scaling.exponent([1, 2, 4, 8], [3.0, 12.0, 48.0, 192.0]) == pytest.approx(2)


@pytest.mark.parametrize(
    ("terms", "effects", "applies", "selected", "alone"),
    [
        (["sign v0"], ["coulomb_friction"], True, True, True),
        (["sign v0", "q0^3"], ["coulomb_friction"], True, True, False),
        (["q0^3"], ["coulomb_friction"], True, False, False),
        (["sign v0", "1"], ["direction_dependent_friction"], True, True, True),
        (["sign v0"], ["backlash"], False, False, False),
        ([], [], True, True, True),
        (["1"], [], True, False, False),
        (["1", "sin 70 q0"], ["offset", "torque_ripple"], True, True, True),
    ],
)
def test_what_counts_as_selected(
    terms: list[Any] | list[str], effects: list[Any] | list[str], applies: bool, selected: bool, alone: bool
) -> None:
    told = judge(terms, effects)
    assert (told["applies"], told["selected"], told["alone"]) == (applies, selected, alone)


def test_page_of_what_was_measured(tmp_path: Path) -> None:
    row = {"how": "RK4", "repeats": 3, "error": 1e-7}
    rows = [{"tool": "flexarm", "seconds": 0.002, **row}, {"tool": "other", "seconds": 0.5, **row}]
    growth = {"what": "modes", "unit": "us", "sizes": [1, 2], "costs": [1.0, 2.0], "exponent": 1.0, "over": 1}
    found = {
        "machine": "m",
        "load": 1.0,
        "cores": 2,
        "versions": {},
        "missing": ["bdsim"],
        "linear": rows,
        "states": 5,
        "sliding": rows,
        "two_links": [{**row, "setup": 0.25} for row in rows],
        "scaling": [growth, {**growth, "exponent": None}],
    }
    (tmp_path / "peers.json").write_text(json.dumps(found))
    page = tmp_path / "pages" / "peers.md"
    assert main(["--page-only", "--data", str(tmp_path / "peers.json"), "--page", str(page)]) == 0
    text = page.read_text()
    assert "| other | RK4 | 500 ms | 250 | 1.0e-07 | - | 3 |" in text
    assert "| other | RK4 | 500 ms | 250 | 1.0e-07 | 0.25 s | 3 |" in text
    assert "Not installed, and so not measured: bdsim." in text
    assert "| modes | 1, 2 | 1, 2 us | 1.00 (from 1) |" in text
