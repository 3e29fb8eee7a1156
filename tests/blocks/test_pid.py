"""The PID controller: transfer function, derivative, limits and anti-windup, continuous and sampled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import integrate

from blocks.controllers.pid import PID
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ParameterError
from engine.simulate import Drive, Result
from tests.blocks.assembly import instants, linear, model, run

GAINS = {"proportional_gain": 2.0, "integral_gain": 5.0, "derivative_gain": 0.3, "derivative_corner": 40.0}


def test_transfer_functions() -> None:
    parts: dict[str, Block] = {"pid": PID(**GAINS)}
    found = linear(parts, inputs=["pid.reference", "pid.measurement"], outputs=["pid.out"])
    for w in (0.1, 3.0, 40.0, 500.0):
        s = 1j * w
        expected = 2 + 5 / s + 0.3 * 40 * s / (s + 40)
        gain = found.gain(w)[0]
        assert gain[0] == pytest.approx(expected, rel=1e-12)
        assert gain[1] == pytest.approx(-expected, rel=1e-12)
    inputs = ["pid.reference", "pid.measurement"]
    on = linear({"pid": PID(**GAINS, derivative_on="measurement")}, inputs=inputs, outputs=["pid.out"])
    assert on.gain(7.0)[0, 0] == pytest.approx(2 + 5 / 7j, rel=1e-12)
    assert on.gain(7.0)[0, 1] == pytest.approx(-(2 + 5 / 7j + 0.3 * 40 * 7j / (7j + 40)), rel=1e-12)


def driven(block: PID, error: Any, step: float = 0.01, measurement: Any = 0.0) -> Result:
    """Reference and measurement as given at every row."""
    error = np.asarray(error, dtype=float)
    values = np.column_stack([error, np.broadcast_to(measurement, error.shape)])
    drive = Drive(step * np.arange(len(error)), values, "zero_order")
    inputs = ["pid.reference", "pid.measurement"]
    return run({"pid": block}, inputs=inputs, drive=drive, stop=step * (len(error) - 1), step=step, energy=False)


@pytest.mark.parametrize("anti_windup", ["back_calculation", "clamping", "none"])
def test_sampled_is_its_recursion(anti_windup: str) -> None:
    """The law of the docstring in a loop of Python, through both limits."""
    period, lower, upper, tracking = 0.01, -1.5, 2.0, 0.05
    limits = {"lower": lower, "upper": upper, "anti_windup": anti_windup, "tracking_time": tracking}
    reference = np.cos(np.arange(300) / 20) + np.random.default_rng(7).normal(size=300) / 30
    block = PID(**GAINS, **limits, period=period, start=0.1)
    result = driven(block, reference, period)
    x, f, out, wanted = 0.1, 0.0, [], []
    for e in reference:
        after = f + (1 - np.exp(-40 * period)) * (e - f)
        v = 2 * e + 5 * x + 0.3 * (after - f) / period
        f = after
        u = min(max(v, lower), upper)
        out.append(u)
        wanted.append(v)
        rate = e
        if anti_windup == "back_calculation":
            rate = e + (u - v) / (5 * tracking)
        elif anti_windup == "clamping" and ((v > upper and e > 0) or (v < lower and e < 0)):
            rate = 0.0
        x += period * rate
    np.testing.assert_allclose(result["pid.out"], out, atol=1e-12)
    np.testing.assert_allclose(result["pid.unlimited"], wanted, atol=1e-11)
    assert (np.array(out) == upper).any()
    assert (np.array(out) == lower).any()


def test_a_fast_sampled_derivative_is_the_difference() -> None:
    reference = np.random.default_rng(8).normal(size=50)
    result = driven(PID(proportional_gain=0, derivative_gain=1, derivative_corner=1e9, period=0.01), reference)
    np.testing.assert_allclose(result["pid.out"], np.diff(reference, prepend=0) / 0.01, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("anti_windup", ["back_calculation", "clamping", "none"])
def test_continuous_against_an_event_driven_solution(anti_windup: str) -> None:
    """A sine that drives the output far beyond both limits, integrated by scipy in pieces between the switches."""
    kp, ki, lower, upper, tracking, w = 1.0, 4.0, -0.8, 0.5, 0.1, 2 * np.pi
    block = PID(proportional_gain=kp, integral_gain=ki, lower=lower, upper=upper, tracking_time=tracking,
                anti_windup=anti_windup)  # fmt: skip
    parts: dict[str, Block] = {"source": Sine(amplitude=1, frequency=1), "zero": Constant(value=0), "pid": block}
    wires = ["source.out pid.reference", "zero.out pid.measurement"]
    result = run(parts, *wires, stop=3.0, step=0.002, energy=False)

    def rate(t: float, x: np.ndarray) -> list[float]:
        e = np.sin(w * t)
        v = kp * e + ki * x[0]
        u = min(max(v, lower), upper)
        if anti_windup == "clamping" and ((v > upper and e > 0) or (v < lower and e < 0)):
            return [0.0]
        return [e + ((u - v) / (ki * tracking) if anti_windup == "back_calculation" else 0.0)]

    found = integrate.solve_ivp(
        rate, (0, 3.0), [0.0], method="DOP853", t_eval=result.time, rtol=1e-10, atol=1e-12, max_step=5e-4
    )
    v = kp * np.sin(w * result.time) + ki * found.y[0]
    np.testing.assert_allclose(result["pid.unlimited"], v, atol=2e-6)
    np.testing.assert_allclose(result["pid.out"], np.clip(v, lower, upper), atol=2e-6)


def test_anti_windup_lets_go_at_once() -> None:
    """A constant error of 1 for 1 s, then its reverse: without protection the output stays at the limit for long."""

    def time_at_limit(anti_windup: str) -> float:
        block = PID(proportional_gain=1.0, integral_gain=10.0, upper=2.0, lower=-2.0, anti_windup=anti_windup,
                    tracking_time=0.02)  # fmt: skip
        parts: dict[str, Block] = {"source": Step(height=2, stop=1.0, offset=-1), "zero": Constant(value=0), "p": block}
        result = run(parts, "source.out p.reference", "zero.out p.measurement", stop=3.0, step=0.001, energy=False)
        return float((result["p.out"] >= 2.0)[result.time > 1.0].sum() * 0.001)

    # Without protection the integral passes 1 and must come back to 0.3: 0.7 s.
    assert time_at_limit("none") == pytest.approx(0.7, abs=2e-3)
    assert time_at_limit("clamping") == 0
    assert time_at_limit("back_calculation") == 0


def test_limits_are_located() -> None:
    block = PID(proportional_gain=1.0, lower=-0.3, upper=0.5)
    parts: dict[str, Block] = {"source": Sine(amplitude=1, frequency=1), "zero": Constant(value=0), "pid": block}
    result = run(parts, "source.out pid.reference", "zero.out pid.measurement", stop=0.9, step=0.1, energy=False)
    up, down = np.arcsin(0.5) / (2 * np.pi), np.arcsin(0.3) / (2 * np.pi)
    expected = [up, 0.5 - up, 0.5 + down, 1 - down]
    np.testing.assert_allclose(instants(result, "pid.limit"), [t for t in expected if t < 0.9], atol=1e-11)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"proportional_gain": 1, "lower": 2, "upper": 1}, "lower = 2 is not below upper = 1"),
        (
            {"proportional_gain": "1 V.s/rad", "derivative_gain": "1 V.s/rad"},
            "proportional_gain is in V.s/rad but derivative_gain in V.s/rad",
        ),
        ({"proportional_gain": 1, "integral_gain": -1}, "integral_gain must be >= 0"),
        ({"proportional_gain": 1, "anti_windup": "clamp"}, "'clamp' is not a choice.*\n.*'clamping'"),
    ],
)
def test_refusals(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        PID(**values)


@pytest.mark.parametrize("period", [0.0, 0.01])
def test_without_an_integral_gain_there_is_no_integral(period: float) -> None:
    """Its pole at 0 (1 in the z-plane), unseen by the loop, had every such loop called unstable."""
    made = model(
        {"pid": PID(proportional_gain=2.0, derivative_gain=0.3, period=period)},
        inputs=["pid.reference", "pid.measurement"],
        outputs=["pid.out"],
        energy=False,
    )
    names = [*(state.name for state in made.states), *(memory.name for memory in made.memories)]
    assert "pid.filtered" in names
    assert "pid.integral" not in names
    assert "pid.integral_gain" not in {p.name for p in made.parameters}
