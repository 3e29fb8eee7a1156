"""Large systems: the work grows with the number of blocks, and no chain is too long. Nothing here looks at a clock."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from blocks.actuators.gear import Gear
from blocks.actuators.spring_damper import TranslationalSpringDamper
from blocks.controllers.gain import Gain
from blocks.controllers.low_pass import LowPass
from blocks.controllers.sample_hold import SampleHold
from blocks.links.inertia import Inertia, Mass
from blocks.sources.constant import Constant
from engine.assemble import build
from engine.block import Block
from engine.codegen import simulation_source
from engine.simulate import simulate
from engine.system import Connection, System


def _chain(make: Any, count: Any) -> Any:
    blocks = {"s": Constant(value=2.0), **{f"b{k}": make() for k in range(count)}}
    wires = [("s.out", "b0.in"), *((f"b{k}.out", f"b{k + 1}.in") for k in range(count - 1))]
    return System(blocks, [Connection(pair) for pair in wires], name="chain")


def _gears(count: Any) -> Any:
    blocks = {
        "m": Inertia(inertia=2.0),
        **{f"g{k}": Gear(ratio=1.002) for k in range(count)},
        "j": Inertia(inertia=3.0),
    }
    wires = [("m.shaft", "g0.input"), *((f"g{k}.output", f"g{k + 1}.input") for k in range(count - 1))]
    wires.append((f"g{count - 1}.output", "j.shaft"))
    return System(blocks, [Connection(pair) for pair in wires], name="gears")


def _masses(count: Any) -> Any:
    blocks: dict[str, Block] = {"m0": Mass(mass=1.0)}
    for k in range(1, count):
        blocks |= {f"m{k}": Mass(mass=1.0), f"k{k}": TranslationalSpringDamper(stiffness=1.0)}
    ends = [pair for k in range(1, count) for pair in ((f"m{k - 1}.flange", f"k{k}.a"), (f"k{k}.b", f"m{k}.flange"))]
    return System(blocks, [Connection(pair) for pair in ends], name="masses")


@pytest.mark.parametrize(
    ("make", "last"),
    [
        (lambda: Gain(gain=1.001), 2.0 * 1.001**1500),
        (lambda: SampleHold(period=1e-3), 2.0),
    ],
)
def test_a_chain_longer_than_the_stack_is_deep(make: Any, last: Any) -> None:
    count = 1500
    assert count > sys.getrecursionlimit()
    model = build(_chain(make, count), outputs=[f"b{count - 1}.out"])
    run = simulate(model, 0.002, 1e-3)
    assert run.values[-1, 0] == pytest.approx(last, rel=1e-12)
    assert model.outputs[0].unit


def _calls(function: Any) -> Any:
    """Calls of Python and C functions while a function runs: a measure of work that no load of the machine changes."""
    count = 0

    def hear(frame: Any, event: Any, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(hear)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("make", [lambda n: _chain(lambda: LowPass(corner_frequency=9.0), n), _gears, _masses])
def test_assembly_is_linear_in_blocks(make: Any) -> None:
    build(make(3))
    small, large = make(100), make(300)
    assert _calls(lambda: build(large, outputs=[])) < 3.6 * _calls(lambda: build(small, outputs=[]))


@pytest.mark.parametrize("make", [lambda n: _chain(lambda: LowPass(corner_frequency=9.0), n), _gears, _masses])
def test_the_code_is_linear_in_blocks(make: Any) -> None:
    small, large = (len(simulation_source(build(make(n), outputs=[]))) for n in (100, 300))
    fixed = len(simulation_source(build(make(3), outputs=[])))
    assert large - fixed < 3.6 * (small - fixed)


def test_four_hundred_gears_turn_as_one() -> None:
    model = build(_gears(400), outputs=["m.shaft.angle", "j.shaft.angle"])
    assert model.coordinates == 1
    ratio = 1.002**400
    run = simulate(model, 1.0, 0.5, initial={"j.shaft.speed": 1.0})
    assert run["j.shaft.angle"][-1] == pytest.approx(1.0, rel=1e-12)
    assert run["m.shaft.angle"][-1] == pytest.approx(ratio, rel=1e-12)


def test_a_long_row_of_masses_carries_a_wave() -> None:
    """The first of equal masses m at springs k follows Bessel functions; here, its first instants' power series."""
    model = build(_masses(200), outputs=["m0.flange.position"])
    run = simulate(model, 0.3, 0.1, internal_step=0.01, initial={"m0.flange.position": 1.0})
    t = run.time
    assert np.abs(run["m0.flange.position"] - (1 - t**2 / 2 + t**4 / 12 - t**6 * 5 / 720)).max() < 1e-7
