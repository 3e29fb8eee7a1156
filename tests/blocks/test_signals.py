"""Product, switch, relay, rate limiter, quantiser, tables, schedules, transfer functions and noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from scipy.interpolate import RegularGridInterpolator

from blocks.controllers.gain import Gain
from blocks.controllers.gain_schedule import GainSchedule
from blocks.controllers.lookup import LookupTable, LookupTable2D
from blocks.controllers.product import Product
from blocks.controllers.quantiser import Quantiser
from blocks.controllers.rate_limiter import RateLimiter
from blocks.controllers.relay import Relay
from blocks.controllers.switch import Switch
from blocks.controllers.transfer_function import DiscreteTransferFunction, TransferFunction
from blocks.sources.constant import Constant
from blocks.sources.noise import Noise
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.assemble import build
from engine.block import Block
from engine.discretise import discretise
from engine.errors import ParameterError
from engine.linearise import linearise
from engine.simulate import Drive, simulate
from engine.system import Connection, System
from tests.blocks.assembly import instants, model, run

W = 7.0
SINE = Sine(amplitude=1.0, frequency=W / (2 * math.pi))


def answer(block: Block, step: float, **inputs: Any) -> Any:
    """What a block makes of linearly interpolated inputs at the rows."""
    names = [f"b.{name}" for name in inputs]
    made = build(System({"b": block}, []), inputs=names, outputs=["b.out"])
    values = np.column_stack([np.asarray(v, dtype=float) for v in inputs.values()])
    times = np.arange(len(values)) * step
    return simulate(made, float(times[-1]), step, drive=Drive(times, values, "linear"), internal_step=1e-3)["b.out"]


def test_products_and_quotients() -> None:
    t = np.linspace(0, 1, 101)
    a, b = np.sin(W * t), 2 + np.cos(3 * t)
    np.testing.assert_allclose(answer(Product(), 0.01, a=a, b=b), a * b, rtol=1e-14)
    np.testing.assert_allclose(answer(Product(operation="divide"), 0.01, a=a, b=b), a / b, rtol=1e-14)
    found = linearise(
        build(System({"b": Product(unit="W")}, []), ["b.a", "b.b"], ["b.out"]), inputs={"b.a": 3.0, "b.b": 5.0}
    )
    np.testing.assert_allclose(found.D, [[5.0, 3.0]])
    assert found.units["b.out"] == "W"


@pytest.mark.parametrize("hysteresis", [0.0, 0.4])
def test_a_switch_turns_where_its_control_crosses(hysteresis: float) -> None:
    parts: dict[str, Block] = {
        "control": SINE,
        "one": Constant(value=2.0),
        "other": Constant(value=-1.0),
        "switch": Switch(threshold=0.3, hysteresis=hysteresis),
    }
    wires = ("control.out switch.control", "one.out switch.on", "other.out switch.off")
    result = run(parts, *wires, stop=1.5, energy=False)
    on = [(math.asin(0.3) + 2 * math.pi * k) / W for k in range(2)]
    off = [(math.pi - math.asin(0.3 - hysteresis) + 2 * math.pi * k) / W for k in range(2)]
    expected = sorted(t for t in on + off if t < 1.5)
    np.testing.assert_allclose(instants(result, "switch.position"), expected, rtol=0, atol=1e-9)
    past = np.searchsorted(expected, result.time, "right")
    np.testing.assert_array_equal(result["switch.out"], np.where(past % 2 == 1, 2.0, -1.0))


def test_a_relay_with_hysteresis_swings_an_integrator_with_the_period_of_its_triangle() -> None:
    """x' = -u, u = +-U, switching at +-h: a triangle of amplitude h and period 4 h / U."""
    h, u = 0.2, 3.0
    relay = Relay(switch_on=h, switch_off=-h, upper_value=u, lower_value=-u)
    parts: dict[str, Block] = {
        "relay": relay,
        "minus": Gain(gain=-1.0),
        "plant": TransferFunction(numerator=[1], denominator=[1, 0]),
    }
    wires = ("relay.out minus.in", "minus.out plant.in", "plant.out relay.in")
    result = run(parts, *wires, stop=2.0, energy=False)
    gaps = np.diff(instants(result, "relay.contact"))
    np.testing.assert_allclose(gaps[1:], 2 * h / u, rtol=1e-9)
    assert np.abs(result["plant.out"]).max() <= h + 1e-9


