"""Sampling order: sensors sample before controllers write, and a sampled sensor is no sample late."""

from __future__ import annotations

import numpy as np

from engine.assemble import build
from engine.block import Block, flange, parameter, signal_out
from engine.net import Net
from engine.simulate import simulate
from engine.system import bypass
from tests.engine.parts import Body, Held, system


class SampledSensor(Block):
    """Angle taken at instants."""

    period = parameter("s", 0.1, "period", gt=0, structural=True)
    shaft = flange("measured")
    out = signal_out("rad", "angle")

    def stamp(self, net: Net) -> None:
        held = net.memory("held", "rad", net.clock(self.period), held=True)
        net.update(held, self.shaft.angle)
        net.output(self.out, held)


def test_a_controller_sees_what_a_sensor_took_at_the_same_instant() -> None:
    plant = system(
        {"m": Body(inertia=1.0), "s": SampledSensor(), "c": Held(gain=3.0, period=0.1)},
        ("m.shaft", "s.shaft"),
        ("s.out", "c.in"),
    )
    run = simulate(build(plant), 1.0, 0.1, initial={"m.shaft.speed": 2.0})
    assert np.abs(run["c.out"] - 3.0 * 2.0 * run.time).max() < 1e-14


def test_parameters_that_no_equation_reads_are_not_offered() -> None:
    model = build(system({"m": Body(inertia=1.0), "c": Held(gain=2.0)}, ("m.shaft.angle", "c.in")))
    assert [p.name for p in model.parameters] == ["c.gain"]


def test_a_signal_goes_on_to_others_when_one_that_read_it_is_dropped() -> None:
    """``m.shaft.angle`` feeds the dropped controller ``c`` and the kept one ``d`` by one connection."""
    plant = system(
        {"m": Body(inertia=1.0), "c": Held(gain=2.0), "d": Held(gain=3.0), "e": Held(gain=4.0)},
        ("m.shaft.angle", "c.in", "d.in"),
        ("c.out", "e.in"),
    )
    left, dropped = bypass(plant, ["e.in"], wanted=["d.out", "e.out"])
    assert dropped == ["c"]
    assert [c.ends for c in left.connections] == [("m.shaft.angle", "d.in")]
