"""Notch, delay, sample and hold, input shapers and signal sensors against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy import signal

from blocks.controllers.delay import Delay
from blocks.controllers.input_shaper import InputShaper
from blocks.controllers.low_pass import LowPass
from blocks.controllers.notch import Notch
from blocks.controllers.sample_hold import SampleHold
from blocks.controllers.second_order import held_response
from blocks.controllers.state_space import StateSpace
from blocks.sensors.lag import SensorLag
from blocks.sensors.rectified import RectifiedSensor
from blocks.sensors.scaled import ScaledSensor
from blocks.sources.sine import Sine
from blocks.sources.step import Step
from engine.block import Block
from engine.errors import ParameterError, StructureError
from engine.simulate import Drive, Result
from tests.blocks.assembly import instants, linear, model, run


def through(block: Block, values: Any, step: float = 0.01) -> Result:
    drive = Drive(step * np.arange(len(values)), np.asarray(values, dtype=float), "zero_order")
    return run(
        {"block": block}, inputs=["block.in"], drive=drive, stop=step * (len(values) - 1), step=step, energy=False
    )


# -- notch ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [0.0, 0.05])
def test_notch_response(depth: float) -> None:
    """[Gao J. n.d., sec. 3.5.2]: 68 rad/s."""
    w, d = 68.0, 0.6
    found = linear({"n": Notch(frequency=w, damping_ratio=d, depth_ratio=depth)}, inputs=["n.in"], outputs=["n.out"])
    for frequency in (1e-3, 10.0, 67.0, 68.0, 300.0, 1e6):
        s = 1j * frequency
        expected = (s**2 + 2 * depth * w * s + w**2) / (s**2 + 2 * d * w * s + w**2)
        assert found.gain(frequency)[0, 0] == pytest.approx(expected, abs=1e-9)
    assert abs(found.gain(w)[0, 0]) == pytest.approx(depth / d, abs=1e-12)


def test_notch_band() -> None:
    """Gain -3 dB at a distance of 2 d w between its ends."""
    w, d = 50.0, 0.3
    found = linear({"n": Notch(frequency=w, damping_ratio=d)}, inputs=["n.in"], outputs=["n.out"])
    ends = [w * (np.sqrt(1 + d**2) + sign * d) for sign in (-1, 1)]
    assert ends[1] - ends[0] == pytest.approx(2 * d * w)
    for end in ends:
        assert abs(found.gain(end)[0, 0]) == pytest.approx(np.sqrt(0.5), rel=1e-9)


@pytest.mark.parametrize("d", [0.1, 0.7, 1.0, 1.0 + 1e-9, 2.5])
def test_notch_sampled_is_exact_for_a_held_input(d: float) -> None:
    """Against scipy's exact discretisation of the same transfer function."""
    w, z, period = 30.0, 0.02, 0.01
    values = np.random.default_rng(2).normal(size=80)
    result = through(Notch(frequency=w, damping_ratio=d, depth_ratio=z, period=period), values, period)
    made = signal.cont2discrete(([1, 2 * z * w, w**2], [1, 2 * d * w, w**2]), period, method="zoh")
    expected = signal.lfilter(made[0].ravel(), made[1], values)
    np.testing.assert_allclose(result["block.out"], expected, atol=1e-9)


@pytest.mark.parametrize("d", [0.0, 0.3, 1.0 - 1e-14, 1.0, 1.2, 30.0])
def test_held_response_is_the_matrix_exponential(d: float) -> None:
    w, period = 7.0, 0.13
    import casadi as ca

    rows = np.array([[float(ca.evalf(ca.SX(x))) for x in row] for row in held_response(w, d, period)])
    A = np.array([[0, 1, 0], [-(w**2), -2 * d * w, 1], [0, 0, 0]])
    expected = scipy.linalg.expm(A * period)
    np.testing.assert_allclose(rows[:2], expected[:2, :2], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows[2], expected[:2, 2], rtol=1e-9, atol=1e-12)


# -- delay, sample and hold -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 2, 17])
def test_delay_is_late_by_so_many_samples(count: int) -> None:
    values = np.random.default_rng(4).normal(size=60)
    result = through(Delay(delay=0.01 * count, period=0.01, start=0.7), values)
    expected = np.concatenate([np.full(count, 0.7), values])[: len(values)]
    np.testing.assert_array_equal(result["block.out"], expected)


def test_delay_on_its_own_clock() -> None:
    """A sine read every 0.03 s from 0.01 s on, late by 0.09 s."""
    parts: dict[str, Block] = {
        "s": Sine(amplitude=1, frequency=1.3),
        "d": Delay(delay=0.09, period=0.03, sample_offset=0.01),
    }
    result = run(parts, "s.out d.in", stop=1.0, step=0.005, energy=False)
    last = 0.01 + 0.03 * np.floor((result.time - 0.01) / 0.03 + 1e-9)
    taken = last - 0.09
    expected = np.where(taken > 0.0, np.sin(2 * np.pi * 1.3 * taken), 0.0)
    np.testing.assert_allclose(result["d.out"], expected, atol=1e-12)


