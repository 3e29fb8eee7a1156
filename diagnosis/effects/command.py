"""What may be missing between a command and the drive that gets it: the fastest change that passes, and steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy.fft

from diagnosis.effects.effect import ANY, NAME, Candidate, EffectParameter, Sizes, combinations, with_unit
from diagnosis.effects.insertion import in_signal
from diagnosis.effects.linear_answer import LinearAnswer, white, whitened
from diagnosis.effects.places import Place
from diagnosis.effects.scales import OperatingScales
from diagnosis.estimation.parameters import Array
from diagnosis.estimation.problem import Problem
from diagnosis.estimation.time_experiment import TimeExperiment
from engine.errors import FlexarmError
from scenarios.amend import Edit, InSignal

TIMES = (2.0, 6.0, 20.0, 60.0, 200.0, 600.0)
"""Starting sizes of the time in which a limited command rises to its largest value, in samples."""

USUAL = 30.0
"""The same, of which nothing is known but that it is a time that matters."""

UNKNOWN = 3.0 * ANY
"""Standard deviation of the logarithm of a rate: drives differ by powers of ten."""

FOLLOWS = 0.25
"""Lag of a limited command while its limit does not act, in samples: too short to be seen."""

LEVELS = 100
"""Steps of the largest command, of the finest that are looked for: finer ones are noise, not a law."""

MOST_STEPS = 2
"""Steps that are tried: each costs a model of its own."""

APART = 1.03
"""Factor between two steps that are tried."""

WORTH, SHARE = 30.0, 0.02
"""What a height must explain: variances of the noise, of which the best of hundreds explains a dozen by chance, and a
share of what is left over."""

NEAR = 0.25
"""Change of a step, in steps of the largest command, by which that command ends on another one: a fraction of it."""


def at_command(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """A limit of the rate and steps of a command, in front of a driven input."""
    size, sample = place.size, scales.sample
    rates = combinations(rising=[size / (count * sample) for count in TIMES])
    rate = EffectParameter("rising", size / (USUAL * sample), usual=1.0, spread=UNKNOWN)
    unit = "*" if place.unit == "*" else f"({place.unit})/s" if "/" in place.unit else f"{place.unit or 1}/s"
    yield from in_signal(
        replace(place, unit=unit),
        "rate_limit",
        "RateLimiter",
        rates,
        rate,
        time_constant=with_unit(FOLLOWS * sample, "s"),
    )
    yield from _steps(scales, place)


def _steps(scales: OperatingScales, place: Place) -> Iterator[Candidate]:
    """Steps of a command, of heights that stand out in what the refitted model leaves, if any do."""
    problem, size, name = scales.problem, place.size, f"{NAME}_command_quantisation"
    if place.target not in [v.name for v in problem.model.inputs]:
        return  # within a loop nothing was recorded
    start = np.zeros(len(problem.free)) if scales.refitted is None else scales.refitted
    found = heights(problem, start, place.target, size, MOST_STEPS)
    if not found:
        return

    def edits(values: Sizes) -> list[Edit]:
        return [InSignal(name, "Quantiser", place.target, {"step": with_unit(values["step"], place.unit)})]

    def finer(best: Sizes, share: float) -> list[Sizes]:
        change = share * NEAR * best["step"] ** 2 / size
        return [{"step": best["step"] + sign * change} for sign in (-1, 1)]

    yield Candidate(
        "command_quantisation",
        place.name,
        place.block,
        name,
        edits,
        (EffectParameter("step", size, fixed=True, unit=place.unit),),
        combinations(step=found),
        finer=finer,
    )


def heights(problem: Problem, x: Array, target: str, size: float, most: int) -> list[float]:
    """Heights of steps of a recorded command that explain most of what a model leaves over, the best first.

    Args:
        problem: the model.
        x: its search vector, as fitted.
        target: the driven input.
        size: its largest value.
        most: number of heights.
    """
    grid = [size]
    while grid[-1] > size / LEVELS:
        grid.append(grid[-1] * (1 - NEAR * grid[-1] / size))
    try:
        answer = LinearAnswer(problem, x, target)
    except FlexarmError:
        return []
    number = [v.name for v in problem.model.inputs].index(target)
    score, left = np.zeros(len(grid)), 0.0
    for e in problem.training:
        if isinstance(e, TimeExperiment) and e.drive is not None:
            explained, rest = _explained(problem, x, answer, e, number, grid)
            score, left = score + explained, left + rest
    chosen: list[float] = []
    for k in np.argsort(-score):
        if (
            score[k] > max(WORTH, SHARE * left)
            and len(chosen) < most
            and all(abs(np.log(grid[k] / c)) > np.log(APART) for c in chosen)
        ):
            chosen.append(grid[k])
    return chosen


def _explained(
    problem: Problem, x: Array, answer: LinearAnswer, e: TimeExperiment, number: int, grid: Sequence[float]
) -> tuple[Array, float]:
    """What each height explains of the residual of an experiment, in its variances, and the whole of it."""
    assert e.drive is not None
    values = np.asarray(e.drive.values, dtype=float).reshape(len(np.asarray(e.drive.time)), -1)[:, number]
    # What is held since the last row, at the samples.
    last = np.searchsorted(np.asarray(e.drive.time), np.asarray(e.time) + 1e-9, side="right") - 1
    command = values[np.maximum(last, 0)]
    rows, interval = e.evenly(np.column_stack([command, problem.residual(x, e)]))
    command, residual = rows[:, 0], rows[:, 1:]
    n, count = len(command), 2 * len(command)
    held = np.exp(-1j * np.pi * scipy.fft.fftfreq(count)) * np.sinc(scipy.fft.fftfreq(count))
    response = answer.response(count, interval) / e.sigma * held[:, None]
    weights = [white(e, residual[:, k]) for k in range(residual.shape[1])]
    rest = [whitened(residual[:, [k]], weights[k])[:, 0] for k in range(residual.shape[1])]
    found = np.zeros(len(grid))
    for i, step in enumerate(grid):
        spectrum = scipy.fft.fft(step * np.floor(command / step + 0.5) - command, count)
        pull = power = 0.0
        for k, flat in enumerate(rest):
            made = whitened(scipy.fft.ifft(spectrum * response[:, k])[:n].real[:, None], weights[k])[:, 0]
            pull, power = pull + float(made @ flat), power + float(made @ made)
        if pull > 0 and power > 0:
            found[i] = pull**2 / power
    return found, float(sum(flat @ flat for flat in rest))
