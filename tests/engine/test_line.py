"""Delay lines: the same as a shifted array, in C, in Python, in tangents and in discrete time, at any length."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blocks.controllers.delay import Delay
from blocks.controllers.gain import Gain
from blocks.controllers.input_shaper import InputShaper
from blocks.controllers.low_pass import LowPass
from blocks.sources.sine import Sine
from engine.assemble import build
from engine.codegen import simulation_source
from engine.discretise import discretise
from engine.errors import ParameterError
from engine.simulate import Drive, simulate
from engine.system import Connection, System
from engine.tangent import tangents


def _system(block: Any, **others: Any) -> Any:
    blocks = {"s": Sine(amplitude=2.0, frequency="3 Hz"), "g": Gain(gain=1.5), "b": block, **others}
    ends = [("s.out", "g.in"), ("g.out", "b.in")]
    return System(
        blocks, [Connection(pair) for pair in [*ends, *(("b.out", f"{name}.in") for name in others)]], name="line"
    )


def _shifted(samples: Any, count: Any, start: Any) -> Any:
    return np.concatenate([np.full(count, start), samples])[: len(samples)]


@pytest.mark.parametrize("backend", ["c", "interpreter"])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 50])
def test_a_delay_is_a_shift(backend: Any, count: Any) -> None:
    model = build(_system(Delay(delay=count * 1e-2, period=1e-2, start=0.25)))
    run = simulate(model, 1.0, 1e-2, backend=backend)
    given = 3.0 * np.sin(2 * np.pi * 3 * run.time)
    assert np.abs(run["b.out"] - _shifted(given, count, 0.25)).max() < 1e-12
    again = simulate(model, 1.0, 1e-2, backend=backend, parameters={"b.start": -1.0})
    assert np.abs(again["b.out"] - _shifted(given, count, -1.0)).max() < 1e-12


@pytest.mark.parametrize("backend", ["c", "interpreter"])
def test_a_shaper_is_a_sum_of_shifts(backend: Any) -> None:
    shaper = InputShaper(shaper="ZVD", frequency="2.3 Hz", damping_ratio=0.1, period=1e-2)
    run = simulate(build(_system(shaper)), 1.0, 1e-2, backend=backend)
    given = 3.0 * np.sin(2 * np.pi * 3 * run.time)
    expected = np.convolve(given, shaper.amplitudes)[: len(given)]
    assert np.abs(run["b.out"] - expected).max() < 1e-12


def test_delays_that_differ_in_length_alone_share_one_library() -> None:
    sources = {simulation_source(build(_system(Delay(delay=d, period=1e-2)))) for d in ("13 ms", "24 ms", "995 ms")}
    assert len(sources) == 1
    assert simulation_source(build(_system(Delay(delay="2 s", period=1e-2)))) not in sources


def test_ten_seconds_at_a_millisecond_cost_no_symbols() -> None:
    model = build(_system(Delay(delay=10.0, period=1e-3)), outputs=["b.out"])
    assert len(model.memories) == 2
    assert len(simulation_source(model)) < 60_000
    run = simulate(model, 12.0, 0.1)
    expected = np.where(run.time >= 10.0, 3.0 * np.sin(2 * np.pi * 3 * (run.time - 10.0)), 0.0)
    assert np.abs(run["b.out"] - expected).max() < 1e-9


def test_tangents_pass_through() -> None:
    """The delay and the shaper are linear, so a difference of runs is exact."""
    others = {"f": LowPass(corner_frequency=20.0)}
    for block in (Delay(delay=0.073, period=1e-2), InputShaper(frequency="2.3 Hz", period=1e-2)):
        model = build(_system(block, **others), outputs=["b.out", "f.out"])
        names = ["s.amplitude", "g.gain", "b.start"]
        found = tangents(model, 1.0, 1e-2, wrt=names)
        for name in names:
            value = model.parameter_values[model.parameter_index(name)]
            up, down = (simulate(model, 1.0, 1e-2, parameters={name: value + s}).values for s in (0.5, -0.5))
            exact = up - down
            for k, output in enumerate(("b.out", "f.out")):
                assert np.abs(found.of(output, name) - exact[:, k]).max() < 1e-9, (name, output)


@pytest.mark.parametrize(
    "block",
    [
        Delay(delay=0.05, period=1e-2),
        Delay(delay=0.01, period=1e-2),
        InputShaper(shaper="ZVD", frequency="2.3 Hz", damping_ratio=0.1, period=1e-2),
    ],
)
def test_the_discrete_model_holds_every_stage(block: Any) -> None:
    system = System(
        {"f": LowPass(corner_frequency=20.0), "b": block, "h": LowPass(corner_frequency=7.0)},
        [Connection(("f.out", "b.in")), Connection(("b.out", "h.in"))],
        name="line",
    )
    model = build(system, inputs=["f.in"], outputs=["h.out", "b.out"])
    found = discretise(model)
    u = np.where(np.arange(120) % 40 < 20, 1.0, -0.5)
    x, rows = np.zeros(len(found.states)), []
    for value in u:
        rows.append(found.C @ x + found.D @ [value])
        x = found.A @ x + found.B @ [value]
    drive = Drive(np.arange(120) * 1e-2, u[:, None])
    run = simulate(model, 1.19, 1e-2, drive=drive, internal_step=1e-4)
    assert np.abs(np.array(rows) - run.values).max() < 1e-9
    assert len(set(found.states)) == len(found.states)


def test_a_discrete_model_too_large_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"b\.line.*9999"):
        discretise(build(_system(Delay(delay=10.0, period=1e-3))))