def test_delay_breaks_a_loop_and_none_does_not() -> None:
    """y(k) = u - y(k - 3) / 2, a loop through a delay; without delay it is algebraic."""

    def loop(delay: float) -> dict[str, Block]:
        gain = StateSpace(D=[[1.0, -0.5]])
        return {"step": Step(height=1), "law": gain, "delay": Delay(delay=delay, period=0.1)}

    wires = ["step.out law.in1", "delay.out law.in2", "law.out delay.in"]
    result = run(loop(0.3), *wires, stop=2.0, step=0.1, energy=False)
    y = [1.0, 1.0, 1.0]
    for k in range(3, 21):
        y.append(1 - y[k - 3] / 2)
    np.testing.assert_allclose(result["law.out"], y, atol=1e-14)
    with pytest.raises(StructureError, match="algebraic loop"):
        model(loop(0.0), *wires)


@pytest.mark.parametrize(("delay", "offset"), [(0.0007, 0.0), (0.025, 0.0), (0.0249, 0.004), (0.0301, 0.0099)])
def test_a_delay_between_samples_shifts_the_instants(delay: float, offset: float) -> None:
    """Read every 0.01 s from the offset on, given out the delay later: a sum of steps, each exactly so late."""
    parts: dict[str, Block] = {
        "s": Sine(amplitude=1, frequency=1.7, phase=0.4),
        "d": Delay(delay=delay, period=0.01, sample_offset=offset, start=3.0),
    }
    result = run(parts, "s.out d.in", stop=0.5, step=0.0001, energy=False)
    read = np.floor((result.time - delay - offset) / 0.01 + 1e-7) * 0.01 + offset
    expected = np.where(read >= offset - 1e-9, np.sin(2 * np.pi * 1.7 * read + 0.4), 3.0)
    np.testing.assert_allclose(result["d.out"], expected, atol=1e-12)


def test_a_delay_of_too_many_samples_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"100000 samples is too long"):
        Delay(delay=100, period=0.001)
    assert Delay(delay="20 ms", period="1 ms").count == 20


def test_sample_and_hold() -> None:
    parts: dict[str, Block] = {
        "s": Sine(amplitude=1, frequency=0.7, phase=0.3),
        "h": SampleHold(period=0.07, sample_offset=0.02, start=5.0),
    }
    result = run(parts, "s.out h.in", stop=1.0, step=0.01, energy=False)
    last = 0.02 + 0.07 * np.floor((result.time - 0.02) / 0.07 + 1e-9)
    expected = np.where(last >= 0, np.sin(2 * np.pi * 0.7 * last + 0.3), 5.0)
    np.testing.assert_allclose(result["h.out"], expected, atol=1e-12)


def test_blocks_of_different_rates_and_offsets_in_one_chain() -> None:
    """Filter at 10 ms, delay at 25 ms from 5 ms on, filter at 20 ms: each against its own recursion."""
    parts: dict[str, Block] = {
        "source": Sine(amplitude=1, frequency=2.0),
        "fast": LowPass(corner_frequency=30, period=0.01),
        "delay": Delay(delay=0.05, period=0.025, sample_offset=0.005),
        "slow": LowPass(corner_frequency=15, period=0.02),
    }
    result = run(
        parts, "source.out fast.in", "fast.out delay.in", "delay.out slow.in", stop=1.0, step=0.005, energy=False
    )
    fast, slow, line, shown = 0.0, 0.0, [0.0, 0.0], 0.0
    for k in range(201):
        tick = 5 * k
        if tick % 10 == 0:
            fast += (1 - np.exp(-0.3)) * (np.sin(2 * np.pi * 2.0 * tick / 1000) - fast)
        if tick >= 5 and (tick - 5) % 25 == 0:
            shown = line.pop(0)
            line.append(fast)
        if tick % 20 == 0:
            slow += (1 - np.exp(-0.3)) * (shown - slow)
        assert result["fast.out"][k] == pytest.approx(fast, abs=1e-12)
        assert result["delay.out"][k] == pytest.approx(shown, abs=1e-12)
        assert result["slow.out"][k] == pytest.approx(slow, abs=1e-12)


# -- input shapers ----------------------------------------------------------------------------------------------------


def oscillator(w: float, zeta: float) -> StateSpace:
    return StateSpace(A=[[0, 1], [-(w**2), -2 * zeta * w]], B=[[0], [w**2]], C=np.eye(2))


def residual(shaper: Block, w: float, zeta: float, moves: list[float]) -> float:
    """Amplitude that is left of a mode after held random moves of the command, relative to their size."""
    stop = 0.05 * len(moves) + 3.0
    drive = Drive(0.05 * np.arange(len(moves)), np.array(moves), "zero_order")
    result = run(
        {"shaper": shaper, "mode": oscillator(w, zeta)}, "shaper.out mode.in", inputs=["shaper.in"], drive=drive,
        stop=stop, step=0.01, internal_step=0.002, energy=False,
    )  # fmt: skip
    y, v = result["mode.out1"][-1] - moves[-1], result["mode.out2"][-1]
    decay = np.exp(-zeta * w * stop)
    return float(np.hypot(y, (v + zeta * w * y) / (w * np.sqrt(1 - zeta**2))) / decay / max(np.abs(moves)))


