"""Orders that stand out in what a fitted model leaves over: waves that pass with the angle of a shaft.

A torque sin(n angle) on a shaft shows in the sensors as the model's linear answer to it. What is left over is compared
with the answers of all orders, both made white by the spectrum of what is left over, in short pieces of time: there the
phase may differ, since the angle of a shaft that turns fast is not known to a fraction of a wave for long.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
import scipy.fft

from diagnosis.effects.linear_answer import LinearAnswer, white, whitened
from diagnosis.effects.places import groups, ratio, slides
from diagnosis.estimation.experiment import Experiment
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from engine.assemble import build
from engine.errors import FlexarmError

PIECE = 256
"""Samples of a piece: enough to tell orders apart, and few enough for the phase of a high one to hold."""

FASTEST = 2.6
"""Radians that a wave may advance within a sample: pi is the end of what samples show."""


Left = Callable[[Experiment], Array]
"""What is left over of an experiment, shape (samples, signals)."""


def standing_out(
    problem: Problem, x: Array, flange: str, orders: Sequence[int], most: int, left: Left | None = None
) -> list[int]:
    """The orders of waves on a shaft that explain most of what is left over, the best first.

    Args:
        problem: the model that answers to the waves.
        x: its search vector, as fitted.
        flange: of the shaft.
        orders: waves per revolution to choose from, next to one another.
        most: number of orders.
        left: what is left over, by that model if None.

    Returns:
        The first with its neighbours, since a model that turns a per cent too fast takes a high order for the next one;
        of the others the peaks, in pieces and as a whole by turns.
    """
    ranked = []
    for scores in explained_energy(problem, x, flange, orders, left):
        rows = np.concatenate([[-np.inf], scores, [-np.inf]])
        peaks = [k for k in np.argsort(-scores) if scores[k] > 0 and rows[k] <= scores[k] >= rows[k + 2]]
        ranked.append([orders[k] for k in peaks])
    found = [order for pair in itertools.zip_longest(*ranked) for order in pair if order is not None]
    beside = [order for order in orders if found and abs(order - found[0]) == 1]
    return list(dict.fromkeys([*found[:1], *beside, *found[1:]]))[:most]


def explained_energy(problem: Problem, x: Array, flange: str, orders: Sequence[int], left: Left | None = None) -> Array:
    """What waves explain of what is left over of the training recordings, in its variances, beyond chance.

    Args:
        problem: the model that answers to the waves.
        x: its search vector, as fitted.
        flange: of the shaft.
        orders: waves per revolution.
        left: as of `standing_out`.

    Returns:
        Shape (2, orders): piece by piece, and with one phase for each recording; zero where nothing can be said.
    """
    nothing: Array = np.zeros((2, len(orders)))
    try:
        answer = _Answer(problem, x, flange, left or (lambda e: problem.residual(x, e)))
        return sum((answer.explained(e, orders) for e in problem.training), nothing)
    except FlexarmError:
        return nothing


class _Answer:
    """What a torque on a shaft does to the sensors, and the angle of the shaft.

    Args:
        problem, x, flange, left: as of `standing_out`.

    Raises:
        FlexarmError: the model cannot be linearised there.
    """

    def __init__(self, problem: Problem, x: Array, flange: str, left: Left) -> None:
        self.problem, self.x, self.flange, self.left = problem, x, flange, left
        system, driven = problem.scenario.system, [v.name for v in problem.model.inputs]
        angle = [] if slides(system, flange) else [f"{flange}.angle"]
        self.linear = LinearAnswer(problem, x, flange, angle)
        self.encoders = [k for k, v in enumerate(problem.model.outputs) if v.name.endswith(".angle")]
        read = [problem.model.outputs[k].name for k in self.encoders]
        self.turning = build(system, driven, [*angle, *(name for name in read if name not in angle)]) if angle else None

    def explained(self, e: Experiment, orders: Sequence[int]) -> Array:
        """Energy of the residual of an experiment that each order explains, beyond what chance does, shape (2, orders).

        First piece by piece, then with one phase for the whole of it.
        """
        if not isinstance(e, TimeExperiment) or self.turning is None or len(e.time) < 2 * PIECE:
            return np.zeros((2, len(orders)))
        rows, interval = e.evenly(np.column_stack([self._angle(e), self.left(e)]))
        angle, residual = rows[:, 0], rows[:, 1:]
        step = np.abs(np.gradient(angle))[:, None]
        waves = np.where(step * np.asarray(orders) < FASTEST, np.exp(1j * angle[:, None] * np.asarray(orders)), 0.0)
        response = self.linear.response(2 * len(angle), interval)[:, : len(e.sigma)] / e.sigma
        spectrum = scipy.fft.fft(waves, 2 * len(angle), axis=0)
        pieces, whole = np.zeros(len(orders)), np.zeros(len(orders))
        for k in range(residual.shape[1]):
            answers = scipy.fft.ifft(spectrum * response[:, k, None], axis=0)[: len(angle)]
            columns = np.column_stack([residual[:, k], answers.real, answers.imag])
            flat = whitened(columns, white(e, residual[:, k]))
            for length, found in ((PIECE, pieces), (len(flat), whole)):
                cut = flat[: len(flat) // length * length].reshape(-1, length, flat.shape[1])
                found += _explained(cut[:, :, :1], cut[:, :, 1 : 1 + len(orders)], cut[:, :, 1 + len(orders) :])
        return np.array([pieces, whole])

    def _angle(self, e: TimeExperiment) -> Array:
        """The angle of the shaft at the samples: as an encoder on it was read, else by one that turns with it.

        A joint in between twists little, and as the model says; what a model gets wrong of the angle itself grows with
        time. So what that encoder was read more than simulated is added, as far as a slow torque turns both.
        """
        members = next((rows for rows in groups(self.problem).values() if self.flange in rows), [self.flange])
        known = [k for k in self.encoders if np.isfinite(e.measured[:, k]).mean() > 0.5]
        for k in known:
            flange = self._named(k).rpartition(".")[0]
            if flange in members:
                return np.asarray(_read(e, k) * ratio(self.problem, flange, self.flange))
        angles = self._simulated(e)
        angle = angles[f"{self.flange}.angle"]
        answer = self.linear.gains(np.array([2 * np.pi / (e.time[-1] - e.time[0])]))[0]
        turned = {k: float((answer[-1] / answer[k]).real) for k in known if answer[k] != 0}
        if not turned:
            return np.asarray(angle)
        k = min(turned, key=lambda k: abs(turned[k]) * e.sigma[k])
        return np.asarray(angle + turned[k] * (_read(e, k) - angles[self._named(k)]))

    def _named(self, k: int) -> str:
        return self.problem.model.outputs[k].name

    def _simulated(self, e: TimeExperiment) -> dict[str, Array]:
        """The angles of the shaft and of encoders at the samples, by name."""
        assert self.turning is not None
        parameters, starts = self.problem.values(self.x, e)
        there = {p.name for p in self.turning.parameters}
        given = {name: value for name, value in parameters.items() if name in there}
        rows = e.sampled(e.outputs(self.turning, given, starts, self.problem.internal_step))
        return {v.name: rows[:, k] for k, v in enumerate(self.turning.outputs)}


def _read(e: TimeExperiment, k: int) -> Array:
    """What was read of a signal, between readings too."""
    y = e.measured[:, k]
    known = np.isfinite(y)
    return np.interp(e.time, np.asarray(e.time)[known], y[known])


def _explained(rest: Array, cosines: Array, sines: Array) -> Array:
    """What the best sum of a cosine and a sine explains of each piece, summed, less what chance does; shape (orders,).

    Args:
        rest: shape (pieces, samples, 1).
        cosines: shape (pieces, samples, orders).
        sines: shape (pieces, samples, orders).
    """
    cc, ss, cs = (np.sum(a * b, axis=1) for a, b in ((cosines, cosines), (sines, sines), (cosines, sines)))
    rc, rs = np.sum(rest * cosines, axis=1), np.sum(rest * sines, axis=1)
    whole = cc * ss - cs**2
    able = whole > 1e-6 * np.maximum(cc, ss) ** 2
    gains = np.where(able, (ss * rc**2 - 2 * cs * rc * rs + cc * rs**2) / np.where(able, whole, 1.0), 0.0)
    return np.asarray(np.sum(np.where(able, gains - 2.0, 0.0), axis=0))
