"""An input shaper: a command that leaves a mode at rest when it is over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.controllers.base import SignalBlock, clock, sample_offset
from engine.block import option, parameter, signal_in, signal_out
from engine.errors import ParameterError

if TYPE_CHECKING:
    from engine.net import Net

LONGEST = 20_000
"""Samples in half a cycle of the mode, as in a `Delay`; the shaper keeps as many, or twice as many."""


class InputShaper(SignalBlock):
    """Input shaper: out(t) = sum A_i in(t - t_i), sum A_i = 1, so that a mode w, zeta is left at rest.

    w = frequency is the undamped angular frequency (``3 Hz`` is 18.85 rad/s), zeta = damping_ratio. With
    K = exp(-pi zeta / sqrt(1 - zeta^2)) and half the damped period h = pi / (w sqrt(1 - zeta^2)):

        ZV:  A = (1, K) / (1 + K) at 0, h              ZVD: A = (1, 2 K, K^2) / (1 + K)^2 at 0, h, 2 h

    ZV cancels the mode, ZVD also its first derivative with respect to w and zeta, at the price of another h.

    Sampled, as a delay line: an impulse between two instants is split over both so that together they excite the mode
    exactly as the impulse would; a held command then leaves no vibration whatever the period. The amplitudes are
    computed when the model is built, so parameters cannot be tuned afterwards. The output has the input's unit.
    [Singer 1990]
    """

    shaper = option(str, "ZV", "which shaper", choices=("ZV", "ZVD"))
    frequency = parameter("rad/s", ..., "undamped angular frequency w of the mode", gt=0, structural=True)
    damping_ratio = parameter("1", 0.0, "damping ratio zeta of the mode", ge=0, lt=1, structural=True)
    period = parameter("s", ..., "sample period", gt=0, structural=True)
    sample_offset = sample_offset()
    start = parameter("*", 0.0, "what the input was before the beginning")

    input = signal_in("*", "command", name="in")
    out = signal_out("*", "shaped command")

    def check(self) -> None:
        """The samples must be dense enough to hold an impulse of the mode."""
        super().check()
        damped = self.frequency * math.sqrt(1 - self.damping_ratio**2)
        if damped * self.period >= 0.9 * math.pi:
            raise ParameterError(
                f"period = {self.period:g} s is too long for a mode of {damped:g} rad/s",
                remedy=f"give less than {0.9 * math.pi / damped:g} s",
            )
        once = zero_vibration(self.frequency, self.damping_ratio, self.period)
        self.amplitudes = convolved(once, once) if self.shaper == "ZVD" else once

    def stamp(self, net: Net) -> None:
        ticks = clock(net, self)
        stages = [k for k, amplitude in enumerate(self.amplitudes) if k and amplitude]
        line = net.line("*", ticks, self.input, stages, start=self.start)
        out = self.amplitudes[0] * self.input
        for stage in stages:
            out = out + self.amplitudes[stage] * line[stage]
        shaped = net.memory("shaped", "*", ticks, start=self.start, held=True)
        net.update(shaped, out)
        self.publish(net, shaped)


def zero_vibration(frequency: float, damping_ratio: float, period: float) -> list[float]:
    """Amplitudes of the ZV shaper at the samples 0, 1, 2, ...

    The second impulse A, at h = (n + f) T, is split into x at n T and y at (n + 1) T. With the mode's pole
    p = -sigma + i wd they must excite it alike: x e^(p f T) + y e^(-p (1 - f) T) = A, one complex equation for both.
    """
    sigma, wd = frequency * damping_ratio, frequency * math.sqrt(1 - damping_ratio**2)
    ratio, half = math.exp(-math.pi * sigma / wd), math.pi / wd
    if not half / period <= LONGEST:
        raise ParameterError(
            f"half a cycle of the mode takes {half / period:.3g} samples of {period:g} s; at most {LONGEST} are kept",
            remedy="give a longer period, or a higher frequency",
        )
    n = math.floor(half / period + 1e-9)
    f = max(half / period - n, 0.0)
    x = ratio * math.sin(wd * (1 - f) * period) / math.sin(wd * period) * math.exp(sigma * f * period)
    y = ratio * math.sin(wd * f * period) / math.sin(wd * period) * math.exp(-sigma * (1 - f) * period)
    amplitudes = [1.0, *[0.0] * (n - 1), x, y]
    if amplitudes[-1] == 0:
        amplitudes.pop()
    total = sum(amplitudes)
    return [a / total for a in amplitudes]


def convolved(a: list[float], b: list[float]) -> list[float]:
    """Amplitudes of one shaper after another."""
    out = [0.0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b) if x else ():
            if y:
                out[i + j] += x * y
    return out
