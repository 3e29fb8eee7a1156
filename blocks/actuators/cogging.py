"""Cogging of a motor with magnets and slots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blocks.symbolic import sin
from engine.block import Block, flange, option, parameter, signal_out

if TYPE_CHECKING:
    from engine.net import Net


class Cogging(Block):
    """Cogging: torque on the shaft = sum over k of A_k sin(k N angle + phi_k), N = lcm(2 pole_pairs, slots).

    The magnets pull at the teeth of the stator whether current flows or not. A motor with 2p poles and s slots that are
    all alike repeats its torque N = lcm(2p, s) times in a revolution: 12 for 4 poles and 6 slots, 84 for 14 poles and
    12 slots. ``harmonics`` counts the k; A = amplitude, phi = phase, one value each. Where magnets or teeth differ
    there are orders of 2p and s too, each a `TorqueRipple`. The torque does no work over a wave; its potential counts
    as stored. [Zhu 2000]

    At a shaft speed w the fastest wave passes at w k N: the internal step must be short against 1 / (w k N).
    """

    pole_pairs = option(int, ..., "pole pairs p, half the number of poles", ge=1, le=200)
    slots = option(int, ..., "slots s of the stator", ge=1, le=1000)
    harmonics = option(int, 1, "number of harmonics", ge=1, le=10)
    amplitude = parameter("N.m", ..., "greatest torque A of each harmonic", ge=0, size="harmonics", tolerance=0.5)
    phase = parameter("rad", 0.0, "phase phi at angle zero of each harmonic", size="harmonics")

    shaft = flange("the rotor")
    torque = signal_out("N.m", "torque on the shaft")

    def stamp(self, net: Net) -> None:
        torque, potential = 0.0, 0.0
        for k in range(self.harmonics):
            order = (k + 1) * math.lcm(2 * self.pole_pairs, self.slots)
            wave = order * self.shaft.angle + self.phase[k]
            torque = torque + self.amplitude[k] * sin(wave)
            potential = potential - 2 * self.amplitude[k] / order * sin(wave / 2) ** 2
        net.potential([self.shaft], potential)
        net.output(self.torque, torque)
