"""Sampling at instants that are not even."""

from __future__ import annotations

from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock
from blocks.sources.noise import MODULI, draw, first
from blocks.symbolic import choose, floor, least
from engine.block import option, parameter, signal_in, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class JitteredSample(SignalBlock):
    """Jittered sampling: out = in at the instants k period + delay_k, held between; delay_k even in 0 ... jitter.

    A controller under an operating system that is not real-time, or a bus without a common clock: each period begins
    on time, and the sample comes up to ``jitter`` later, independently each time. The delays are whole ``slots``-ths of
    the period, so that every instant is a clock's; their sequence depends on ``seed`` alone and is the same in every
    runtime and FMU. The first sample comes at once. A jitter of 0 is a `SampleHold`. The output has the input's unit.

    In linear models every slot samples: the mean delay of a real one is half the jitter and half a period.
    """

    period = parameter("s", ..., "time between the beginnings of two periods", gt=0, structural=True)
    jitter = parameter("s", 0.0, "latest delay of a sample within its period", ge=0)
    slots = option(int, 20, "instants per period at which a sample may come", ge=2, le=1000)
    seed = option(int, 1, "chooses the sequence", ge=0, le=2**31 - 1)

    input = signal_in("*", "signal", name="in")
    out = signal_out("*", "signal as sampled")

    def stamp(self, net: Net) -> None:
        ticks, last = net.clock(self.period / self.slots), self.slots - 1
        place = net.memory("place", "1", ticks)
        states = [net.memory(f"generator{k + 1}", "1", ticks, start=s) for k, s in enumerate(first(self.seed))]
        after, share = draw(states)
        width = self.jitter / self.period * self.slots + 1
        begun = net.memory("begun", "1", ticks)
        slot = choose(begun > 0.5, least(floor(share * width), last), 0.0)
        net.update(begun, choose(place >= last, 1.0, choose(begun > 0.5, 1.0, 0.0)))
        # By remainders, which have no slope in linear models: none of this is a pole there.
        net.update(place, place + 1 - self.slots * floor((place + 1) / self.slots))
        for state, following, modulus in zip(states, after, MODULI, strict=True):
            net.update(state, choose(place >= last, following, state - modulus * floor(state / modulus)))
        out = net.memory("sample", "*", ticks, held=True)
        net.update(out, choose(place == slot, self.input, out))
        self.publish(net, out)
