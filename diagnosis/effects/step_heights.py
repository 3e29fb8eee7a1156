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

from diagnosis.effects.linear_answer import LinearAnswer, white
from diagnosis.effects.orders import Left
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.slopes import linearised
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

LOOKED_AT = 16
"""Heights of each octave that are simulated, of the thousands that are ranked."""

REFINED = 8
"""Heights of all octaves beside which others are looked at."""

BESIDE = (-1, -2 / 3, -1 / 3, 1 / 3, 2 / 3, 1)
"""How far off these are, in distances between heights that are ranked: steps pull most not just where they fit best."""

TOGETHER = 16
"""Heights that are simulated at a time: more would take much memory where recordings are long."""

APART = 1.03
"""Factor between two heights that are proposed."""

RANK = 1e-12
"""Share of the largest square below which a direction in which parameters move recordings is none."""

_LAST = int(WAVES * LEVELS / NEAR)
_COUNT = BINS * _LAST
"""Waves of a period that is looked at, and bins of it."""

WORTH = 30.0
"""What a height must explain, in variances of the noise: the best of thousands explains twenty by chance."""


def heights(problem: Problem, x: Array, target: str, size: float, most: int, left: Left | None = None) -> list[float]:
    """Heights of steps of a recorded command that explain most of what is left over, the best first.

    Of two kinds by turns: what a height explains of each experiment alone, were its saw of any size, and what it
    explains of all together, of its own size. Alone the parameters may bend for each; together a height must be met
    closely, since a command that stays ends on another step of one that is a little off.

    Args:
        problem: the model that answers to the command.
        x: its search vector, as fitted.
        target: the driven input.
        size: its largest value.
        most: number of heights.
        left: what is left over, by that model if None.
    """
    over_time = [e for e in problem.training if isinstance(e, TimeExperiment) and e.drive is not None]
    if not over_time:
        return []
    try:
        answer = LinearAnswer(problem, x, target)
        runs = linearised(problem, x, over_time)
    except FlexarmError:
        return []
    number = [v.name for v in problem.model.inputs].index(target)
    parts = [_LeftOver(answer, e, number, left(e) if left else r, J) for e, (r, J) in zip(over_time, runs, strict=True)]
    _without_parameters(parts)
    grid = standing_out(parts, size)
    scores = _explained(parts, grid)
    best = dict.fromkeys(int(k) for kind in np.argsort(-scores, axis=1) for k in kind[:REFINED])
    between = [1 / (1 / grid[k] + share * NEAR / size) for k in best for share in BESIDE]
    grid, scores = [*grid, *between], np.concatenate([scores, _explained(parts, between)], axis=1)
    chosen: list[float] = []
    for turn in np.argsort(-scores, axis=1).T:
        for kind, k in enumerate(turn):
            new = all(abs(math.log(grid[k] / c)) > math.log(APART) for c in chosen)
            if scores[kind, k] > WORTH and len(chosen) < most and new:
                chosen.append(grid[k])
    return chosen


def _explained(parts: Sequence[_LeftOver], grid: Sequence[float]) -> Array:
    """What each height explains in variances of the noise, of experiments alone and together, shape (2, heights)."""
    rows = [one.answers(grid) for one in parts]
    alone = sum(np.maximum(pull, 0.0) ** 2 / np.maximum(power, 1e-300) for pull, power, _ in rows)
    pull, power, taken = (np.sum(each, axis=0) for each in zip(*rows, strict=True))
    return np.array([alone, 2 * pull - power + np.sum(taken**2, axis=1)])