def test_levels_of_a_relay_in_their_order() -> None:
    with pytest.raises(ParameterError, match=r"switch_off = 2 is above switch_on = 1"):
        Relay(switch_on=1, switch_off=2)


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_rate_limiter_follows_a_step_at_its_rates(backend: str) -> None:
    """A straight line, then the rest decays with Td from where the demanded rate falls below the limit."""
    rising, falling, lag = 4.0, 2.0, 0.05
    parts: dict[str, Block] = {
        "step": Step(height=1.0, start=0.1, stop=0.7),
        "limit": RateLimiter(rising=rising, falling=falling, time_constant=lag),
    }
    result = run(parts, "step.out limit.in", stop=1.6, energy=False, backend=backend)
    t, y = result.time, result["limit.out"]
    ends = 0.1 + (1 - rising * lag) / rising
    expected = np.where(
        t < 0.1, 0, np.where(t < ends, rising * (t - 0.1), 1 - rising * lag * np.exp(-(t - ends) / lag))
    )
    np.testing.assert_allclose(y[t <= 0.7], expected[t <= 0.7], rtol=0, atol=1e-6)
    high = expected[np.argmin(abs(t - 0.7))]
    down = 0.7 + (high - falling * lag) / falling
    later = np.where(t < down, high - falling * (t - 0.7), falling * lag * np.exp(-(t - down) / lag))
    np.testing.assert_allclose(y[t >= 0.7], later[t >= 0.7], rtol=0, atol=1e-6)
    assert len(instants(result, "limit.limit")) == 4


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_rate_limiter_reaches_a_held_input_and_stays(backend: str) -> None:
    """Between two instants y goes towards the input on a straight line, and no farther than to it."""
    rising, falling, period, parts = 3.0, 2.0, 0.01, 10
    u = np.concatenate([np.random.default_rng(1).normal(0, 0.03, 40).cumsum(), np.zeros(60)])
    made = build(
        System({"b": RateLimiter(rising=rising, falling=falling, held_input=True)}, []),
        inputs=["b.in"],
        outputs=["b.out"],
    )
    drive = Drive(np.arange(len(u)) * period, u[:, None], "zero_order")
    end = len(u) * period
    found = simulate(made, end, period / parts, drive=drive, internal_step=period / parts, backend=backend)["b.out"]
    y, expected = 0.0, [0.0]
    for value in u:
        within = np.arange(1, parts + 1) * period / parts
        expected += (y + np.clip(value - y, -falling * within, rising * within)).tolist()
        y = expected[-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert np.count_nonzero(np.abs(np.diff(expected)) < 1e-12) > 100, "it has reached the input, and stays"
    assert linearise(made).D[0, 0] == 1.0


def test_a_sampled_rate_limiter_moves_by_a_rate_times_a_period() -> None:
    t = np.arange(0, 1.0, 0.01)
    u = np.where(t < 0.5, 1.0, 0.35)
    found = answer(RateLimiter(rising=3.0, falling=1.0, period=0.01), 0.01, **{"in": u})
    y, expected = 0.0, []
    for value in u:
        y += min(max(value - y, -0.01), 0.03)
        expected.append(y)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rounding", "shift"), [("round", 0.5), ("floor", 0.0)])
def test_a_quantiser_gives_whole_steps_and_counts_as_a_gain_of_one(rounding: str, shift: float) -> None:
    u = np.sin(np.linspace(0, 5, 777)) + 0.003
    block = Quantiser(step="5 mV", rounding=rounding)
    found = answer(block, 0.01, **{"in": u})
    np.testing.assert_allclose(found, 0.005 * np.floor(u / 0.005 + shift), rtol=0, atol=1e-12)
    assert linearise(build(System({"b": block}, []), ["b.in"], ["b.out"])).D[0, 0] == 1.0


def test_a_table_lies_on_the_lines_through_its_points() -> None:
    places, heights = [-1.0, 0.2, 0.5, 3.0], [4.0, -1.0, 2.0, 2.5]
    u = np.linspace(-2, 4, 601)
    found = answer(LookupTable(breakpoints=places, heights=heights), 0.01, **{"in": u})
    np.testing.assert_allclose(found, np.interp(u, places, heights), rtol=0, atol=1e-12)
    with pytest.raises(ParameterError, match="does not come after"):
        LookupTable(breakpoints=[0, 0], heights=[1, 2])
    with pytest.raises(ParameterError, match="heights has 3 values"):
        LookupTable(breakpoints=[0, 1], heights=[1, 2, 3])


def test_a_table_of_two_signals_is_bilinear() -> None:
    rows, columns = [0.0, 1.0, 3.0], [-2.0, 0.0, 0.5, 4.0]
    values = np.random.default_rng(1).normal(size=(3, 4))
    x, y = np.random.default_rng(2).uniform(-1, 5, size=(2, 200))
    found = answer(LookupTable2D(rows=rows, columns=columns, table=values.tolist()), 0.01, x=x, y=y)
    exact = RegularGridInterpolator((rows, columns), values)(np.column_stack([np.clip(x, 0, 3), np.clip(y, -2, 4)]))
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12)
    with pytest.raises(ParameterError, match="the table is 2 by 4, but there are 3 rows"):
        LookupTable2D(rows=rows, columns=columns, table=values[:2].tolist())


def test_a_scheduled_gain() -> None:
    places, gains = [0.0, 1.0, 2.0], [1.0, 5.0, 2.0]
    block = GainSchedule(breakpoints=["0 rad", "1 rad", "2 rad"], gains=gains)
    u, p = np.random.default_rng(3).uniform(-1, 3, size=(2, 100))
    found = answer(block, 0.01, **{"in": u, "schedule": p})
    np.testing.assert_allclose(found, np.interp(p, places, gains) * u, rtol=0, atol=1e-12)
    made = build(System({"b": block}, []), ["b.in", "b.schedule"], ["b.out"])
    linear = linearise(made, inputs={"b.in": 2.0, "b.schedule": 1.5})
    np.testing.assert_allclose(linear.D, [[3.5, -3.0 * 2.0]], rtol=1e-12)