MOVES = [*np.random.default_rng(9).normal(size=12), 1.0]


@pytest.mark.parametrize("shaper", ["ZV", "ZVD"])
@pytest.mark.parametrize("zeta", [0.0, 0.1])
@pytest.mark.parametrize("period", [0.01, 0.0125, 0.05])
def test_shaped_commands_leave_no_vibration(shaper: str, zeta: float, period: float) -> None:
    """Any held command, at any sample period, though half a cycle is no whole number of samples."""
    w = 13.7
    made = InputShaper(shaper=shaper, frequency=w, damping_ratio=zeta, period=period)
    assert residual(made, w, zeta, MOVES) < 2e-6
    assert residual(LowPass(corner_frequency=1e4, active=False), w, zeta, MOVES) > 0.1


def test_shaper_amplitudes() -> None:
    """ZV and ZVD of an undamped mode whose half cycle is ten samples; of a damped one, the ratio K."""
    w = np.pi / 0.1
    plain = InputShaper(frequency=w, period=0.01)
    np.testing.assert_allclose(plain.amplitudes, [0.5, *[0] * 9, 0.5], atol=1e-15)
    double = InputShaper(shaper="ZVD", frequency=w, period=0.01)
    np.testing.assert_allclose(double.amplitudes, [0.25, *[0] * 9, 0.5, *[0] * 9, 0.25], atol=1e-15)
    zeta = 0.2
    damped = InputShaper(frequency=w / np.sqrt(1 - zeta**2), damping_ratio=zeta, period=0.01)
    ratio = np.exp(-zeta * np.pi / np.sqrt(1 - zeta**2))
    np.testing.assert_allclose(damped.amplitudes[::10], [1 / (1 + ratio), ratio / (1 + ratio)], rtol=1e-12)
    for made in (plain, double, damped, InputShaper(frequency=11.1, damping_ratio=0.3, period=0.017)):
        assert sum(made.amplitudes) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(("shaper", "power"), [("ZV", 1), ("ZVD", 2)])
@pytest.mark.parametrize("error", [0.95, 1.05])
def test_shapers_with_a_wrong_frequency(shaper: str, power: int, error: float) -> None:
    """The residual of an undamped mode is |cos(pi f / 2 f0)| to the power 1 or 2: 8 % and 0.6 % at 5 %."""
    w = 10.0
    made = InputShaper(shaper=shaper, frequency=w, period=np.pi / w / 100)
    parts: dict[str, Block] = {"step": Step(height=1), "shaper": made, "mode": oscillator(error * w, 0.0)}
    result = run(
        parts, "step.out shaper.in", "shaper.out mode.in", stop=4.0, step=0.01, internal_step=1e-3, energy=False
    )
    y, v = result["mode.out1"][-1] - 1, result["mode.out2"][-1]
    expected = abs(np.cos(np.pi * error / 2)) ** power
    assert np.hypot(y, v / (error * w)) == pytest.approx(expected, rel=2e-3)


def test_shaper_refuses_too_long_a_period() -> None:
    with pytest.raises(ParameterError, match=r"0.5 s is too long for a mode of 10 rad/s\n  give less than 0.28"):
        InputShaper(frequency=10, period=0.5)


# -- sensors of signals -----------------------------------------------------------------------------------------------


def test_scaled_sensor() -> None:
    parts: dict[str, Block] = {
        "s": Sine(amplitude="0.5 rad", frequency=1),
        "p": ScaledSensor(sensitivity="2 V/rad", bias="0.1 V", unit="V"),
    }
    result = run(parts, "s.out p.in", stop=1.0, step=0.01)
    np.testing.assert_allclose(result["p.out"], 2 * result["s.out"] + 0.1, atol=1e-15)
    assert result.units["p.out"] == "V"


def test_rectified_sensor() -> None:
    parts: dict[str, Block] = {"s": Sine(amplitude=2, frequency=1), "r": RectifiedSensor(sensitivity=3, bias=0.5)}
    result = run(parts, "s.out r.in", stop=1.2, step=0.07, energy=False)
    np.testing.assert_allclose(result["r.out"], 3 * np.abs(result["s.out"]) + 0.5, atol=1e-9)
    crossings = [t for t in instants(result, "r.sign") if t > 1e-6]
    np.testing.assert_allclose(sorted({round(t, 9) for t in crossings}), [0.5, 1.0], atol=1e-9)


def test_sensor_lag() -> None:
    block = SensorLag(time_constant=0.2, sensitivity=3.0, bias=0.5, start=1.0)
    parts: dict[str, Block] = {"s": Step(height=2.0), "lag": block}
    result = run(parts, "s.out lag.in", stop=1.0, step=0.01, energy=False)
    np.testing.assert_allclose(result["lag.out"], 0.5 + 6 - 5 * np.exp(-result.time / 0.2), atol=1e-6)
    found = linear({"lag": block}, inputs=["lag.in"], outputs=["lag.out"])
    assert abs(found.gain(5.0)[0, 0]) == pytest.approx(3 / np.sqrt(2), rel=1e-12)