def standing_out(left: Sequence[_LeftOver], size: float) -> list[float]:
    """The heights of each octave that pull most, in each experiment as against the others of that octave.

    So heights compare that the machine smooths alike, and an experiment at rest, which any height pulls along, says
    little. A pull counts by its logarithm: what is left over is not all noise, and in one of the experiments it happens
    to follow some heights closely. Of neighbours that pull alike the best one is taken.

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
            score += np.log1p(np.maximum(pull, 0.0) ** 2 / usual) if usual else 0.0
        highest = (score >= np.append(score[1:], 0.0)) & (score >= np.append(0.0, score[:-1]))
        best = np.argsort(np.where(highest, -score, 0.0))[:LOOKED_AT]
        found += [float(period / m) for m in numbers[best]]
        first *= 2
    return found


def _without_parameters(parts: Sequence[_LeftOver]) -> None:
    """Take out of what is left over, and of what steps do, what the model's own parameters can take up.

    They have been fitted, and have moved to make up for steps as well as they can.
    """
    products = sum(np.tensordot(one.slopes, one.slopes, axes=((0, 1), (0, 1))) for one in parts)
    scale = 1 / np.sqrt(np.maximum(np.diag(products), 1e-300))
    sizes, axes = np.linalg.eigh(products * np.outer(scale, scale))
    able = sizes > RANK * max(sizes, default=0.0)
    made = scale[:, None] * axes[:, able] / np.sqrt(sizes[able])
    for one in parts:
        one.directions = one.slopes @ made
    taken = sum(np.tensordot(one.rest, one.directions, axes=2) for one in parts)
    for one in parts:
        one.rest = one.rest - one.directions @ taken


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
        rest: what is left over, as white amplitudes of cosines, shape (signals, samples).
        slopes: of the same by the model's own parameters, shape (signals, samples, parameters).
        directions: in which these move it, orthonormal in all experiments together; see `_without_parameters`.
    """

    def __init__(self, answer: LinearAnswer, e: TimeExperiment, number: int, left: Array, slopes: Array) -> None:
        assert e.drive is not None
        values = np.asarray(e.drive.values, dtype=float).reshape(len(np.asarray(e.drive.time)), -1)[:, number]
        # What is held since the last row, at the samples.
        last = np.searchsorted(np.asarray(e.drive.time), np.asarray(e.time) + 1e-9, side="right") - 1
        rows, interval = e.evenly(np.column_stack([values[np.maximum(last, 0)], left]))
        self.command, residual = rows[:, 0], rows[:, 1:]
        self._count = scipy.fft.next_fast_len(2 * len(self.command), real=True)
        frequencies = scipy.fft.rfftfreq(self._count)
        held = np.exp(-1j * np.pi * frequencies) * np.sinc(frequencies)
        response = answer.response(self._count, interval)[: len(frequencies)]
        self._response = (response / e.sigma * held[:, None]).T
        self._weights = np.column_stack([white(e, residual[:, k]) for k in range(residual.shape[1])]).T
        self.rest = scipy.fft.dct(residual.T, norm="ortho") * self._weights
        rows = e.components(np.nan_to_num(slopes)) * self._weights.T[:, :, None]
        self.slopes = rows.transpose(1, 0, 2)
        self.directions = np.zeros((*self.rest.shape, 0))

    @property
    def wanted(self) -> Array:
        """By how much half the squared residual would fall for a unit more of the input at each sample."""
        pull = scipy.fft.rfft(scipy.fft.idct(self.rest * self._weights, norm="ortho"), self._count)
        found = scipy.fft.irfft(pull * self._response.conj(), self._count)
        return np.asarray(found[:, : len(self.command)].sum(axis=0))

    def answers(self, grid: Sequence[float]) -> tuple[Array, Array, Array]:
        """What steps of each height do to the sensors.

        Its product with what is left over and its square, of shape (heights,), and its products with `directions`.
        """
        steps = np.asarray(grid)
        found = [self._answers(steps[k : k + TOGETHER]) for k in range(0, len(steps), TOGETHER)]
        pull, power, taken = (np.concatenate(each) for each in zip(*found, strict=True))
        return pull, power, taken

    def _answers(self, steps: Array) -> tuple[Array, Array, Array]:
        saws = steps[:, None] * np.floor(self.command / steps[:, None] + 0.5) - self.command
        spectrum = scipy.fft.rfft(saws, self._count)
        answers = scipy.fft.irfft(spectrum[:, None] * self._response, self._count)[..., : len(self.command)]
        made = scipy.fft.dct(answers, norm="ortho") * self._weights
        taken = np.tensordot(made, self.directions, axes=2)
        return np.tensordot(made, self.rest, axes=2), np.sum(made**2, axis=(1, 2)), taken