def test_a_transfer_function_has_the_response_of_its_coefficients() -> None:
    numerator, denominator = [2.0, 3.0, 5.0], [0.5, 1.0, 4.0, 7.0]
    block = TransferFunction(numerator=numerator, denominator=denominator)
    linear = linearise(build(System({"b": block}, []), ["b.in"], ["b.out"]))
    for w in (0.1, 1.0, 2.8, 30.0):
        exact = np.polyval(numerator, 1j * w) / np.polyval(denominator, 1j * w)
        assert linear.gain(w)[0, 0] == pytest.approx(exact, rel=1e-12)
    t = np.arange(0, 3, 0.01)
    u = np.sin(5 * t)
    exact = scipy.signal.lsim((numerator, denominator), u, t)[1]
    np.testing.assert_allclose(answer(block, 0.01, **{"in": u}), exact, rtol=0, atol=1e-8)
    with pytest.raises(ParameterError, match="order 2, above the denominator's 1"):
        TransferFunction(numerator=[1, 0, 0], denominator=[1, 1])


def test_a_sampled_transfer_function_is_its_difference_equation() -> None:
    numerator, denominator = [0.3, -0.1, 0.05], [2.0, -1.2, 0.5]
    block = DiscreteTransferFunction(numerator=numerator, denominator=denominator, period=0.01)
    u = np.random.default_rng(4).normal(size=80)
    found = answer(block, 0.01, **{"in": u})
    np.testing.assert_allclose(found, scipy.signal.lfilter(numerator, denominator, u), rtol=0, atol=1e-12)
    linear = discretise(build(System({"b": block}, []), ["b.in"], ["b.out"]))
    poles = [pole for pole in linear.poles() if abs(pole) > 1e-12]
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(np.roots(denominator)), rtol=1e-12)


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_noise_has_the_moments_and_the_spectrum_it_says(distribution: str) -> None:
    noise = Noise(deviation=0.3, offset=1.0, period=1e-3, distribution=distribution, seed=7)
    result = run({"n": noise}, stop=40.0, energy=False)
    values = (result["n.out"] - 1.0) / 0.3
    count = len(values)
    assert abs(values.mean()) < 4 / math.sqrt(count)
    fourth = 3.0 if distribution == "normal" else 1.8
    assert abs(values.var() - 1) < 4 * math.sqrt((fourth - 1) / count)
    assert abs((values**4).mean() - fourth) < 0.15
    for lag in (1, 2, 3, 10):
        assert abs((values[lag:] * values[:-lag]).mean()) < 4 / math.sqrt(count)
    law = scipy.stats.norm.cdf if distribution == "normal" else lambda x: np.clip(0.5 + x / math.sqrt(12), 0, 1)
    assert scipy.stats.kstest(values, law).pvalue > 1e-3


def test_noise_repeats_with_its_seed_in_every_runtime() -> None:
    runs = [
        run({"n": Noise(period=1e-3, seed=seed)}, stop=0.5, energy=False, backend=backend)["n.out"]
        for seed, backend in ((5, "c"), (5, "interpreter"), (6, "c"))
    ]
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-13)
    assert abs(np.corrcoef(runs[0], runs[2])[0, 1]) < 0.15


def test_the_generator_is_that_of_its_source() -> None:
    """The combined generator in whole numbers, from the paper's own recursion."""
    from blocks.sources.noise import first

    s1, s2 = (int(s) for s in first(3))
    expected = []
    for _ in range(200):
        drawn = []
        for _ in range(2):
            s1, s2 = 40014 * s1 % 2147483563, 40692 * s2 % 2147483399
            z = s1 - s2
            drawn.append((z + 2147483562 if z < 1 else z) / 2147483563)
        expected.append(math.sqrt(12) * (drawn[0] - 0.5))
    found = run({"n": Noise(period=1e-3, distribution="uniform", seed=3)}, stop=0.199, energy=False)["n.out"]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_noise_is_constant_in_linear_models() -> None:
    made = model({"n": Noise(period=1e-3), "g": Gain(gain=2.0)}, "n.out g.in", energy=False)
    np.testing.assert_allclose(discretise(made).poles(), 0.0, atol=1e-6)


def test_connections_carry_units() -> None:
    """Every new block can stand in a system of its own, connected through, with its unit."""
    parts: dict[str, Block] = {
        "s": SINE,
        "q": Quantiser(step="1 mrad"),
        "t": LookupTable(breakpoints=[0, 1], heights=["1 V", "2 V"]),
    }
    made = build(System(parts, [Connection(("s.out", "q.in")), Connection(("q.out", "t.in"))]))
    assert {v.name: v.unit for v in made.outputs}["t.out"] == "V"
