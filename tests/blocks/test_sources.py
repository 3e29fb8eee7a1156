"""Sources: their values, and that the integration meets their edges exactly."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate

from blocks.actuators.effort import Torque
from blocks.links.inertia import Inertia
from blocks.sources.constant import Constant
from blocks.sources.pulse import Pulse
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from blocks.sources.table import Table
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Result
from tests.blocks.assembly import run

J = 0.5


def push(source: Block, stop: float = 2.0, step: float = 0.05) -> Result:
    """The source as a torque on an inertia J: its speed is the integral of the signal over J."""
    parts = {"source": source, "torque": Torque(), "body": Inertia(inertia=J)}
    return run(parts, "source.out torque.torque", "torque.shaft body.shaft", stop=stop, step=step)


def test_constant() -> None:
    result = push(Constant(value="0.2 N.m"))
    assert result.units["source.out"] == "N.m"
    np.testing.assert_allclose(result["body.shaft.speed"], 0.2 / J * result.time, rtol=1e-12)


def test_step_edges_are_exact() -> None:
    start, stop, height, offset = 0.1234567, 0.9876543, 3.0, -0.5
    result = push(Step(height=height, start=start, stop=stop, offset=offset))
    t = result.time
    on = (t >= start) & (t < stop)
    np.testing.assert_array_equal(result["source.out"], np.where(on, height, 0.0) + offset)
    speed = (height * np.clip(t - start, 0, stop - start) + offset * t) / J
    angle = (height * (np.clip(t - start, 0, None) ** 2 - np.clip(t - stop, 0, None) ** 2) + offset * t**2) / (2 * J)
    np.testing.assert_allclose(result["body.shaft.speed"], speed, rtol=0, atol=1e-12)
    np.testing.assert_allclose(result["body.shaft.angle"], angle, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "stop", "expected"),
    [(0.0, 1e9, 2.0), (-1.0, 1e9, 2.0), (0.0, 1.0, 1.0), (-2.0, -1.0, 0.0), (-1.0, 0.0, 0.0)],
)
def test_step_that_began_before(start: float, stop: float, expected: float) -> None:
    result = push(Step(height=1, start=start, stop=stop))
    assert result["body.shaft.speed"][-1] == pytest.approx(expected / J, abs=1e-12)
    assert result["source.out"][0] == (1.0 if start <= 0 < stop else 0.0)


@pytest.mark.parametrize("start", [0.3, 0.0, -0.05, -0.11, -0.4, -5.0])
@pytest.mark.parametrize("count", [1, 3, 0])
def test_pulses(start: float, count: int) -> None:
    width, period, height = 0.0777, 0.2131, 2.0
    result = push(Pulse(height=height, start=start, width=width, period=period, count=count))

    def area(t: float) -> float:
        begun = start + period * np.arange(60)[: count or None]
        before = np.clip(0 - begun, 0, width)
        return float(np.sum(np.clip(t - begun, 0, width) - before))

    expected = [height * area(t) / J for t in result.time]
    np.testing.assert_allclose(result["body.shaft.speed"], expected, rtol=0, atol=1e-12)


def test_sine() -> None:
    amplitude, frequency, phase, start, offset = 0.7, 1.3, 0.4, 0.3333, 0.2
    result = push(Sine(amplitude=amplitude, frequency=frequency, phase=phase, start=start, offset=offset), step=1e-3)
    w, tau = 2 * np.pi * frequency, np.clip(result.time - start, 0, None)
    speed = (amplitude / w * (np.cos(phase) - np.cos(w * tau + phase)) + offset * result.time) / J
    np.testing.assert_allclose(result["body.shaft.speed"], speed, rtol=0, atol=1e-10)
    assert result["source.out"][100] == offset


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(1.0, 130.0, 30))
    rows = [f"{float(t)!r},{rng.normal()!r},x" for t in time]
    file = tmp_path / "recording.csv"
    file.write_text("\n".join(["# made for this test", "ms, torque,remark", *rows]) + "\n", encoding="utf-8")
    return file


@pytest.mark.parametrize("hold", ["zero_order", "linear"])
def test_table(recording: Path, hold: str) -> None:
    result = push(
        Table(file=str(recording), column="torque", time="ms", time_unit="1 ms", hold=hold, scale="1 mN.m"), stop=2.5
    )
    data = np.genfromtxt(recording, delimiter=",", skip_header=2)
    t, v = data[:, 0] / 1e3, data[:, 1] / 1e3

    def signal(x: float) -> float:
        return (
            float(np.interp(x, t, v)) if hold == "linear" else float(v[max(int(np.searchsorted(t, x, "right")) - 1, 0)])
        )

    assert result.units["source.out"] == "N.m"
    points = [p for p in t if 0 < p < 2.5]
    edges = [0.0, *points, 2.5]
    area = sum(integrate.quad(signal, a, b)[0] for a, b in pairwise(edges))
    assert result["body.shaft.speed"][-1] == pytest.approx(area / J, abs=1e-11)
    np.testing.assert_allclose(result["source.out"], [signal(x) for x in result.time], atol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time,u\n0,1\n1,2\n", "has no column 'torque'\n  allowed: time, u"),
        ("time,torqe\n0,1\n", "has no column 'torque'\n  did you mean 'torqe'"),
        ("t,torque\n0,1\n", "has no column 'time'"),
        ("time,torque,torque\n0,1,2\n", "two columns are called 'torque'"),
        ("time,torque\n0,1\n0.5,2\n0.5,3\n", r"line 4: time 0.5 does not come after 0.5"),
        ("time,torque\n0,1\n0.5,2\n0.2,3\n", r"line 4: time 0.2 does not come after 0.5"),
        ("time,torque\n0,1\n0.5,nan\n", r"line 3: column 'torque' is not a finite number"),
        ("time,torque\n0,1\n0.5\n", r"line 3: 1 value where the header names 2 columns"),
        ("time,torque\n0,1\n0.5,1 V\n", r"line 3: column 'torque' holds a number with a text behind it"),
        ("time,torque\n", "empty but for its header"),
        ("", "is empty"),
    ],
)
def test_table_refuses(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(ParameterError, match=message):
        Table(file=str(file), column="torque")


def test_table_refuses_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"none.csv': cannot read the file: No such file"):
        Table(file=str(tmp_path / "none.csv"), column="u")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ParameterError, match="not UTF-8"):
        Table(file=str(tmp_path / "binary.csv"), column="u")
