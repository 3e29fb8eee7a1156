"""A foreign bouncing ball: alone, under our controller, with our controller as the FMU, and a drive of ours behind it.

The ball is C of its own (``ball.c``). That of the Reference FMUs is used too where FLEXARM_REFERENCE_FMUS names a
folder that holds it.
"""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fmu
from blocks.registry import registry
from engine.simulate import simulate
from fmu.block import FMU
from fmu.host import host
from scenarios.load import load
from tests.fmu.makers import foreign_binary, foreign_fmu

linux = pytest.mark.skipif(sys.platform != "linux", reason="the binary is one of linux64")
GRAVITY, RESTITUTION, PERIOD = 9.81, 0.7, 5e-3
VARIABLES = [
    ("thrust", "input", 0.0),
    ("h", "output", None),
    ("v", "output", None),
    ("bounces", "output", None),
    ("g", "parameter", GRAVITY),
    ("e", "parameter", RESTITUTION),
    ("drop", "parameter", 1.0),
]
CONTROLLER = """pid:
    type: PID
    proportional_gain: 30
    integral_gain: 40
    derivative_gain: 9
    derivative_corner: 400 rad/s
    lower: 0
    upper: 11
    unit: m/s2
    period: 5 ms"""


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    if "FMU" not in registry():
        monkeypatch.setitem(registry(), "FMU", FMU)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    return foreign_fmu(tmp_path / "ball.fmu", foreign_binary("ball.c"), VARIABLES)


def _run(folder: Path, text: str, stop: float) -> dict[str, np.ndarray]:
    file = folder / "scenario.yaml"
    file.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        model = load(file).build()
    found = simulate(model, stop, 1e-3)
    return {name: found[name] for name in found.names} | {"time": found.time}


def _height(t: np.ndarray, drop: float = 1.0) -> np.ndarray:
    """Of a ball dropped at t = 0: flights of sqrt(8 drop / g) e^k after a first fall of half of that."""
    whole, begin = np.sqrt(8 * drop / GRAVITY), np.sqrt(2 * drop / GRAVITY)
    found = np.where(t <= begin, drop - GRAVITY * t**2 / 2, 0.0)
    for k in range(1, 60):
        flight = whole * RESTITUTION**k
        s = t - begin
        found = np.where((s > 0) & (s < flight), GRAVITY / 2 * s * (flight - s), found)
        begin += flight
    return found


@linux
def test_it_bounces_as_the_closed_form_says(ball: Path, tmp_path: Path) -> None:
    rows = _run(
        tmp_path,
        f"""schema: 1
name: free
blocks:
  ball: {{type: FMU, file: {ball.name}, period: 5 ms}}
  hub: {{type: LowPass, corner_frequency: 1000 rad/s}}
connect:
  - [ball.h, hub.in]
simulate: {{stop: 3 s, step: 1 ms, record: [ball.h, ball.bounces, hub.out]}}
""",
        3.0,
    )
    at = rows["time"][2::5]
    instants = np.floor(at / PERIOD + 1e-9) * PERIOD
    assert np.abs(rows["ball.h"][2::5] - _height(instants)).max() < 1e-9
    assert rows["ball.bounces"][-1] > 15


def _held(sent: list[float]) -> np.ndarray:
    """Height at the instants, by solve_ivp with the ground as an event, for thrusts held over a period each."""
    y, found = np.array([1.0, 0.0]), [1.0]

    def ground(t: float, y: np.ndarray) -> float:
        return float(y[0])

    ground.terminal, ground.direction = True, -1  # type: ignore[attr-defined]
    for thrust in sent:
        left = PERIOD
        while left > 0:
            run = solve_ivp(
                lambda t, y, a=thrust - GRAVITY: [y[1], a], (0, left), y, events=ground, rtol=1e-12, atol=1e-14
            )
            y, left = run.y[:, -1], left - run.t[-1]
            if run.t_events[0].size:
                y = np.array([0.0, -RESTITUTION * y[1]])
        found.append(float(y[0]))
    return np.array(found)


