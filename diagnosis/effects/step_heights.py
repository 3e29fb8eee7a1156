"""Heights of steps of a command that stand out in what a model leaves over.

A command that is rounded to steps of height s is off by a saw in the command, whose k-th wave has the period s / k.
What a unit change of the command at each sample would explain, summed over the samples as a wave of the command, is one
Fourier sum over commands; it gives the pull of all heights at once, however fine. Only those that pull most are then
simulated one by one.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from diagnosis.effects.linear_answer import LinearAnswer, white, whitened
from diagnosis.effects.orders import Left
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from engine.errors import FlexarmError

LEVELS = 4096
"""Steps of the largest command, of the finest that are looked for: converters of finer ones are rare."""

NEAR = 0.125
"""Change of a step, in steps of the largest command, by which that command ends on another one: a fraction of it."""

WAVES = 3
"""Waves of the saw that are summed: the others are small."""

BINS = 8
"""Bins of commands in the shortest of these waves."""

LOOKED_AT = 8
"""Heights of each octave that are simulated, of the thousands that are ranked."""

APART = 1.03
"""Factor between two heights that are proposed."""

_LAST = int(WAVES * LEVELS / NEAR)
_COUNT = BINS * _LAST
"""Waves of a period that is looked at, and bins of it."""

WORTH = 30.0
"""What a height must explain, in variances of the noise: the best of thousands explains twenty by chance."""


def heights(problem: Problem, x: Array, target: str, size: float, most: int, left: Left | None = None) -> list[float]:
    """Heights of steps of a recorded command that explain most of what is left over, the best first.

    Args:
        problem: the model that answers to the command.
        x: its search vector, as fitted.
        target: the driven input.
        size: its largest value.
        most: number of heights.
        left: what is left over, by that model if None.
    """
    try:
        answer = LinearAnswer(problem, x, target)
    except FlexarmError:
        return []
    number = [v.name for v in problem.model.inputs].index(target)
    over_time = [e for e in problem.training if isinstance(e, TimeExperiment) and e.drive is not None]
    parts = [_LeftOver(answer, e, number, left(e) if left else problem.residual(x, e)) for e in over_time]

    def explained(grid: Sequence[float]) -> Array:
        return sum((one.explained(grid) for one in parts), np.zeros(len(grid)))

    grid = standing_out(parts, size)
    score = explained(grid)
    between = [
        1 / (1 / grid[k] + share * NEAR / size) for k in np.argsort(-score)[:LOOKED_AT] for share in (-1 / 3, 1 / 3)
    ]
    grid, score = [*grid, *between], np.concatenate([score, explained(between)])
    chosen: list[float] = []
    for k in np.argsort(-score):
        new = all(abs(math.log(grid[k] / c)) > math.log(APART) for c in chosen)
        if score[k] > WORTH and len(chosen) < most and new:
            chosen.append(grid[k])
    return chosen


def standing_out(left: Sequence[_LeftOver], size: float) -> list[float]:
    """The heights of each octave that pull most, in each experiment as against the others of that octave.

    So heights compare that the machine smooths alike, and an experiment at rest, which any height pulls along, says
    little.

    Args:
        left: what is left over of each experiment.
        size: largest command.
    """
    period = size / NEAR  # as waves in the command, neighbouring heights differ by one over this
    waves = [_waves(one, period) for one in left]
    found: list[float] = []
    first = round(1 / NEAR)
    while first < LEVELS / NEAR:
        numbers = np.arange(first, 2 * first)
        score = np.zeros(first)
        for wave in waves:
            # The k-th wave of the saw is (-1)^k s / (pi k) sin(2 pi k u / s).
            parts = [(-1) ** k / k * wave[k * numbers] for k in range(1, WAVES + 1)]
            pull = np.sum(parts, axis=0)
            usual = float(np.mean(pull**2))
            score += np.maximum(pull, 0.0) ** 2 / usual if usual else 0.0
        found += [float(period / m) for m in numbers[np.argsort(-score)[:LOOKED_AT]]]
        first *= 2
    return found


def _waves(one: _LeftOver, period: float) -> Array:
    """What each wave in the command, sin(2 pi m u / period), would pull, up to the last that is looked at."""
    at = np.floor(one.command / period * _COUNT).astype(int) % _COUNT
    spectrum = scipy.fft.rfft(np.bincount(at, weights=one.wanted, minlength=_COUNT))[:_LAST]
    return np.asarray(-(spectrum * _half_a_bin()).imag)


@functools.cache
def _half_a_bin() -> NDArray[np.complex128]:
    """The phase of each wave from the edge of a bin to its middle."""
    return np.asarray(np.exp(-1j * np.pi * np.arange(_LAST) / _COUNT))


class _LeftOver:
    """What is left over of an experiment, and what a change of one of its inputs would do to it.

    Attributes:
        command: the input, as it is held at each sample.
        wanted: by how much half the squared residual would fall for a unit more of the input at each sample.
    """

    def __init__(self, answer: LinearAnswer, e: TimeExperiment, number: int, left: Array) -> None:
        assert e.drive is not None
        values = np.asarray(e.drive.values, dtype=float).reshape(len(np.asarray(e.drive.time)), -1)[:, number]
        # What is held since the last row, at the samples.
        last = np.searchsorted(np.asarray(e.drive.time), np.asarray(e.time) + 1e-9, side="right") - 1
        rows, interval = e.evenly(np.column_stack([values[np.maximum(last, 0)], left]))
        self.command, residual = rows[:, 0], rows[:, 1:]
        count = 2 * len(self.command)
        held = np.exp(-1j * np.pi * scipy.fft.fftfreq(count)) * np.sinc(scipy.fft.fftfreq(count))
        self._response = answer.response(count, interval) / e.sigma * held[:, None]
        self._weights = [white(e, residual[:, k]) for k in range(residual.shape[1])]
        self._rest = [whitened(residual[:, [k]], w)[:, 0] for k, w in enumerate(self._weights)]
        self.wanted = np.zeros(len(self.command))
        for k, (flat, weights) in enumerate(zip(self._rest, self._weights, strict=True)):
            spectrum = scipy.fft.fft(whitened(flat[:, None], weights)[:, 0], count)
            self.wanted += scipy.fft.ifft(spectrum * self._response[:, k].conj())[: len(self.command)].real

    def explained(self, grid: Sequence[float]) -> Array:
        """What steps of each height explain of the residual, in its variances."""
        n, found = len(self.command), np.zeros(len(grid))
        for i, step in enumerate(grid):
            spectrum = scipy.fft.fft(step * np.floor(self.command / step + 0.5) - self.command, 2 * n)
            pull = power = 0.0
            for k, flat in enumerate(self._rest):
                answer = scipy.fft.ifft(spectrum * self._response[:, k])[:n].real
                made = whitened(answer[:, None], self._weights[k])[:, 0]
                pull, power = pull + float(made @ flat), power + float(made @ made)
            if pull > 0 and power > 0:
                found[i] = pull**2 / power
        return found
