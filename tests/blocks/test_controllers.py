"""Signal blocks against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.controllers.dead_zone import DeadZone
from blocks.controllers.gain import Gain
from blocks.controllers.low_pass import LowPass
from blocks.controllers.pi import PI
from blocks.controllers.pid import PID
from blocks.controllers.saturation import Saturation
from blocks.controllers.sum import Sum
from blocks.controllers.switch import Switch
from blocks.sources.constant import Constant
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ConnectionProblem
from engine.simulate import Drive, Result
from tests.blocks.assembly import instants, linear, model, run, switches


def through(block: Block, values: Any, hold: str = "linear", step: float = 0.01) -> Result:
    """What comes through a block that is fed the values at the rows of time."""
    drive = Drive(step * np.arange(len(values)), np.asarray(values, dtype=float), hold)
    stop = step * (len(values) - 1)
    return run({"block": block}, inputs=["block.in"], drive=drive, stop=stop, step=step, energy=False)


SWEEP = 1.3 * np.concatenate([np.linspace(0, 1, 137), np.linspace(1, -1, 300), np.linspace(-1, 0.5, 211)])
JUMPS = np.random.default_rng(3).uniform(-1.0, 1.0, 400)


@pytest.mark.parametrize(("values", "hold"), [(SWEEP, "linear"), (JUMPS, "zero_order"), (JUMPS, "linear")])
@pytest.mark.parametrize(("lower", "upper"), [(-0.09, 0.18), (0.0, 0.0), (-0.5, 0.0)])
def test_dead_zone_is_its_static_map(values: Any, hold: str, lower: float, upper: float) -> None:
    result = through(DeadZone(lower=lower, upper=upper), values, hold)
    expected = np.where(values > upper, values - upper, np.where(values < lower, values - lower, 0.0))
    np.testing.assert_allclose(result["block.out"], expected, rtol=0, atol=1e-12)


def test_dead_zone_kinks_are_located() -> None:
    result = through(DeadZone(lower=-0.09, upper=0.18), [0.0, 1.0, -1.0], step=1.0)
    assert switches(result, "block.zone") == [1, 0, -1]
    np.testing.assert_allclose(instants(result, "block.zone"), [0.18, 1.41, 1.545], rtol=0, atol=1e-11)


def test_dead_zone_sine_switches_four_times_a_period() -> None:
    parts: dict[str, Block] = {"source": Sine(amplitude=1, frequency=2), "zone": DeadZone(lower=-0.3, upper=0.3)}
    result = run(parts, "source.out zone.in", stop=0.99, energy=False)
    assert switches(result, "zone.zone") == [1, 0, -1, 0] * 2
    first = np.arcsin(0.3) / (4 * np.pi)
    np.testing.assert_allclose(instants(result, "zone.zone")[:2], [first, 0.25 - first], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("values", "hold"), [(SWEEP, "linear"), (JUMPS, "zero_order"), (JUMPS, "linear")])
def test_saturation_is_its_static_map(values: Any, hold: str) -> None:
    result = through(Saturation(lower=-0.4, upper=0.7), values, hold)
    np.testing.assert_allclose(result["block.out"], np.clip(values, -0.4, 0.7), rtol=0, atol=1e-12)


def test_gain_and_sum() -> None:
    parts: dict[str, Block] = {
        "speed": Constant(value="3 rad/s"),
        "volt": Constant(value="2 V"),
        "gain": Gain(gain="0.5 V.s/rad", unit="V"),
        **{f"sum{i}": Sum(signs=signs) for i, signs in enumerate(("++", "+-", "-+", "--"))},
    }
    wires = ["speed.out gain.in", "gain.out sum0.a sum1.a sum2.a sum3.a", "volt.out sum0.b sum1.b sum2.b sum3.b"]
    result = run(parts, *wires, stop=0.01, energy=False)
    assert [result[f"sum{i}.out"][-1] for i in range(4)] == [3.5, -0.5, 0.5, -3.5]
    assert result.units["sum0.out"] == "V"


def test_a_gain_without_unit_keeps_that_of_its_input() -> None:
    parts: dict[str, Block] = {
        "speed": Constant(value="3 rad/s"),
        "gain": Gain(gain=2),
        "zone": DeadZone(lower=0, upper=0),
    }
    assert run(parts, "speed.out gain.in", "gain.out zone.in", stop=0.01).units["zone.out"] == "rad/s"


def test_low_pass_continuous() -> None:
    w, start = 2 * np.pi * 10, 0.2
    parts: dict[str, Block] = {"source": Step(height=1.0), "filter": LowPass(corner_frequency="10 Hz", start=start)}
    result = run(parts, "source.out filter.in", stop=0.2, energy=False, internal_step=2e-4)
    np.testing.assert_allclose(result["filter.out"], 1 - (1 - start) * np.exp(-w * result.time), rtol=0, atol=1e-9)


def test_low_pass_corner() -> None:
    found = linear({"filter": LowPass(corner_frequency=10)}, inputs=["filter.in"], outputs=["filter.out"])
    response = complex(found.gain(10.0)[0, 0])
    assert 20 * np.log10(abs(response)) == pytest.approx(-3.0103, abs=1e-4)
    assert np.degrees(np.angle(response)) == pytest.approx(-45, abs=1e-9)
    np.testing.assert_allclose(found.poles(), [-10], rtol=1e-12)


def test_low_pass_sampled_follows_a_held_input_exactly() -> None:
    w, period = 20.0, 0.01
    values = np.random.default_rng(5).normal(size=60)
    result = through(LowPass(corner_frequency=w, period=period), values, "zero_order")
    y, expected = 0.0, []
    for u in values:
        y = u + (y - u) * np.exp(-w * period)
        expected.append(y)
    np.testing.assert_allclose(result["block.out"], expected, rtol=0, atol=1e-13)


def test_low_pass_sampled_holds_between_instants() -> None:
    parts: dict[str, Block] = {
        "source": Constant(value=1),
        "filter": LowPass(corner_frequency=5, period=0.1, sample_offset=0.05),
    }
    result = run(parts, "source.out filter.in", stop=0.5, step=0.01, energy=False)
    samples = np.floor((np.arange(51) + 5) / 10)
    np.testing.assert_allclose(result["filter.out"], 1 - np.exp(-0.5 * samples), rtol=0, atol=1e-13)


def test_pi_continuous_and_sampled() -> None:
    kp, ki, error, period = 0.5, 3.0, 1.0 - 0.25, 0.02
    parts: dict[str, Block] = {
        "reference": Constant(value=1),
        "measurement": Constant(value=0.25),
        "smooth": PI(proportional_gain=kp, integral_gain=ki, start=0.1),
        "sampled": PI(proportional_gain=kp, integral_gain=ki, start=0.1, period=period),
    }
    wires = [
        "reference.out smooth.reference sampled.reference",
        "measurement.out smooth.measurement sampled.measurement",
    ]
    result = run(parts, *wires, stop=1.0, step=0.01, energy=False)
    t = result.time
    np.testing.assert_allclose(result["smooth.out"], kp * error + ki * (0.1 + error * t), rtol=0, atol=1e-12)
    taken = np.arange(101) // 2
    expected = kp * error + ki * (0.1 + error * period * taken)
    np.testing.assert_allclose(result["sampled.out"], expected, rtol=0, atol=1e-12)
    assert result.units["smooth.out"] == "V"


def test_chain_of_sampled_blocks_has_no_delay() -> None:
    parts: dict[str, Block] = {
        "filter": LowPass(corner_frequency=30, period=0.01),
        "zero": Constant(value=0),
        "pi": PI(proportional_gain=2, period=0.01),
    }
    values = np.random.default_rng(6).normal(size=40)
    drive = Drive(0.01 * np.arange(40), values)
    wires = ["filter.out pi.reference", "zero.out pi.measurement"]
    result = run(parts, *wires, inputs=["filter.in"], drive=drive, stop=0.39, step=0.01, energy=False)
    np.testing.assert_array_equal(result["pi.out"], 2 * result["filter.out"])


def test_signals_of_one_block_must_be_connected() -> None:
    with pytest.raises(ConnectionProblem, match=r"'pi.measurement' is not connected"):
        model({"pi": PI(proportional_gain=1), "one": Constant(value=1)}, "one.out pi.reference")


@pytest.mark.parametrize(
    ("block", "first", "second"),
    [
        (PI(proportional_gain=1.0, integral_gain=1.0), "reference", "measurement"),
        (PID(proportional_gain=1.0), "reference", "measurement"),
        (Sum(signs="+-"), "a", "b"),
        (Switch(), "on", "off"),
    ],
)
def test_signals_that_are_compared_have_one_unit(block: Block, first: str, second: str) -> None:
    """A speed in rad/s against a reference in m/s gave a loop that was wrong by a radius."""
    blocks = {"s": Constant(value="1 m/s"), "w": Constant(value="1 rad/s"), "x": block}
    further = ("s.out x.control",) if isinstance(block, Switch) else ()
    with pytest.raises(ConnectionProblem, match=f"'x.{second}' is fed in rad/s, but 'x.{first}'.* in m/s"):
        model(blocks, f"s.out x.{first}", f"w.out x.{second}", *further)
    model(blocks, f"s.out x.{first}", f"s.out x.{second}", *further)


def test_a_switch_has_the_unit_of_what_it_passes() -> None:
    blocks = {"s": Constant(value="1 m/s"), "w": Constant(value="1 rad/s"), "x": Switch()}
    made = run(blocks, "s.out x.on x.off", "w.out x.control", stop=0.1)
    assert made.units["x.out"] == "m/s"