def _controlled(ball: Path) -> str:
    return f"""schema: 1
name: hovering
blocks:
  wanted: {{type: Step, height: 0.5}}
  {CONTROLLER}
  late: {{type: Delay, delay: 5 ms, period: 5 ms}}
  ball: {{type: FMU, file: {ball.name}, period: 5 ms}}
connect:
  - [wanted.out, pid.reference]
  - [ball.h, pid.measurement]
  - [pid.out, late.in]
  - [late.out, ball.thrust]
simulate: {{stop: 5 s, step: 1 ms, record: [ball.h, ball.bounces, pid.out, ball.thrust]}}
"""


@linux
def test_our_controller_catches_the_ball(ball: Path, tmp_path: Path) -> None:
    """It falls, bounces while the thrust cannot hold it, and then hovers; between, it flies as solve_ivp says."""
    rows = _run(tmp_path, _controlled(ball), 5.0)
    sent = rows["ball.thrust"][2:1000:5].tolist()
    assert np.abs(rows["ball.h"][2:1005:5] - _held(sent)).max() < 1e-8
    assert rows["ball.bounces"][-1] >= 1
    assert abs(rows["ball.h"][-1] - 0.5) < 1e-3
    assert rows["ball.thrust"][-1] == pytest.approx(GRAVITY, rel=1e-2)


@linux
@pytest.mark.parametrize("version", [2, 3])
def test_our_controller_as_an_fmu_catches_it_in_a_master(version: int, ball: Path, tmp_path: Path) -> None:
    """The reverse: both are FMUs to a master of twenty lines; the rows are those of the scenario."""
    expected = _run(tmp_path, _controlled(ball), 5.0)
    file = tmp_path / "controller.yaml"
    file.write_text(f"schema: 1\nname: controller\nblocks:\n  {CONTROLLER}\n", encoding="utf-8")
    model = load(file).build(inputs=["pid.reference", "pid.measurement"], outputs=["pid.out"])
    path = fmu.export(model, tmp_path / "controller.fmu", platforms=["linux64"], version=version, step=PERIOD)
    rows, sent = [], 0.0
    with ExitStack() as stack:
        plant, control = (stack.enter_context(host(file, file.stem)) for file in (ball, path))
        with plant.starting(0.0), control.starting(0.0):
            control.set(["pid_reference"], [0.5])
        for k in range(1000):
            height = plant.get(["h"])[0]
            control.set(["pid_measurement"], [height])
            command = control.get(["pid_out"])[0]
            rows.append((height, command))
            plant.set(["thrust"], [sent])
            for part in (plant, control):
                part.step(k * PERIOD, PERIOD)
            sent = command
    given = np.array(rows)
    own = np.column_stack([expected["ball.h"], expected["pid.out"]])[2::5][:1000]
    assert np.abs(given - own).max() < 1e-9


def test_the_reference_ball_leads_our_drive(tmp_path: Path) -> None:
    """A slide of ours follows the height of the Reference FMUs' BouncingBall, which itself follows the closed form."""
    folder = os.environ.get("FLEXARM_REFERENCE_FMUS")
    if not folder or not (Path(folder) / "BouncingBall.fmu").is_file():
        pytest.skip("FLEXARM_REFERENCE_FMUS names no folder with BouncingBall.fmu")
    rows: dict[str, Any] = _run(
        tmp_path,
        f"""schema: 1
name: following
blocks:
  ball: {{type: FMU, file: {Path(folder) / "BouncingBall.fmu"}, period: 10 ms}}
  control: {{type: PID, proportional_gain: 900, derivative_gain: 60, derivative_corner: 500 rad/s, unit: N}}
  push: {{type: Force}}
  slide: {{type: Mass, mass: 1}}
connect:
  - [ball.h, control.reference]
  - [slide.flange.position, control.measurement]
  - [control.out, push.force]
  - [push.flange, slide.flange]
initial: {{slide.flange.position: 1}}
simulate: {{stop: 1.5 s, step: 1 ms, record: [ball.h, slide.flange.position]}}
""",
        1.5,
    )
    at = rows["time"][5::10]
    assert np.abs(rows["ball.h"][5::10] - _height(np.floor(at * 100 + 1e-9) / 100)).max() < 0.02
    assert np.abs(rows["slide.flange.position"] - rows["ball.h"]).max() < 0.2
    assert np.corrcoef(rows["slide.flange.position"], rows["ball.h"])[0, 1] > 0.95
