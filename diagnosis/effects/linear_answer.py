"""The model's linear answer to a torque or an input, and the weights with which a residual is white.

What is left over is compared with the answers to many waves or inputs at once, none of which is simulated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.fft

from blocks.registry import registry
from diagnosis.effects.places import slides
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from engine.assemble import build
from engine.linearise import linearise
from engine.system import Connection, System

FEWEST = 8
"""Cosines in a band of the spectrum, over which it is smoothed."""


class LinearAnswer:
    """What an effort on a flange, or an input, does to the sensors: linearised at rest with frictions sliding.

    Args:
        problem: the model.
        x: its search vector, as fitted.
        target: a flange, or a driven input.
        beside: further variables whose answers follow those of the sensors.

    Raises:
        FlexarmError: the model cannot be linearised there.
    """

    def __init__(self, problem: Problem, x: Array, target: str, beside: Sequence[str] = ()) -> None:
        system, driven = problem.scenario.system, [v.name for v in problem.model.inputs]
        if target in driven:
            first, inputs = driven.index(target), driven
        else:
            kind, port, effort = (
                ("Force", "flange", "force") if slides(system, target) else ("Torque", "shaft", "torque")
            )
            system = System(
                {**system.blocks, "probe": registry()[kind]()},
                [*system.connections, Connection((target, f"probe.{port}"))],
                system.shared,
                {},
                system.places,
            )
            first, inputs = 0, [f"probe.{effort}", *driven]
        model = build(system, inputs=inputs, outputs=[*(v.name for v in problem.model.outputs), *beside])
        sliding = {mode.name: "sliding forward" for mode in model.modes if mode.kind == "friction"}
        known = {p.name for p in model.parameters}
        fitted = {name: value for name, value in problem.values(x)[0].items() if name in known}
        linear = linearise(model, modes=sliding, parameters=fitted)
        one = slice(first, first + 1)
        self.A, self.B, self.C, self.D = linear.A, linear.B[:, one], linear.C, linear.D[:, one]

    def response(self, count: int, interval: float) -> Array:
        """Outputs per input at the frequencies of a discrete transform, shape (count, outputs); none at rest."""
        made = np.zeros((count, len(self.C)), dtype=complex)
        made[1 : count // 2 + 1] = self.gains(2 * np.pi * scipy.fft.fftfreq(count, interval)[1 : count // 2 + 1])
        made[count // 2 + 1 :] = made[1 : (count + 1) // 2][::-1].conj()
        return made

    def gains(self, frequencies: Array) -> Array:
        """Outputs per input at frequencies (rad/s), shape (frequencies, outputs)."""
        shifted = 1j * frequencies[:, None, None] * np.eye(len(self.A)) - self.A
        return np.asarray(self.C @ np.linalg.solve(shifted, self.B) + self.D)[:, :, 0]


def white(e: TimeExperiment, residual: Array) -> Array:
    """Weights of the cosines with which a residual is white, shape (samples, 1)."""
    power, weights = e.components(residual[:, None])[:, 0] ** 2, np.ones(len(residual))
    for _, part in e.bands(FEWEST):
        weights[part] = max(float(np.mean(power[part])), 1.0) ** -0.5
    return weights[:, None]


def whitened(columns: Array, weights: Array) -> Array:
    """Columns, shape (samples, columns), weighted by `white`."""
    return np.asarray(scipy.fft.idct(scipy.fft.dct(columns, axis=0, norm="ortho") * weights, axis=0, norm="ortho"))
